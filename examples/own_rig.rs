//! Videos of a rig of your own (`videos/NAME.mp4`, and poses by these names in `transforms.json` or a
//! COLMAP model): says what is wrong with the folder, and where nothing is, trains and scores
//! the camera that is held out.
//!
//! `cargo run --release --example own_rig -- [FOLDER RUN [DOWNSCALE]]`

mod common;

use common::{Failure, print_scores, print_step, task};
use dash_train::dataset::LoadOptions;
use dash_train::doctor::{Severity, examine};
use dash_train::process;
use dash_train::reconstruct::reconstruct;
use dash_train::synth::SynthLayout;

fn main() -> Result<(), Failure> {
    process::run(run)
}

fn run() -> Result<(), Failure> {
    let task = task(SynthLayout::Rig)?;
    let options = LoadOptions {
        layout: task.config.layout,
        downscale: task.config.downscale,
        ..Default::default()
    };
    let diagnosis = examine(&task.folder, &options, None);
    for finding in &diagnosis.findings {
        println!("{finding}");
    }
    if diagnosis.worst == Severity::Error {
        return Err("this folder cannot be trained on".into());
    }
    let done = reconstruct(&task.folder, &task.run, &task.config, &mut print_step)?;
    print_scores(done.scores());
    Ok(())
}
