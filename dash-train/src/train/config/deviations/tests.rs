use std::collections::BTreeSet;

use clap::ValueEnum;

use super::*;

/// What a list says wrongly, or not, of a preset's values.
fn faults(list: &[Said], values: &BTreeMap<String, String>) -> Vec<String> {
    let mut faults = Vec::new();
    let mut listed = BTreeSet::new();
    for said in list {
        let (key, here) = (said.key, value(values, said.key));
        if !listed.insert(key) {
            faults.push(format!("{key}: listed twice"));
        }
        let deviates = said.value != Some(here);
        if deviates && said.why.is_empty() {
            faults.push(format!(
                "{key}: {here} in place of {:?}, no reason",
                said.value
            ));
        }
        if !deviates && !said.why.is_empty() {
            faults.push(format!("{key}: {here} is no deviation"));
        }
    }
    let missing = values.keys().filter(|key| !listed.contains(key.as_str()));
    faults.extend(missing.map(|key| format!("{key}: not listed")));
    faults
}

/// The same of a list of keys in which some values differ from others.
fn faults_between(
    list: &[(&str, &str)],
    values: &BTreeMap<String, String>,
    others: &[BTreeMap<String, String>],
) -> Vec<String> {
    let keys = others.iter().chain([values]).flat_map(BTreeMap::keys);
    let keys: BTreeSet<&str> = keys.map(String::as_str).collect();
    let differs = |key: &str| {
        let mut others = others.iter();
        others.any(|other| value(other, key) != value(values, key))
    };
    let listed: BTreeSet<&str> = list.iter().map(|(key, _)| *key).collect();
    let mut faults: Vec<String> = keys
        .into_iter()
        .filter(|key| differs(key) && !listed.contains(key))
        .map(|key| format!("{key}: not listed"))
        .collect();
    let idle = listed.into_iter().filter(|key| !differs(key));
    faults.extend(idle.map(|key| format!("{key}: no deviation")));
    faults
}

fn of(preset: Preset) -> BTreeMap<String, String> {
    values(&TrainConfig::preset(preset))
}

#[test]
fn every_deviation_of_paper_and_reference_is_listed_with_a_reason() {
    let none: Vec<String> = Vec::new();
    assert_eq!(faults(PAPER, &of(Preset::Paper)), none);
    assert_eq!(faults(RELEASED, &of(Preset::Reference)), none);
}

#[test]
fn every_key_in_which_ours_differ_from_paper_is_listed_with_a_reason() {
    let none: Vec<String> = Vec::new();
    let ours = [Preset::Default, Preset::Quick, Preset::Best].map(of);
    assert_eq!(faults_between(OURS, &of(Preset::Paper), &ours), none);
    assert!(OURS.iter().all(|(_, why)| !why.is_empty()));
    for row in in_code() {
        let words = [row.what, row.said, &row.here, row.why];
        assert!(words.iter().all(|words| !words.is_empty()), "{}", row.what);
        let is_preset = |name: &&str| Preset::from_str(name, false).is_ok();
        assert!(row.presets.iter().all(is_preset), "{}", row.what);
    }
}

#[test]
fn a_value_that_changes_unlisted_is_found() {
    let mut paper = TrainConfig::preset(Preset::Paper);
    paper.dssim = 0.3;
    let found = faults(PAPER, &values(&paper));
    assert!(
        found.len() == 1 && found[0].starts_with("dssim: 0.3"),
        "{found:?}"
    );

    // A limit that 3DGS has, too, would be no deviation.
    let mut listed = of(Preset::Paper);
    listed.insert("densify.static.max_gaussians".into(), "no limit".into());
    let found = faults(PAPER, &listed);
    assert_eq!(
        found,
        ["densify.static.max_gaussians: no limit is no deviation"]
    );

    let found = faults(&PAPER[1..], &of(Preset::Paper));
    assert_eq!(found, ["iterations: not listed"]);

    let mut quick = TrainConfig::preset(Preset::Quick);
    quick.dssim = 0.0;
    let found = faults_between(
        OURS,
        &of(Preset::Paper),
        &[of(Preset::Default), values(&quick)],
    );
    assert_eq!(found, ["dssim: not listed"]);
    let paper = of(Preset::Paper);
    let found = faults_between(OURS, &paper, &[of(Preset::Default), paper.clone()]);
    assert!(
        found.contains(&"sh_degree: no deviation".to_string()),
        "{found:?}"
    );
}

#[test]
fn the_books_page_ends_with_what_the_code_says() {
    let path =
        std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs/src/reference/presets.md");
    let Ok(page) = std::fs::read_to_string(&path) else {
        // A packaged crate has no book beside it.
        return;
    };
    let start = page.find(HEADING).expect("the page has the heading");
    assert!(
        page[start..].trim_end() == deviations().trim_end(),
        "{}, from its heading `{HEADING}` on, is not what `dash config --deviations` prints; write it anew",
        path.display()
    );
}
