//! Random Gaussians as tensors.

use burn::tensor::{Device, Tensor, TensorData};
use dash_kernels::Camera;
use dash_kernels::project::{Activation, ProjectOptions, ShCoeffs, project};
use rand::{Rng, SeedableRng};
use rand_pcg::Pcg64;

use super::{N_COEFFS, Size};

/// Gaussians of a few pixels all over an image, with colours of SH degree 3.
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
    pub fn new(device: &Device, Size(n, width, height, sigma_px): Size) -> Self {
        let camera = Camera::from_fov_x(60f64.to_radians(), width, height);
        let focal = camera.fx as f32;
        let (half_width, half_height) = (width as f32 / 2.0, height as f32 / 2.0);
        let mut rng = Pcg64::seed_from_u64(7);
        let mut rows: [Vec<f32>; 6] = Default::default();
        let [means, quats, scales, opacities, sh_dc, sh_rest] = &mut rows;
        for _ in 0..n {
            let z: f32 = rng.random_range(2.0..6.0);
            means.extend([
                rng.random_range(-1.05..1.05) * z * half_width / focal,
                rng.random_range(-1.05..1.05) * z * half_height / focal,
                z,
            ]);
            let size = sigma_px * z / focal;
            scales.extend((0..3).map(|_| size * (0.6 * normal(&mut rng)).exp()));
            quats.extend((0..4).map(|_| normal(&mut rng)));
            opacities.push(rng.random_range(0.05..0.95));
            sh_dc.extend((0..3).map(|_| 0.8 * normal(&mut rng)));
            sh_rest.extend((3..3 * N_COEFFS).map(|_| 0.05 * normal(&mut rng)));
        }
        let [means, quats, scales, opacities, sh_dc, sh_rest] = rows;
        Self {
            camera,
            means: tensor(means, [n, 3], device),
            quats: tensor(quats, [n, 4], device),
            scales: tensor(scales, [n, 3], device),
            opacities: tensor(opacities, [n], device),
            sh_coeffs: ShCoeffs {
                dc: tensor(sh_dc, [n, 1, 3], device),
                rest: tensor(sh_rest, [n, N_COEFFS - 1, 3], device),
            },
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

/// Close enough to a normal distribution here: the sum of twelve uniform values.
fn normal(rng: &mut Pcg64) -> f32 {
    (0..12).map(|_| rng.random::<f32>()).sum::<f32>() - 6.0
}

fn tensor<const R: usize>(values: Vec<f32>, shape: [usize; R], device: &Device) -> Tensor<R> {
    Tensor::from_data(TensorData::new(values, shape), device)
}
