//! What the pass of one of a step's views leaves.

use burn::tensor::{Gradients, Tensor};

use super::forward::Forward;
use super::gradient_visit::InOrder;
use super::method::Method;
use super::run::Run;
use super::sets::Set;
use super::view_sums::ViewSums;
use crate::Error;
use crate::dataset::View;

/// See the module.
pub(super) struct ViewPass {
    /// The view's loss and mean squared error.
    pub(super) losses: [Tensor<1>; 2],
    /// The gradients of its share of the step's loss; none where it is the only view.
    pub(super) gradients: InOrder,
    pub(super) statistics: Statistics,
    /// What the method sums over views `[N, 2]`.
    pub(super) of_method: Option<Tensor<2>>,
}

/// What density control gathers of a view.
pub(super) enum Statistics {
    /// What the sums are made of.
    Splats(Box<Splats>),
    /// Sums of the sets.
    Sums(Box<[ViewSums; 2]>),
}

/// Splats of the sets, and the gradient of both together.
pub(super) struct Splats {
    of_static: Tensor<2>,
    of_dynamic: Option<Tensor<2>>,
    gradient: Option<Tensor<2>>,
}

impl ViewPass {
    /// Of a view whose backward pass is done.
    pub(super) fn new<M: Method>(
        run: &Run<M>,
        view: &View,
        forward: Forward,
        gradients: &mut Gradients,
    ) -> Self {
        Self {
            losses: [forward.loss, forward.mse].map(Tensor::inner),
            gradients: InOrder::new(),
            of_method: M::statistics(run, view, &forward.static_splats),
            statistics: Statistics::Splats(Box::new(Splats {
                of_static: forward.static_splats,
                of_dynamic: forward.dynamic_splats,
                gradient: forward.leaf.grad_remove(gradients),
            })),
        }
    }
}

impl Statistics {
    /// Adds what density control needs of a view of a step of so many.
    ///
    /// # Errors
    /// When shapes differ.
    pub(super) fn add_to(
        self,
        sums: [&mut ViewSums; 2],
        view: &View,
        views: usize,
    ) -> Result<(), Error> {
        let splats = match self {
            Self::Splats(splats) => *splats,
            Self::Sums(more) => {
                for (sums, more) in sums.into_iter().zip(*more) {
                    sums.merge(more);
                }
                return Ok(());
            }
        };
        let Some(gradient) = splats.gradient else {
            return Ok(());
        };
        // That of the view's own loss.
        let gradient = match views {
            1 => gradient,
            views => gradient * views as f32,
        };
        let camera = &view.camera;
        let half_size = [camera.width as f32 / 2.0, camera.height as f32 / 2.0];
        let [static_sums, dynamic_sums] = sums;
        let n_static = splats.of_static.dims()[0];
        static_sums.add_gradients(gradient.clone(), 0, splats.of_static, half_size)?;
        match splats.of_dynamic {
            None => Ok(()),
            Some(of_dynamic) => {
                dynamic_sums.add_gradients(gradient, n_static, of_dynamic, half_size)
            }
        }
    }
}

impl<M: Method> Run<M> {
    /// The sums of both sets.
    pub(super) fn gathered(&mut self) -> [&mut ViewSums; 2] {
        let sets = [&mut self.static_state, &mut self.dynamic_state];
        sets.map(|state| &mut state.gathered)
    }

    /// Sums of no view, of as many Gaussians as both sets have.
    pub(super) fn no_sums(&self) -> [ViewSums; 2] {
        Set::BOTH.map(|set| {
            let n = self.gaussians(set).map_or(0, |gaussians| gaussians.len());
            ViewSums::new(n, &self.device)
        })
    }
}
