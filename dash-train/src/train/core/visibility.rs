//! Which Gaussians a few pictures show, and how much of each.

use burn::module::Module;
use burn::tensor::Tensor;
use dash_kernels::Camera;
use dash_kernels::rows::join_rows;
use dash_kernels::splats::{N_COLUMNS, RED};
use dash_model::DynamicScene;

use super::optimizer::to_host;
use super::run::Run;
use crate::Error;
use crate::dataset::View;

/// Views that are asked what they show of the dynamic Gaussians.
const WITNESSES: usize = 32;
/// Step between them among all training views, as a share of these: the golden ratio, which spreads
/// them over cameras and times whatever the order.
const WITNESS_STEP: f64 = 0.618_033_988_749_895;

/// Some training views of all cameras and times.
pub(crate) fn witnesses<M>(run: &Run<M>) -> impl Iterator<Item = &View> {
    spread(run, WITNESSES)
}

/// At most `most` training views of all cameras and times; all of them where there are no more.
pub(crate) fn spread<M>(run: &Run<M>, most: usize) -> impl Iterator<Item = &View> {
    let views = &run.train_views;
    let all = views.len() <= most;
    (0..most.min(views.len())).map(move |k| {
        let place = (k as f64 * WITNESS_STEP).fract() * views.len() as f64;
        let place = if all { k } else { place as usize };
        &run.dataset.views[views[place]]
    })
}

/// For each Gaussian, static ones first, the most pixels' worth of it that one of the views shows: its
/// blending weights summed over the picture.
pub(crate) fn largest_shares<'a, M>(
    run: &Run<M>,
    views: impl Iterator<Item = &'a View>,
) -> Result<Vec<f32>, Error> {
    let (n_static, n_dynamic) = run.scene.counts();
    let mut largest = vec![0.0f32; n_static + n_dynamic];
    for view in views {
        // The red of a splat enters a pixel with its weight: the gradient of the sum of all red.
        let weights = splat_gradient(run, view, |image| image.narrow(2, 0, 1).sum())?;
        for (share, row) in largest.iter_mut().zip(weights.chunks_exact(N_COLUMNS)) {
            *share = share.max(row[RED]);
        }
    }
    Ok(largest)
}

/// The gradient of a number that is made of a view's picture `[H, W, 5]`, to the packed splats, static ones
/// first, those of a backdrop last; nothing where it does not depend on them.
pub(crate) fn splat_gradient<M>(
    run: &Run<M>,
    view: &View,
    number: impl FnOnce(Tensor<3>) -> Tensor<1>,
) -> Result<Vec<f32>, Error> {
    // Without the graph: nothing would free what leads to splats through which no gradient flows.
    let scene = run.scene.valid();
    let mut splats = scene.static_splats(&view.camera)?;
    if let Some(moving) = scene.dynamic_splats(&view.camera, view.time)? {
        splats = join_rows(splats, moving)?;
    }
    if let Some(backdrop) = &run.backdrop {
        splats = join_rows(splats, backdrop.splats(&view.camera)?)?;
    }
    gradient_of(&scene, splats, &view.camera, number)
}

/// The gradient of a number that is made of a picture `[H, W, 5]` of packed splats, which have no graph, to these splats.
pub(crate) fn gradient_of(
    scene: &DynamicScene,
    splats: Tensor<2>,
    camera: &Camera,
    number: impl FnOnce(Tensor<3>) -> Tensor<1>,
) -> Result<Vec<f32>, Error> {
    let leaf = Tensor::from_inner(splats).require_grad();
    let image = scene.rasterize(leaf.clone(), camera)?.image;
    let gradients = number(image).backward();
    Ok(leaf.grad(&gradients).map_or_else(Vec::new, to_host))
}
