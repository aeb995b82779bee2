//! Runs that belong together.

use super::plot::{N_COLORS, Point, Series};
use super::runs::RunRecord;

/// Runs of one method, of several seeds.
#[derive(Debug, Clone, PartialEq)]
pub struct RunGroup {
    /// Its name in legends and tables.
    pub label: String,
    /// The runs.
    pub runs: Vec<RunRecord>,
}

/// Groups runs that differ in nothing but their seed, in the order in which they are met. A group is
/// called as its run, or by the beginning that the names of its runs share.
pub fn group_by_seed(runs: Vec<RunRecord>) -> Vec<RunGroup> {
    let mut groups: Vec<RunGroup> = Vec::new();
    for run in runs {
        let fits = |group: &&mut RunGroup| same_but_seed(&group.runs[0], &run);
        match groups.iter_mut().find(fits) {
            Some(group) => group.runs.push(run),
            None => groups.push(RunGroup {
                label: String::new(),
                runs: vec![run],
            }),
        }
    }
    let labels: Vec<String> = groups
        .iter()
        .map(|group| shared_name(&group.runs))
        .collect();
    for (i, group) in groups.iter_mut().enumerate() {
        let alike = labels[..i]
            .iter()
            .filter(|label| **label == labels[i])
            .count();
        group.label = match (labels.iter().filter(|l| **l == labels[i]).count(), alike) {
            (1, _) => labels[i].clone(),
            (_, before) => format!("{} [{}]", labels[i], before + 1),
        };
    }
    groups
}

/// The series' look for a group.
pub(super) fn series(groups: &[RunGroup], group: usize) -> Series {
    let RunGroup { label, runs } = &groups[group];
    Series {
        label: match runs.len() {
            1 => label.clone(),
            n => format!("{label} ({n} runs)"),
        },
        color: group,
        mark: group,
        dashed: group >= N_COLORS,
        ..Series::default()
    }
}

/// A line for every group that has points.
pub(super) fn lines(groups: &[RunGroup], points: impl Fn(&RunGroup) -> Vec<Point>) -> Vec<Series> {
    let lines = groups.iter().enumerate().map(|(i, group)| Series {
        points: points(group),
        joined: true,
        named_at_end: groups.len() > 1,
        ..series(groups, i)
    });
    lines.filter(|line| !line.points.is_empty()).collect()
}

/// Every run with the name of its group.
pub(super) fn runs_of(groups: &[RunGroup]) -> impl Iterator<Item = (&str, &RunRecord)> {
    groups
        .iter()
        .flat_map(|group| group.runs.iter().map(|run| (group.label.as_str(), run)))
}

fn same_but_seed(a: &RunRecord, b: &RunRecord) -> bool {
    let mut config = a.config.as_begun();
    config.train.seed = b.config.train.seed;
    config == b.config.as_begun()
}

fn shared_name(runs: &[RunRecord]) -> String {
    let [first, others @ ..] = runs else {
        return String::new();
    };
    if others.is_empty() {
        return first.name.clone();
    }
    let shared = first
        .name
        .char_indices()
        .map(|(at, c)| at + c.len_utf8())
        .take_while(|&end| {
            let beginning = &first.name[..end];
            others.iter().all(|run| run.name.starts_with(beginning))
        })
        .last()
        .unwrap_or(0);
    // What is left of `seed0` and `seed1`, or `s0` and `s1`.
    let separators = ['-', '_', '.', ' ', '/'];
    let name = first.name[..shared].trim_end_matches(separators);
    let stem = ["seed", "s"].into_iter().find_map(|word| {
        name.strip_suffix(word)
            .filter(|stem| stem.ends_with(separators))
    });
    let name = stem.unwrap_or(name).trim_end_matches(separators);
    if name.is_empty() {
        first.name.clone()
    } else {
        name.into()
    }
}
