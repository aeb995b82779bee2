//! The Gaussians of a scene as tensors.

use burn::tensor::{Device, Tensor, TensorData};
use dash_kernels::Camera;
use dash_kernels::project::{Activation, ProjectOptions, ShCoeffs, project};

use super::{N_COEFFS, Scene, Size};

/// The inputs of a projection as tensors.
#[derive(Clone)]
pub struct Gaussians {
    camera: Camera,
    means: Tensor<2>,
    quats: Tensor<2>,
    scales: Tensor<2>,
    opacities: Tensor<1>,
    sh_coeffs: ShCoeffs,
}

impl Gaussians {
    pub fn new(device: &Device, size: Size) -> Self {
        let scene = Scene::new(size);
        let n = size.0;
        let g = scene.gaussians();
        let data =
            |values: &[f32], shape: &[usize]| TensorData::new(values.to_vec(), shape.to_vec());
        Self {
            means: Tensor::from_data(data(g.means, &[n, 3]), device),
            quats: Tensor::from_data(data(g.quats, &[n, 4]), device),
            scales: Tensor::from_data(data(g.scales, &[n, 3]), device),
            opacities: Tensor::from_data(data(g.opacities, &[n]), device),
            sh_coeffs: ShCoeffs {
                dc: Tensor::from_data(data(&scene.sh_dc, &[n, 1, 3]), device),
                rest: Tensor::from_data(data(&scene.sh_rest, &[n, N_COEFFS - 1, 3]), device),
            },
            camera: scene.camera,
        }
    }

    /// The same, with gradients asked for.
    pub fn autodiff(self) -> Self {
        Self {
            means: self.means.autodiff().require_grad(),
            quats: self.quats.autodiff().require_grad(),
            scales: self.scales.autodiff().require_grad(),
            opacities: self.opacities.autodiff().require_grad(),
            sh_coeffs: ShCoeffs {
                dc: self.sh_coeffs.dc.autodiff().require_grad(),
                rest: self.sh_coeffs.rest.autodiff().require_grad(),
            },
            camera: self.camera,
        }
    }

    /// Their splats.
    pub fn project(&self) -> Tensor<2> {
        let options = ProjectOptions {
            activation: Activation::Linear,
            ..ProjectOptions::default()
        };
        project(
            self.means.clone(),
            self.quats.clone(),
            self.scales.clone(),
            self.opacities.clone(),
            self.sh_coeffs.clone(),
            &self.camera,
            &options,
        )
        .expect("a good scene")
    }
}
