//! A set of Gaussians fitted to pictures with Burn's own optimizer: `Gaussians`, `project`,
//! `rasterize` and a loss, without a trainer.
//!
//! `cargo run --release --example fit_gaussians`

use burn::optim::{AdamConfig, GradientsParams};
use burn::tensor::{Device, Tensor, TensorData};
use dash_kernels::photometric::photometric;
use dash_kernels::project::project;
use dash_kernels::rasterize::{RasterizeOptions, rasterize};
use dash_kernels::{Camera, KernelError};
use dash_model::{GaussianRows, Gaussians};
use dash_train::synth::{Scene, SceneKind, cloud, render, rig};

const WIDTH: usize = 80;
const HEIGHT: usize = 60;

/// The picture `[H, W, 5]` (red, green, blue, alpha, depth) that a camera takes of a set.
fn picture(set: &Gaussians, camera: &Camera) -> Result<Tensor<3>, KernelError> {
    let splats = project(
        set.means.val(),
        set.quats.val(),
        set.log_scales.val(),
        set.opacity_logits.val(),
        set.sh_coeffs(),
        camera,
        &Default::default(),
    )?;
    let options = RasterizeOptions {
        width: camera.width,
        height: camera.height,
        background: [0.0; 3],
    };
    rasterize(splats, &options)
}

fn main() -> Result<(), KernelError> {
    let device = Device::flex().autodiff();
    // Ray-traced pictures and a noisy point cloud take a capture's place.
    let (room, cameras) = (
        Scene::new(SceneKind::Static, 0, WIDTH, HEIGHT),
        rig(8, WIDTH, HEIGHT),
    );
    let targets = cameras.iter().map(|camera| {
        let rgb = render(&room, camera, 0.0).rgb.into_iter();
        let values: Vec<f32> = rgb.map(|byte| f32::from(byte) / 255.0).collect();
        Tensor::<3>::from_data(TensorData::new(values, [HEIGHT, WIDTH, 3]), &device)
    });
    let targets: Vec<_> = targets.collect();
    let points = cloud(&room, &cameras, 2000, 0);
    let positions: Vec<_> = points.iter().map(|p| [p.x, p.y, p.z]).collect();
    let colors: Vec<_> = points
        .iter()
        .map(|p| [p.red, p.green, p.blue].map(|v| f32::from(v) / 255.0))
        .collect();
    let rows = GaussianRows::from_points(&positions, &colors, 0, 0.05);
    let mut set = Gaussians::from_rows(&rows, &device);

    let mut optimizer = AdamConfig::new().init();
    for step in 0..=400 {
        // Camera 0 is held out.
        let view = if step % 100 == 0 {
            0
        } else {
            1 + step % (cameras.len() - 1)
        };
        let found = photometric(picture(&set, &cameras[view])?, targets[view].clone(), 0.2)?;
        if view == 0 {
            let mse: f32 = found.mse.into_scalar();
            println!(
                "step {step:3}   held-out camera {:5.2} dB",
                -10.0 * mse.log10()
            );
            continue;
        }
        let gradients = GradientsParams::from_grads(found.loss.backward(), &set);
        set = optimizer.step(5e-3, set, gradients);
    }
    Ok(())
}
