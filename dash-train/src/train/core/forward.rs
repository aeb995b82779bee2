//! What a forward pass leaves.

use std::cell::OnceCell;

use burn::tensor::{Device, Tensor};
use dash_kernels::Camera;

use super::coverage::Coverage;
use super::optimizer::to_host;

/// Packed splats of a set in a view, and a zero leaf whose gradient is theirs.
pub struct Probe {
    /// Added to the splats `[N, C]`.
    pub leaf: Tensor<2>,
    /// The splats, row by row.
    pub splats: Vec<f32>,
    camera: Camera,
    coverage: OnceCell<Coverage>,
}

impl Probe {
    pub(super) fn new(splats: &Tensor<2>, camera: &Camera, device: &Device) -> Self {
        Self {
            leaf: Tensor::zeros(splats.dims(), device).require_grad(),
            splats: to_host(splats.clone()),
            camera: camera.clone(),
            coverage: OnceCell::new(),
        }
    }

    /// What the view shows of each Gaussian.
    pub fn coverage(&self) -> &Coverage {
        self.coverage
            .get_or_init(|| Coverage::of(&self.splats, &self.camera))
    }
}

/// What a forward pass leaves for loss terms, the backward pass and statistics.
pub struct Forward {
    /// The whole loss.
    pub loss: Tensor<1>,
    /// Mean squared error of the picture.
    pub mse: Tensor<1>,
    /// The picture `[H, W, 5]`: RGB, alpha, depth; black where pixels don't count.
    pub image: Tensor<3>,
    /// The captured picture `[H, W, 3]`; black where pixels don't count.
    pub target: Tensor<3>,
    /// The captured picture `[H, W, 3]` on the host, where it was needed there.
    pub target_on_host: Option<Vec<f32>>,
    /// The static set.
    pub static_probe: Probe,
    /// The dynamic set, if there is one.
    pub dynamic_probe: Option<Probe>,
    /// How far the method moves each static Gaussian over the clip `[N]`, world units.
    pub motion: Option<Tensor<1>>,
}
