//! The forward pass of a step: the picture and its loss.

use burn::tensor::{Tensor, TensorData};
use dash_kernels::photometric::photometric;
use dash_kernels::rows::join_rows;
use dash_kernels::tap::tap;

use super::forward::Forward;
use super::hooks::Hooks;
use super::loss::where_counted;
use super::method::Method;
use super::run::Run;
use super::target;
use crate::Error;
use crate::dataset::View;

/// Renders a view and adds up its loss: the photometric term, the method's terms, then the extensions' in their order.
///
/// # Errors
/// When an image can't be read or a shape does not fit.
pub(super) fn forward<M: Method>(
    run: &mut Run<M>,
    hooks: &mut Hooks<M>,
    view: &View,
) -> Result<Forward, Error> {
    let camera = &view.camera;
    let (static_splats, motion) = match M::moved(run, view)? {
        None => (run.scene.static_splats(camera)?, None),
        Some(moved) => {
            let splats = run.scene.static_splats_at(moved.means, camera)?;
            (splats, Some(moved.motion))
        }
    };
    let (dynamic_splats, terms) = M::dynamic_splats(run, view)?;
    let of_static = static_splats.clone().inner();
    let of_dynamic = dynamic_splats.clone().map(Tensor::inner);
    let mut splats = static_splats;
    if let Some(dynamic) = dynamic_splats {
        splats = join_rows(splats, dynamic)?;
    }
    let leaf = Tensor::<2>::empty([1, 1], &run.device).require_grad();
    splats = tap(splats, leaf.clone());
    if let Some(backdrop) = &run.backdrop {
        splats = join_rows(splats, Tensor::from_inner(backdrop.splats(camera)?))?;
    }
    for extension in &mut hooks.extensions {
        splats = extension.splats(run, splats);
    }
    let image = run.scene.rasterize(splats, camera)?.image;
    let (image, target, target_on_host) = with_target(run, image, view)?;
    // Eqs. 6 and 12 without regularisers.
    let judged = photometric(image.clone(), target.clone(), run.config.dssim)?;
    let mut forward = Forward {
        loss: judged.loss,
        mse: judged.mse,
        image,
        target,
        target_on_host,
        static_splats: of_static,
        dynamic_splats: of_dynamic,
        leaf,
        motion,
    };
    let mut terms = terms;
    terms.extend(M::loss_terms(run, view, &forward)?);
    for extension in &mut hooks.extensions {
        terms.extend(extension.loss_terms(run, view, &forward)?);
    }
    for term in terms {
        forward.loss = forward.loss + term;
    }
    Ok(forward)
}

/// A picture and that of its view, zero where pixels don't count, and the latter on the host unless it went to the
/// device as bytes.
type Targets = (Tensor<3>, Tensor<3>, Option<Vec<f32>>);

fn with_target<M>(run: &Run<M>, image: Tensor<3>, view: &View) -> Result<Targets, Error> {
    if let Some(target) = target::as_bytes(view, &run.device)? {
        return Ok((image, target, None));
    }
    let camera = &view.camera;
    let (on_host, counted) = view.rgb_and_counted(run.scene.settings.background)?;
    let target = TensorData::new(on_host.clone(), [camera.height, camera.width, 3]);
    let target = Tensor::<3>::from_data(target, &run.device);
    let (image, target) = match counted {
        None => (image, target),
        Some(counted) => where_counted(image, target, counted),
    };
    Ok((image, target, Some(on_host)))
}

#[cfg(test)]
mod tests;
