//! What each preset has in place of what the paper, 3DGS or the released code has, and why.
//!
//! A source is a list of [`Said`], one for every key of the configuration. The tests hold the presets against the lists, and
//! the book's page against what is printed here.

mod in_code;
mod ours;
mod paper;
mod released;
#[cfg(test)]
mod tests;

use std::collections::BTreeMap;
use std::fmt::Write;

use toml::{Table, Value};

use super::shown::{joined, shown};
use super::{Preset, TrainConfig};
use in_code::in_code;
use ours::OURS;
use paper::PAPER;
use released::RELEASED;

/// Sections of the configuration whose keys are looked at one by one. An extension is one key.
const SECTIONS: [&str; 8] = [
    "extensions",
    "method",
    "method.motion_field",
    "method.field",
    "optimizer",
    "densify",
    "densify.static",
    "densify.dynamic",
];
/// Keys that say nothing about a method.
const NEUTRAL: [&str; 4] = [
    "preset",
    "seed",
    "checkpoint_interval",
    "validation_interval",
];
/// Where no value is.
const ABSENT: &str = "-";

/// What a source says of a key.
struct Said {
    key: &'static str,
    /// Its value, as [`shown`] writes it, or in words where no value of the key is the same; `None` where it says none.
    value: Option<&'static str>,
    /// Why the preset has another value, or has this one where the source says none. Empty where it has the source's.
    why: &'static str,
}

/// The preset has the source's value.
const fn same(key: &'static str, value: &'static str) -> Said {
    Said {
        key,
        value: Some(value),
        why: "",
    }
}

/// The preset has another value.
const fn other(key: &'static str, value: &'static str, why: &'static str) -> Said {
    Said {
        key,
        value: Some(value),
        why,
    }
}

/// The source says nothing.
const fn open(key: &'static str, why: &'static str) -> Said {
    Said {
        key,
        value: None,
        why,
    }
}

/// The heading under which the book has [`deviations`].
pub const HEADING: &str = "## What the paper leaves open";

/// The part of the book's page of presets that lists values that the paper leaves open, and the deviations of every preset, in
/// Markdown.
pub fn deviations() -> String {
    let [paper, reference, default, quick, best] = [
        Preset::Paper,
        Preset::Reference,
        Preset::Default,
        Preset::Quick,
        Preset::Best,
    ]
    .map(|preset| values(&TrainConfig::preset(preset)));
    let mut text = format!(
        "{HEADING}
Made by `dash config --deviations`, as is all that follows. The paper states no weight of a loss, no size of a hash table and
no number of steps. Where 3DGS has a value of the same thing, `paper` takes that. Else it chooses:

| key | `paper` | why |
| --- | --- | --- |
"
    );
    for said in PAPER.iter().filter(|said| said.value.is_none()) {
        let value = quoted(&paper, said.key);
        let _ = writeln!(text, "| `{}` | {value} | {} |", said.key, said.why);
    }
    text += "
## Deviations of `paper`
From what the paper states, and from 3DGS, to which it leaves the static Gaussians and density control. Every other key has
their value.
";
    compared(&mut text, "paper, 3DGS", "paper", PAPER, &paper);
    text += "
## Deviations of `reference`
From the released code, with the preset that it ships. Every other key has its value.
";
    compared(
        &mut text,
        "released code",
        "reference",
        RELEASED,
        &reference,
    );
    text += "
## Deviations of `default`, `quick` and `best`
From `paper`, beside those of `paper` itself. Every other key has the value that it has there.

| key | `paper` | `default` | `quick` | `best` | why |
| --- | --- | --- | --- | --- | --- |
";
    for (key, why) in OURS {
        let [paper, default, quick, best] =
            [&paper, &default, &quick, &best].map(|values| quoted(values, key));
        let _ = writeln!(
            text,
            "| `{key}` | {paper} | {default} | {quick} | {best} | {why} |"
        );
    }
    text += "
## Deviations in the code
No key changes these.

| what | presets | source | here | why |
| --- | --- | --- | --- | --- |
";
    for row in in_code() {
        let presets: Vec<String> = row.presets.iter().map(|name| format!("`{name}`")).collect();
        let presets = match presets.len() {
            4 => "all".to_string(),
            _ => presets.join(", "),
        };
        let (what, said, here, why) = (row.what, row.said, row.here, row.why);
        let _ = writeln!(text, "| {what} | {presets} | {said} | {here} | {why} |");
    }
    text
}

/// The rows of what a preset has in place of what a source says.
fn compared(
    text: &mut String,
    source: &str,
    preset: &str,
    list: &[Said],
    values: &BTreeMap<String, String>,
) {
    let _ = write!(
        text,
        "\n| key | {source} | `{preset}` | why |\n| --- | --- | --- | --- |\n"
    );
    for said in list.iter().filter(|said| !said.why.is_empty()) {
        if let Some(value) = said.value {
            let (key, here, why) = (said.key, quoted(values, said.key), said.why);
            let _ = writeln!(text, "| `{key}` | {value} | {here} | {why} |");
        }
    }
}

/// The values of a configuration that say something about the method, by key.
fn values(config: &TrainConfig) -> BTreeMap<String, String> {
    let mut found = BTreeMap::new();
    let table = Table::try_from(config).unwrap_or_default();
    gather("", &table, &mut found);
    found.retain(|key, _| !NEUTRAL.contains(&key.as_str()));
    found
}

fn gather(path: &str, table: &Table, found: &mut BTreeMap<String, String>) {
    for (name, value) in table {
        let path = joined(path, name);
        match value {
            Value::Table(section) if SECTIONS.contains(&path.as_str()) => {
                gather(&path, section, found);
            }
            Value::Table(section) if section.is_empty() => {
                found.insert(path, "on".into());
            }
            value => {
                found.insert(path, shown(value));
            }
        }
    }
}

/// The value of a key; [`ABSENT`] without one.
fn value<'a>(values: &'a BTreeMap<String, String>, key: &str) -> &'a str {
    values.get(key).map_or(ABSENT, String::as_str)
}

fn quoted(values: &BTreeMap<String, String>, key: &str) -> String {
    match value(values, key) {
        ABSENT => ABSENT.into(),
        value => format!("`{value}`"),
    }
}
