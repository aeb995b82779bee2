//! A monocular capture in the D-NeRF layout (`transforms_*.json` with a time for every image): takes
//! the training steps one by one, scores the test views, and writes the scene from one test camera
//! at five instants.
//!
//! `cargo run --release --example d_nerf -- [FOLDER OUT [DOWNSCALE]]`

mod common;

use std::sync::Arc;

use common::{Failure, print_scores, print_step, task};
use dash_train::dataset::{self, LoadOptions, Partition};
use dash_train::evaluate::evaluate;
use dash_train::process;
use dash_train::render::{
    PictureFormat, PictureLayer, RenderJob, at_times, test_shots, write_pictures,
};
use dash_train::synth::SynthLayout;
use dash_train::train::Trainer;

fn main() -> Result<(), Failure> {
    process::run(run)
}

fn run() -> Result<(), Failure> {
    let task = task(SynthLayout::Blender)?;
    let downscale = task.config.downscale;
    let options = LoadOptions {
        layout: task.config.layout,
        downscale,
        ..Default::default()
    };
    let dataset = Arc::new(dataset::load(&task.folder, &options)?);
    let device = task.config.device.device()?;
    let mut trainer = Trainer::new(task.config.train, dataset.clone(), &device)?;
    while !trainer.is_finished() {
        print_step(&trainer.step()?, 0.0);
    }
    let scene = trainer.scene();
    let scores = evaluate(
        scene,
        &dataset,
        Partition::Test,
        downscale,
        &Default::default(),
    )?;
    print_scores(Some(&scores));

    let shots = at_times(&test_shots(&dataset)[..1], 5);
    let job = RenderJob {
        scene,
        shots: &shots,
        on_shot: &mut |_| {},
    };
    let layers = [PictureLayer::Full, PictureLayer::Dynamic];
    write_pictures(job, &layers, PictureFormat::Png, &task.run)?;
    Ok(())
}
