//! A capture in the Neural 3D Video layout (`poses_bounds.npy` with one folder of images or one
//! video per camera): trains, scores camera 0, and writes a video along a path between the cameras.
//!
//! `cargo run --release --example neural_3d_video -- [FOLDER RUN [DOWNSCALE]]`

mod common;

use common::{Failure, print_scores, print_step, task};
use dash_train::process;
use dash_train::reconstruct::reconstruct;
use dash_train::render::{PictureLayer, RenderJob, spiral_shots, write_video};
use dash_train::synth::SynthLayout;

fn main() -> Result<(), Failure> {
    process::run(run)
}

fn run() -> Result<(), Failure> {
    let mut task = task(SynthLayout::N3dv)?;
    task.config.test_cameras = Some(vec![0]);
    // The quick preset with more Gaussians: some minutes on a CPU at a small size.
    task.config
        .train
        .set("densify.static.max_gaussians=20000")?;
    let done = reconstruct(&task.folder, &task.run, &task.config, &mut print_step)?;
    print_scores(done.scores());

    let shots = spiral_shots(&done.dataset, done.dataset.n_frames.max(2));
    let job = RenderJob {
        scene: &done.scene,
        shots: &shots,
        on_shot: &mut |_| {},
    };
    write_video(job, PictureLayer::Full, 30.0, &task.run.join("spiral.mp4"))?;
    Ok(())
}
