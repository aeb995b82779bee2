//! What the pictures need in memory.

use super::finding::Finding;
use crate::dataset::{Dataset, bytes_in_words, default_budget};

/// The pictures' bytes against a budget, half of the memory that is free unless said.
pub(super) fn check(dataset: &Dataset, budget: Option<u64>) -> Finding {
    let bytes = dataset.image_bytes();
    let budget = budget.unwrap_or_else(default_budget);
    let text = format!(
        "{} pictures take {} of the {} that they may",
        dataset.views.len(),
        bytes_in_words(bytes),
        bytes_in_words(budget)
    );
    if bytes <= budget {
        return Finding::ok("memory", text);
    }
    let factor = (bytes as f64 / budget as f64).sqrt();
    let mend = format!(
        "a larger --memory, or --downscale {:.1}, holds them all",
        (10.0 * factor).ceil() / 10.0
    );
    let text = format!("{text}: training decodes them when it needs them");
    Finding::note_with_mend("memory", text, &mend)
}
