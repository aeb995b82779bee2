//! A capture in the Technicolor layout (`cameras_parameters.txt` and one image per camera and
//! frame): trains, scores `cam10`, which the layout holds out, and writes what is dynamic and how
//! far everything is as that camera sees it.
//!
//! `cargo run --release --example technicolor -- [FOLDER RUN [DOWNSCALE]]`

mod common;

use common::{Failure, print_scores, print_step, task};
use dash_train::process;
use dash_train::reconstruct::reconstruct;
use dash_train::render::{PictureFormat, PictureLayer, RenderJob, test_shots, write_pictures};
use dash_train::synth::SynthLayout;

fn main() -> Result<(), Failure> {
    process::run(run)
}

fn run() -> Result<(), Failure> {
    let task = task(SynthLayout::Technicolor)?;
    let done = reconstruct(&task.folder, &task.run, &task.config, &mut print_step)?;
    print_scores(done.scores());

    let job = RenderJob {
        scene: &done.scene,
        shots: &test_shots(&done.dataset),
        on_shot: &mut |_| {},
    };
    let layers = [PictureLayer::Dynamic, PictureLayer::Depth];
    // Floats: depth in world units.
    write_pictures(job, &layers, PictureFormat::Exr, &task.run.join("renders"))?;
    Ok(())
}
