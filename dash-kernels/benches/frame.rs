//! A whole frame on tensors: projection and rasterization, forward and backward, on every backend
//! of the build. The clock stops after the device has.

mod scene;

use std::time::Instant;

use burn::tensor::{Device, Tensor, TensorData};
use dash_kernels::Camera;
use dash_kernels::project::{Activation, ProjectOptions, project};
use dash_kernels::rasterize::{RasterizeOptions, rasterize};
use scene::{SIZES, Scene, Size};

/// Repetitions of which the median counts.
const REPETITIONS: usize = 7;

fn main() {
    // `cargo bench` passes flags of its own; a word picks the backends whose names hold it.
    let wanted = std::env::args().skip(1).find(|arg| !arg.starts_with('-'));
    for (name, device) in scene::devices() {
        if wanted
            .as_ref()
            .is_some_and(|wanted| !name.contains(wanted.as_str()))
        {
            continue;
        }
        for size in SIZES {
            let (forward, both) = Frame::new(size, &device).times();
            println!("{name:8} {size:24} forward {forward:8.2} ms, with backward {both:8.2} ms");
        }
    }
}

struct Frame {
    camera: Camera,
    options: RasterizeOptions,
    means: Tensor<2>,
    quats: Tensor<2>,
    scales: Tensor<2>,
    opacities: Tensor<1>,
    sh_coeffs: Tensor<3>,
    device: Device,
}

impl Frame {
    fn new(size: Size, device: &Device) -> Self {
        let Size(n, width, height, _) = size;
        let scene = Scene::new(size);
        let g = scene.gaussians();
        let data =
            |values: &[f32], shape: &[usize]| TensorData::new(values.to_vec(), shape.to_vec());
        Self {
            camera: scene.camera.clone(),
            options: RasterizeOptions {
                width,
                height,
                background: [0.0; 3],
            },
            means: Tensor::from_data(data(g.means, &[n, 3]), device),
            quats: Tensor::from_data(data(g.quats, &[n, 4]), device),
            scales: Tensor::from_data(data(g.scales, &[n, 3]), device),
            opacities: Tensor::from_data(data(g.opacities, &[n]), device),
            sh_coeffs: Tensor::from_data(data(g.sh_coeffs, &[n, 16, 3]), device),
            device: device.clone(),
        }
    }

    /// Milliseconds of the forward pass, and of both.
    fn times(&self) -> (f64, f64) {
        let forward = self.median(|| {
            self.image(
                self.means.clone(),
                self.quats.clone(),
                self.scales.clone(),
                self.opacities.clone(),
                self.sh_coeffs.clone(),
            );
        });
        let means = self.means.clone().autodiff().require_grad();
        let quats = self.quats.clone().autodiff().require_grad();
        let scales = self.scales.clone().autodiff().require_grad();
        let opacities = self.opacities.clone().autodiff().require_grad();
        let sh_coeffs = self.sh_coeffs.clone().autodiff().require_grad();
        let both = self.median(|| {
            let image = self.image(
                means.clone(),
                quats.clone(),
                scales.clone(),
                opacities.clone(),
                sh_coeffs.clone(),
            );
            drop(image.sum().backward());
        });
        (forward, both)
    }

    fn image(
        &self,
        means: Tensor<2>,
        quats: Tensor<2>,
        scales: Tensor<2>,
        opacities: Tensor<1>,
        sh_coeffs: Tensor<3>,
    ) -> Tensor<3> {
        let options = ProjectOptions {
            activation: Activation::Linear,
            ..ProjectOptions::default()
        };
        let splats = project(
            means,
            quats,
            scales,
            opacities,
            sh_coeffs,
            &self.camera,
            &options,
        );
        rasterize(splats.expect("a good scene"), &self.options).expect("a good size")
    }

    fn median(&self, work: impl Fn()) -> f64 {
        let mut times: Vec<f64> = (0..REPETITIONS + 2)
            .map(|_| {
                let start = Instant::now();
                work();
                self.device.sync().expect("the device answers");
                start.elapsed().as_secs_f64() * 1e3
            })
            // The first runs compile kernels and find the lists' capacity.
            .skip(2)
            .collect();
        times.sort_by(f64::total_cmp);
        times[REPETITIONS / 2]
    }
}
