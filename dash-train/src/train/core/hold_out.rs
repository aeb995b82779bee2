//! Views that are neither trained on nor tested.

use dash_model::DynamicScene;

use super::optimizer::to_host;
use crate::Error;
use crate::dataset::{Dataset, Partition};

/// Views that are held out at most.
pub(crate) const MAX_VALIDATION_VIEWS: usize = 4;
/// Training views for each one that is held out.
pub(crate) const VIEWS_PER_VALIDATION_VIEW: usize = 40;

/// Indices of the views to train on, and of those held out, evenly spread.
pub(crate) fn hold_out(dataset: &Dataset) -> (Vec<usize>, Vec<usize>) {
    let all: Vec<usize> = (0..dataset.views.len())
        .filter(|&i| dataset.views[i].partition == Partition::Train)
        .collect();
    let count = (all.len() / VIEWS_PER_VALIDATION_VIEW).min(MAX_VALIDATION_VIEWS);
    let held: Vec<usize> = (0..count)
        .map(|k| all[(2 * k + 1) * all.len() / (2 * count)])
        .collect();
    let rest = all.into_iter().filter(|i| !held.contains(i)).collect();
    (rest, held)
}

/// Mean PSNR over views, dB.
pub(crate) fn psnr(
    scene: &DynamicScene,
    dataset: &Dataset,
    views: &[usize],
) -> Result<Option<f64>, Error> {
    if views.is_empty() {
        return Ok(None);
    }
    let mut sum = 0.0;
    for &index in views {
        let view = &dataset.views[index];
        let image = to_host(scene.render(&view.camera, view.time)?.rgb().detach());
        sum += crate::metrics::psnr(&image, &view.rgb(scene.settings.background)?);
    }
    Ok(Some(sum / views.len() as f64))
}
