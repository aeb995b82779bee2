//! Masks: how many pictures have one, and how much of them counts.

use super::finding::{Finding, percent};
use super::tracks::{Look, Tracks};
use crate::dataset::Dataset;
use crate::dataset::pixels::masks::{HARDLY_ANY, unused_folder};

/// The masks of the pictures that were looked at; nothing where there are none.
pub(super) fn check(dataset: &Dataset, looked: &Tracks) -> Option<Finding> {
    let looks: Vec<&Look> = looked.tracks.iter().flat_map(|t| &t.looks).collect();
    let masked = looks.iter().filter(|look| look.counted.is_some()).count();
    if masked == 0 {
        let text = unused_folder(&dataset.root, &dataset.views.first()?.name)?;
        let mend = "call the masks as the views are called, or remove the folder";
        return Some(Finding::warning("masks", text, mend));
    }
    let counted: f64 = looks.iter().map(|look| look.counted.unwrap_or(1.0)).sum();
    let share = counted / looks.len() as f64;
    let text = format!(
        "{masked} of {} views have a mask; {} of all pixels count",
        looks.len(),
        percent((1e6 * share) as usize, 1_000_000)
    );
    if share < HARDLY_ANY {
        let mend = "if white marks what does not count, use --invert-masks";
        return Some(Finding::warning("masks", text, mend));
    }
    Some(Finding::ok("masks", text))
}
