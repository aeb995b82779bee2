//! Scenes of the project's yardsticks: Gaussians of about two or three pixels all over an image.

#![allow(dead_code, reason = "each benchmark uses a part of it")]

pub mod clock;
pub mod tensors;

use burn::tensor::Device;
use dash_kernels::Camera;
use dash_kernels::project::{self, Activation, ProjectOptions, View};
use rand::{Rng, SeedableRng};
use rand_pcg::Pcg64;

/// Number of Gaussians and image size of each benchmark.
pub const SIZES: [Size; 3] = [
    Size(10_000, 320, 240, 2.0),
    Size(50_000, 320, 240, 2.0),
    Size(100_000, 1352, 1014, 3.0),
];

/// Colour coefficients of a channel.
pub const N_COEFFS: usize = 16;

/// Gaussians, image width and height, and standard deviation in pixels.
#[derive(Debug, Clone, Copy)]
pub struct Size(pub usize, pub usize, pub usize, pub f32);

impl std::fmt::Display for Size {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{} at {} x {}", self.0, self.1, self.2)
    }
}

#[cfg_attr(
    feature = "ndarray",
    expect(deprecated, reason = "supported while it exists")
)]
/// The backends of the build by name.
pub fn devices() -> Vec<(&'static str, Device)> {
    vec![
        #[cfg(feature = "ndarray")]
        ("ndarray", Device::ndarray()),
        #[cfg(feature = "flex")]
        ("flex", Device::flex()),
        #[cfg(feature = "wgpu")]
        (
            "wgpu",
            Device::wgpu(burn::tensor::DeviceKind::DefaultDevice),
        ),
        #[cfg(feature = "cuda")]
        ("cuda", Device::cuda(0)),
    ]
}

/// Gaussians seen by [`view`](Scene::view), with colours of SH degree 3.
pub struct Scene {
    means: Vec<f32>,
    quats: Vec<f32>,
    scales: Vec<f32>,
    opacities: Vec<f32>,
    pub sh_dc: Vec<f32>,
    pub sh_rest: Vec<f32>,
    pub view: View<f32>,
    pub camera: Camera,
}

impl Scene {
    pub fn new(Size(n, width, height, sigma_px): Size) -> Self {
        let mut rng = Pcg64::seed_from_u64(7);
        let (half_width, half_height) = (width as f32 / 2.0, height as f32 / 2.0);
        let focal = half_width / 30f32.to_radians().tan();
        let camera = Camera::new(
            f64::from(focal),
            f64::from(focal),
            f64::from(half_width),
            f64::from(half_height),
            width,
            height,
        );
        let mut scene = Self {
            means: Vec::new(),
            quats: Vec::new(),
            scales: Vec::new(),
            opacities: Vec::new(),
            sh_dc: Vec::new(),
            sh_rest: Vec::new(),
            view: View::new(
                &camera,
                &ProjectOptions {
                    activation: Activation::Linear,
                    ..ProjectOptions::default()
                },
                3,
            ),
            camera,
        };
        // Close enough to a normal distribution here: the sum of twelve uniform ones.
        let normal = |rng: &mut Pcg64| (0..12).map(|_| rng.random::<f32>()).sum::<f32>() - 6.0;
        for _ in 0..n {
            let z: f32 = rng.random_range(2.0..6.0);
            scene.means.extend([
                rng.random_range(-1.05..1.05) * z * half_width / focal,
                rng.random_range(-1.05..1.05) * z * half_height / focal,
                z,
            ]);
            let size = sigma_px * z / focal;
            scene
                .scales
                .extend((0..3).map(|_| size * (0.6 * normal(&mut rng)).exp()));
            scene.quats.extend((0..4).map(|_| normal(&mut rng)));
            scene.opacities.push(rng.random_range(0.05..0.95));
            scene.sh_dc.extend((0..3).map(|_| 0.8 * normal(&mut rng)));
            scene
                .sh_rest
                .extend((3..48).map(|_| 0.05 * normal(&mut rng)));
        }
        scene
    }

    pub fn gaussians(&self) -> project::Gaussians<'_, f32> {
        project::Gaussians {
            means: &self.means,
            quats: &self.quats,
            scales: &self.scales,
            opacities: &self.opacities,
            sh_coeffs: project::ShSlices::apart(&self.sh_dc, &self.sh_rest, N_COEFFS),
        }
    }
}
