//! Projection of Gaussians with colours of SH degree 3, forward and backward.

mod scene;

use dash_kernels::project::cpu;
use divan::Bencher;
use scene::{SIZES, Scene, Size};

fn main() {
    divan::main();
}

#[divan::bench(args = SIZES)]
fn forward(bencher: Bencher, size: Size) {
    let scene = Scene::new(size);
    bencher.bench(|| cpu::project(&scene.gaussians(), &scene.view));
}

#[divan::bench(args = SIZES)]
fn backward(bencher: Bencher, size: Size) {
    let scene = Scene::new(size);
    let splats = cpu::project(&scene.gaussians(), &scene.view);
    let v_splats = vec![0.5; splats.len()];
    bencher.bench(|| cpu::project_vjp(&scene.gaussians(), &scene.view, &splats, &v_splats, true));
}
