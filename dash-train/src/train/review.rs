//! The review of the dynamic set during the 4D stage: what moves nothing becomes static.

use dash_model::{DynamicScene, Gaussians};

use super::optimizer::to_host;
use super::split::{drop_hidden, keep_dynamic};
use super::statistics::witnesses;
use super::trainer::{STATIC, Trainer};
use crate::Error;

/// Times at which a review looks where a Gaussian is.
const TIMES: usize = 12;
/// Share by which the squared error must grow when all that moves is held still; else the scene needs
/// no dynamic part. An object on 0.3 % of the pixels, half found, is worth 4e-4; what is left in a
/// scene in which nothing moves, 1e-5.
const MIN_GAIN: f64 = 2e-4;

/// Where dynamic Gaussians are over the clip.
struct Ways {
    centres: Vec<[f32; 3]>,
    /// World units.
    ranges: Vec<f32>,
}

/// Removes dynamic Gaussians that no picture shows, and makes static those that stay in place, in
/// the middle of where they are over the clip: all of them, if by the end of their density control
/// holding all still does no harm.
pub(crate) fn review(trainer: &mut Trainer) -> Result<(), Error> {
    drop_hidden(trainer)?;
    let Some(ways) = ways(&trainer.scene)? else {
        return Ok(());
    };
    let n = ways.centres.len();
    let still = held_still(&trainer.scene, &ways)?;
    let screen = screen_scale(trainer, &ways.centres);
    let floor = trainer.config.decomposition.review_floor;
    let needed = !is_grown(trainer) || is_needed(trainer, &still)?;
    // What is not finite is left to density control, which removes it.
    let moves = |row: usize| {
        let way = ways.ranges[row] * screen[row];
        way >= floor || !way.is_finite()
    };
    let (stay, leave): (Vec<usize>, Vec<usize>) = (0..n).partition(|&row| needed && moves(row));
    if leave.is_empty() {
        return Ok(());
    }
    let n_static = trainer.scene.static_set.len();
    let rows = still.to_rows();
    let kept: Vec<usize> = (0..n_static)
        .chain(leave.iter().map(|row| n_static + row))
        .collect();
    trainer.optimizer.extend_rows(STATIC, n_static, leave.len());
    trainer.scene.static_set = Gaussians::from_rows(&rows.gather(&kept), &trainer.device);
    trainer.density_static.grow(leave.len());
    keep_dynamic(trainer, &stay);
    Ok(())
}

/// `None` without dynamic Gaussians.
fn ways(scene: &DynamicScene) -> Result<Option<Ways>, Error> {
    let Some(dynamic) = scene.dynamic.as_ref().filter(|d| !d.gaussians.is_empty()) else {
        return Ok(None);
    };
    let n = dynamic.gaussians.len();
    let mut low = vec![[f32::INFINITY; 3]; n];
    let mut high = vec![[f32::NEG_INFINITY; 3]; n];
    for k in 0..TIMES {
        let time = k as f32 / (TIMES - 1) as f32;
        let means = to_host(dynamic.deform(&scene.settings, time)?.means.detach());
        for (row, mean) in means.chunks_exact(3).enumerate() {
            for axis in 0..3 {
                low[row][axis] = low[row][axis].min(mean[axis]);
                high[row][axis] = high[row][axis].max(mean[axis]);
            }
        }
    }
    let both = || low.iter().zip(&high);
    let centres = both().map(|(l, h)| std::array::from_fn(|a| 0.5 * (l[a] + h[a])));
    let ranges = both().map(|(l, h)| glam::Vec3::from(*l).distance((*h).into()));
    Ok(Some(Ways {
        centres: centres.collect(),
        ranges: ranges.collect(),
    }))
}

/// All Gaussians as one static set, the dynamic ones last and in the middle of their ways.
fn held_still(scene: &DynamicScene, ways: &Ways) -> Result<Gaussians, Error> {
    let mut rows = scene.at(0.5)?;
    let n_static = rows.len() - ways.centres.len();
    rows.means[n_static..].copy_from_slice(&ways.centres);
    Ok(Gaussians::from_rows(
        &rows,
        &scene.static_set.means.device(),
    ))
}

/// Whether the dynamic set has had its time to grow; before, it may still be finding what moves.
pub(crate) fn is_grown(trainer: &Trainer) -> bool {
    trainer.step >= trainer.config.step_at(trainer.config.density_dynamic.until)
}

/// Whether pictures get worse when all that moves is held still.
fn is_needed(trainer: &Trainer, still: &Gaussians) -> Result<bool, Error> {
    let scene = &trainer.scene;
    let still = DynamicScene {
        static_set: still.clone(),
        dynamic: None,
        settings: scene.settings.clone(),
    };
    let (mut moving_error, mut still_error) = (0.0, 0.0);
    for view in witnesses(trainer) {
        let truth = view.rgb(scene.settings.background)?;
        let error = |scene: &DynamicScene| -> Result<f64, Error> {
            let image = scene.render(&view.camera, view.time)?.rgb().detach();
            let pairs = to_host(image).into_iter().zip(&truth);
            Ok(pairs.map(|(a, b)| f64::from(a - b).powi(2)).sum())
        };
        moving_error += error(scene)?;
        still_error += error(&still)?;
    }
    let worth = (1.0 + MIN_GAIN) * moving_error;
    // An error that is not finite decides nothing.
    Ok(still_error >= worth || !still_error.is_finite() || !worth.is_finite())
}

/// Shares of the image's width that a world unit takes at each point, median over the training
/// views that have it in front of them.
fn screen_scale(trainer: &Trainer, points: &[[f32; 3]]) -> Vec<f32> {
    const VIEWS: usize = 16;
    let stride = trainer.train_views.len().div_ceil(VIEWS).max(1);
    let cameras: Vec<_> = trainer
        .train_views
        .iter()
        .step_by(stride)
        .map(|&view| &trainer.dataset.views[view].camera)
        .collect();
    points
        .iter()
        .map(|point| {
            let mut scales: Vec<f32> = cameras
                .iter()
                .filter_map(|camera| {
                    let depth = camera.transform(point.map(f64::from))[2];
                    (depth > 1e-6).then(|| (camera.fx / (depth * camera.width as f64)) as f32)
                })
                .collect();
            scales.sort_by(f32::total_cmp);
            scales
                .get(scales.len() / 2)
                .copied()
                .unwrap_or(f32::INFINITY)
        })
        .collect()
}
