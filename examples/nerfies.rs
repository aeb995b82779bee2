//! A monocular capture in the layout of Nerfies and HyperNeRF (`dataset.json`, `camera/`,
//! `rgb/1x/`): trains, scores the views that `dataset.json` holds out, and freezes time: a video of
//! the scene's middle instant along a path between the cameras.
//!
//! `cargo run --release --example nerfies -- [FOLDER RUN [DOWNSCALE]]`

mod common;

use common::{Failure, print_scores, print_step, task};
use dash_train::process;
use dash_train::reconstruct::reconstruct;
use dash_train::render::{PictureLayer, RenderJob, Shot, spiral_shots, write_video};
use dash_train::synth::SynthLayout;

fn main() -> Result<(), Failure> {
    process::run(run)
}

fn run() -> Result<(), Failure> {
    let task = task(SynthLayout::Nerfies)?;
    let done = reconstruct(&task.folder, &task.run, &task.config, &mut print_step)?;
    print_scores(done.scores());

    let frozen: Vec<Shot> = spiral_shots(&done.dataset, 30)
        .into_iter()
        .map(|shot| Shot { time: 0.5, ..shot })
        .collect();
    let job = RenderJob {
        scene: &done.scene,
        shots: &frozen,
        on_shot: &mut |_| {},
    };
    write_video(job, PictureLayer::Full, 30.0, &task.run.join("frozen.mp4"))?;
    Ok(())
}
