//! What the pictures need in memory.

use super::finding::Finding;
use crate::dataset::Dataset;

/// The pictures' bytes against a budget.
pub(super) fn check(dataset: &Dataset, budget: Option<u64>) -> Finding {
    let bytes: u64 = dataset
        .views
        .iter()
        .map(|view| {
            let channels = if view.has_alpha() { 4 } else { 3 };
            (view.camera.width * view.camera.height * channels) as u64
        })
        .sum();
    let text = format!(
        "{} pictures take {} in memory",
        dataset.views.len(),
        amount(bytes)
    );
    match budget {
        Some(budget) if bytes > budget => {
            let factor = (bytes as f64 / budget as f64).sqrt();
            let mend = format!(
                "--downscale {:.1} makes them fit",
                (10.0 * factor).ceil() / 10.0
            );
            let text = format!("{text}, more than the {} of --memory", amount(budget));
            Finding::warning("memory", text, &mend)
        }
        Some(budget) => Finding::ok(
            "memory",
            format!("{text}, of {} of --memory", amount(budget)),
        ),
        None => Finding::ok("memory", text),
    }
}

fn amount(bytes: u64) -> String {
    let mebibytes = bytes as f64 / f64::from(1 << 20);
    match mebibytes {
        m if m >= 1024.0 => format!("{:.1} GiB", m / 1024.0),
        m => format!("{m:.1} MiB"),
    }
}
