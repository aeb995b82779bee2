//! Rasterization from packed splats: sorting and blending, forward and backward.

mod scene;

use dash_kernels::project::cpu::project;
use dash_kernels::rasterize::{RasterizeOptions, cpu};
use divan::Bencher;
use scene::{SIZES, Scene, Size};

fn main() {
    divan::main();
}

fn options(Size(_, width, height, _): Size) -> RasterizeOptions {
    RasterizeOptions {
        width,
        height,
        background: [0.0; 3],
    }
}

#[divan::bench(args = SIZES)]
fn forward(bencher: Bencher, size: Size) {
    let scene = Scene::new(size);
    let splats = project(&scene.gaussians(), &scene.view);
    bencher.bench(|| cpu::rasterize(&splats, &options(size)));
}

#[divan::bench(args = SIZES)]
fn backward(bencher: Bencher, size: Size) {
    let scene = Scene::new(size);
    let splats = project(&scene.gaussians(), &scene.view);
    let (image, saved) = cpu::rasterize_saving(&splats, &options(size));
    let v_image: Vec<f32> = (0..image.len())
        .map(|i| if i % 3 == 0 { 1.0 } else { -1.0 })
        .collect();
    bencher.bench(|| cpu::rasterize_vjp(&saved, &v_image));
}
