//! A monocular capture in the D-NeRF layout (`transforms_*.json` with a time for every image): trains
//! in memory, scores the test views, then freezes time and writes the scene from the first test
//! camera at five instants, with the layer of what moves beside it.
//!
//! `cargo run --release --example d_nerf -- FOLDER OUT [DOWNSCALE]`

use std::path::Path;
use std::sync::Arc;

use dash_train::dataset::{self, Layout, LoadOptions, Partition};
use dash_train::device::DeviceChoice;
use dash_train::evaluate::evaluate;
use dash_train::process;
use dash_train::render::{
    PictureFormat, PictureLayer, RenderJob, at_times, test_shots, write_pictures,
};
use dash_train::train::{Preset, TrainConfig, Trainer};

type Failure = Box<dyn std::error::Error + Send + Sync>;

fn main() -> Result<(), Failure> {
    process::prepare();
    // On a thread of the pool: from outside, every parallel loop would wake one and wait for it.
    rayon::scope(|_| run())
}

fn run() -> Result<(), Failure> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [folder, out, rest @ ..] = arguments.as_slice() else {
        return Err("expected FOLDER OUT [DOWNSCALE]".into());
    };
    let options = LoadOptions {
        layout: Some(Layout::Blender),
        downscale: rest.first().map_or(Ok(4.0), |factor| factor.parse())?,
        ..Default::default()
    };
    let dataset = Arc::new(dataset::load(Path::new(folder), &options)?);
    let device = DeviceChoice::Auto.device()?;
    let config = TrainConfig::preset(Preset::Quick);
    let mut trainer = Trainer::new(config, dataset.clone(), &device)?;
    while !trainer.is_finished() {
        let report = trainer.step()?;
        if report.step.is_multiple_of(500) {
            let (n_static, n_dynamic) = (report.n_static, report.n_dynamic);
            println!(
                "step {:6}  {:5.2} dB  {n_static} static, {n_dynamic} dynamic",
                report.step, report.psnr
            );
        }
    }
    let scene = trainer.scene();
    let scores = evaluate(
        scene,
        &dataset,
        Partition::Test,
        options.downscale,
        &Default::default(),
    )?;
    println!(
        "{} test views: PSNR {:.2} dB, SSIM {:.3}",
        scores.per_view.len(),
        scores.psnr.unwrap_or(f64::NAN),
        scores.ssim.unwrap_or(f64::NAN),
    );

    let shots = at_times(&test_shots(&dataset)[..1], 5);
    let job = RenderJob {
        scene,
        shots: &shots,
        on_shot: &mut |_| {},
    };
    let layers = [PictureLayer::Full, PictureLayer::Dynamic];
    write_pictures(job, &layers, PictureFormat::Png, Path::new(out))?;
    Ok(())
}
