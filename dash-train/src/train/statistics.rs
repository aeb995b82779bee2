//! What is gathered beside the steps: gradients on the screen, how large motion appears, and which
//! dynamic Gaussians any picture shows.

use burn::module::Module;
use burn::tensor::{Gradients, Tensor};
use dash_kernels::rows::join_rows;
use dash_kernels::splats::{DEPTH, MEAN_X, N_COLUMNS, RADIUS_X, RED};
use dash_model::decomposition::select_dynamic;

use super::coarse;
use super::config::MotionMeasure;
use super::density::MEANS;
use super::forward::Forward;
use super::optimizer::to_host;
use super::trainer::Trainer;
use crate::Error;
use crate::dataset::View;

/// Steps between two looks at which Gaussians Eq. 5 holds still.
const MASK_INTERVAL: usize = 50;
/// Views that are asked what they show of the dynamic Gaussians.
const WITNESSES: usize = 32;
/// Step between them among all training views, as a share of these: the golden ratio, which spreads
/// them over cameras and times whatever the order.
const WITNESS_STEP: f64 = 0.618_033_988_749_895;

/// Takes from a step's gradients what density control and the split need.
pub(crate) fn gather(
    trainer: &mut Trainer,
    forward: &Forward,
    view: &View,
    gradients: &mut Gradients,
) -> Result<(), Error> {
    let camera = &view.camera;
    let half_size = [camera.width as f32 / 2.0, camera.height as f32 / 2.0];
    let (leaf, splats) = &forward.static_probe;
    if let Some(v_splats) = leaf.grad_remove(gradients) {
        trainer
            .density_static
            .add(&of_means(v_splats), splats, half_size);
    }
    if let Some((leaf, splats)) = &forward.dynamic_probe
        && let Some(v_splats) = leaf.grad_remove(gradients)
    {
        trainer
            .density_dynamic
            .add(&of_means(v_splats), splats, half_size);
    }
    if trainer.motion_space.is_some() {
        gather_scale(trainer, splats, view);
        if trainer.step.is_multiple_of(MASK_INTERVAL) {
            trainer.held_still = moving(trainer)?.iter().map(|moves| !moves).collect();
        }
    }
    Ok(())
}

/// The columns of a gradient `[N, C]` that are those of the means, row by row.
fn of_means(v_splats: Tensor<2>) -> Vec<f32> {
    to_host(v_splats.narrow(1, MEAN_X, MEANS))
}

/// How large a world unit of each visible Gaussian's motion appears in this view.
fn gather_scale(trainer: &mut Trainer, splats: &[f32], view: &View) {
    let focal = (view.camera.fx / view.camera.width as f64) as f32;
    let measure = trainer.config.decomposition.measure;
    let (scales, weights): (Vec<f32>, Vec<f32>) = splats
        .chunks_exact(N_COLUMNS)
        .map(|splat| {
            let depth = splat[DEPTH];
            let visible = splat[RADIUS_X] > 0.0 && depth > 0.0;
            let scale = match measure {
                MotionMeasure::World => 1.0,
                MotionMeasure::DistanceWeighted => 1.0 / (depth * depth + 1e-6),
                MotionMeasure::Screen => focal / depth,
            };
            (scale, if visible { 1.0 } else { 0.0 })
        })
        .unzip();
    trainer.motion_statistics.add(&scales, &weights);
}

/// Which Gaussians move, as far as the coarse stages know.
pub(crate) fn moving(trainer: &Trainer) -> Result<Vec<bool>, Error> {
    let rule = &trainer.config.decomposition;
    let Some(coefficients) = coarse::coefficients(trainer)? else {
        return Ok(vec![false; trainer.scene.static_set.len()]);
    };
    let extents = to_host(trainer.extents(coefficients)?);
    let motion: Vec<f32> = extents
        .iter()
        .zip(trainer.motion_statistics.means())
        .map(|(extent, scale)| extent * scale)
        .collect();
    Ok(select_dynamic(&motion, rule.quantile, rule.floor))
}

/// Some training views of all cameras and times.
pub(crate) fn witnesses(trainer: &Trainer) -> impl Iterator<Item = &View> {
    spread(trainer, WITNESSES)
}

/// At most `most` training views of all cameras and times; all of them where there are no more.
pub(crate) fn spread(trainer: &Trainer, most: usize) -> impl Iterator<Item = &View> {
    let views = &trainer.train_views;
    let all = views.len() <= most;
    (0..most.min(views.len())).map(move |k| {
        let place = (k as f64 * WITNESS_STEP).fract() * views.len() as f64;
        let place = if all { k } else { place as usize };
        &trainer.dataset.views[views[place]]
    })
}

/// For each Gaussian, static ones first, the most pixels' worth of it that one of the views shows: its
/// blending weights summed over the picture.
pub(crate) fn largest_shares<'a>(
    trainer: &Trainer,
    views: impl Iterator<Item = &'a View>,
) -> Result<Vec<f32>, Error> {
    let (n_static, n_dynamic) = trainer.scene.counts();
    let mut largest = vec![0.0f32; n_static + n_dynamic];
    for view in views {
        // The red of a splat enters a pixel with its weight: the gradient of the sum of all red.
        let weights = splat_gradient(trainer, view, |image| image.narrow(2, 0, 1).sum())?;
        for (share, row) in largest.iter_mut().zip(weights.chunks_exact(N_COLUMNS)) {
            *share = share.max(row[RED]);
        }
    }
    Ok(largest)
}

/// The gradient of a number that is made of a view's picture `[H, W, 5]`, to the packed splats, static ones
/// first; nothing where it does not depend on them.
pub(crate) fn splat_gradient(
    trainer: &Trainer,
    view: &View,
    number: impl FnOnce(Tensor<3>) -> Tensor<1>,
) -> Result<Vec<f32>, Error> {
    // Without the graph: nothing would free what leads to splats through which no gradient flows.
    let scene = trainer.scene.valid();
    let mut splats = scene.static_splats(&view.camera)?;
    if let Some(moving) = scene.dynamic_splats(&view.camera, view.time)? {
        splats = join_rows(splats, moving)?;
    }
    let leaf = Tensor::from_inner(splats).require_grad();
    let image = scene.rasterize(leaf.clone(), &view.camera)?.image;
    let gradients = number(image).backward();
    Ok(leaf.grad(&gradients).map_or_else(Vec::new, to_host))
}
