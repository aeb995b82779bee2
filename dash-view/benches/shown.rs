//! What showing a picture costs beside drawing it: the kernels alone, and the picture as the window takes it. That is a
//! texture where wgpu draws, which stays on the GPU, and 8 bits in host memory elsewhere.
//!
//! `cargo bench -p dash-view --bench shown [-- BACKEND]`

use std::time::Instant;

use burn::tensor::{Device, DeviceKind};
use dash_kernels::Camera;
use dash_kernels::testing::named_devices;
use dash_model::{DynamicScene, GaussianRows, Gaussians, SceneSettings};
use dash_view::Screen;
use dash_view::draw::{SpeedColors, ViewLayer, show};
use rand::{Rng, SeedableRng};

const N_GAUSSIANS: usize = 100_000;
const SIZES: [[usize; 2]; 2] = [[1352, 1014], [1920, 1080]];
const REPEATS: usize = 7;

fn main() {
    // `cargo bench` passes flags of its own; a word picks the backends whose names hold it.
    let wanted = std::env::args().skip(1).find(|arg| !arg.starts_with('-'));
    let wanted = wanted.unwrap_or_default();
    // Before anything else opens the adapter. A build without wgpu, or a machine without an adapter, has none.
    let screen = Screen::open(DeviceKind::DefaultDevice).ok();
    for (name, device) in named_devices() {
        if !name.contains(&wanted) {
            continue;
        }
        let scene = scene(&device);
        for [width, height] in SIZES {
            let camera = Camera::new(
                width as f64,
                width as f64,
                0.5 * width as f64,
                0.5 * height as f64,
                width,
                height,
            );
            let kernels = median(|| {
                let picture = scene.render(&camera, 0.0).expect("renders");
                device.sync().expect("the device works");
                drop(picture);
            });
            let shown = median(|| {
                let colors = SpeedColors::new(0.0, 1);
                let shown = show(&scene, &camera, 0.0, ViewLayer::Full, &colors).expect("draws");
                let texture = screen.as_ref().map(|(_, screen)| screen.texture(&shown));
                match texture.transpose().expect("copies").flatten() {
                    Some(texture) => drop(texture),
                    None => drop(shown.frame().expect("copies")),
                }
            });
            println!(
                "{name:8} {width}x{height} kernels {kernels:8.2} ms, shown {shown:8.2} ms, {:.3}x",
                shown / kernels
            );
        }
    }
}

/// Gaussians a few pixels large in front of a camera.
fn scene(device: &Device) -> DynamicScene {
    let mut rng = rand_pcg::Pcg64::seed_from_u64(1);
    let mut near = |low: f32, high: f32| rng.random_range(low..high);
    let points: Vec<[f32; 3]> = (0..N_GAUSSIANS)
        .map(|_| {
            let z = near(3.0, 9.0);
            [near(-0.5, 0.5) * z, near(-0.4, 0.4) * z, z]
        })
        .collect();
    let colors: Vec<[f32; 3]> = points
        .iter()
        .map(|_| std::array::from_fn(|_| near(0.0, 1.0)))
        .collect();
    let mut rows = GaussianRows::from_points(&points, &colors, 1, 0.02);
    for (scales, logit) in rows.log_scales.iter_mut().zip(&mut rows.opacity_logits) {
        *scales = std::array::from_fn(|_| near(-5.0, -3.7));
        *logit = near(-2.0, 3.0);
    }
    DynamicScene {
        static_set: Gaussians::from_rows(&rows, device),
        dynamic: None,
        settings: SceneSettings::default(),
    }
}

/// Milliseconds, after a first run that is not counted.
fn median(mut work: impl FnMut()) -> f64 {
    work();
    let mut times: Vec<f64> = (0..REPEATS)
        .map(|_| {
            let start = Instant::now();
            work();
            1e3 * start.elapsed().as_secs_f64()
        })
        .collect();
    times.sort_by(f64::total_cmp);
    times[REPEATS / 2]
}
