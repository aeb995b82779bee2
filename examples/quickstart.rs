//! Makes the synthetic scene `bounce`, trains the 4D model on it, scores it on the camera that was
//! held out, and writes pictures, a video (where ffmpeg is there) and `results.json`.
//!
//! `cargo run --release --example quickstart -- [--out DIR] [--iterations N] [--scene NAME]`

use std::path::PathBuf;
use std::sync::Arc;

use dash_train::dataset::{self, LoadOptions, Partition};
use dash_train::device::DeviceChoice;
use dash_train::evaluate::{Process, evaluate_run};
use dash_train::process;
use dash_train::render::{
    PictureFormat, PictureLayer, RenderJob, spiral_shots, test_shots, write_overview,
    write_pictures, write_video,
};
use dash_train::synth::{self, SynthConfig};
use dash_train::train::{
    DataConfig, Preset, RunConfig, RunFolder, TrainConfig, TrainOptions, train,
};
use dash_train::video::ffmpeg_available;

type Failure = Box<dyn std::error::Error + Send + Sync>;

fn main() -> Result<(), Failure> {
    process::prepare();
    // On a thread of the pool: from outside, every parallel loop would wake one and wait for it.
    rayon::scope(|_| run())
}

fn run() -> Result<(), Failure> {
    let (mut out, mut synth) = (PathBuf::from("out/quickstart"), SynthConfig::default());
    let mut config = TrainConfig::preset(Preset::Quick);
    let mut arguments = std::env::args().skip(1);
    while let (Some(name), Some(value)) = (arguments.next(), arguments.next()) {
        match name.as_str() {
            "--out" => out = PathBuf::from(value),
            "--iterations" => config.set(&format!("iterations={value}"))?,
            "--scene" => synth.scene = value.parse()?,
            other => return Err(format!("unknown option {other}").into()),
        }
    }

    let data = out.join("data");
    println!("{}", synth::write(&data, &synth)?);
    let dataset = Arc::new(dataset::load(&data, &LoadOptions::default())?);

    let choice = DeviceChoice::Auto.resolved();
    let (device, name) = (choice.device()?, choice.to_string());
    let run_config = RunConfig::new(
        DataConfig {
            dataset: data.canonicalize()?,
            layout: None,
            downscale: 1.0,
            test_cameras: None,
            invert_masks: false,
            frames: None,
            skip_broken: false,
            device: name.clone(),
        },
        config.clone(),
    );
    let run = RunFolder::create(&out.join("run"), &run_config)?;
    let options = TrainOptions {
        resume: false,
        curve: 0,
        on_step: &mut |report, seconds| {
            if report.step.is_multiple_of(500) || report.step == config.iterations {
                println!(
                    "{seconds:4.0} s  step {:5}  training PSNR {:5.2} dB  {} static, {} dynamic",
                    report.step, report.psnr, report.n_static, report.n_dynamic
                );
            }
        },
        pace: None,
    };
    let (trainer, _) = train(&run, &config, dataset.clone(), &device, options)?;

    let results = evaluate_run(
        &run,
        &dataset,
        Partition::Test,
        (&device, &name),
        Process::Trained,
        &Default::default(),
    )?;
    let scores = &results.evaluation;
    println!(
        "test camera: PSNR {:.2} dB, moving pixels {:.2} dB; split F1 {:.3}",
        scores.psnr.unwrap_or(f64::NAN),
        scores.psnr_dynamic.unwrap_or(f64::NAN),
        scores
            .decomposition
            .as_ref()
            .map_or(f64::NAN, |split| split.f1),
    );

    let scene = trainer.scene();
    let (test, path) = (test_shots(&dataset), spiral_shots(&dataset, 60));
    let layers = [
        PictureLayer::Full,
        PictureLayer::Static,
        PictureLayer::Dynamic,
        PictureLayer::Depth,
    ];
    let pictures = RenderJob {
        scene,
        shots: &test,
        on_shot: &mut |_| {},
    };
    write_pictures(
        pictures,
        &layers,
        PictureFormat::Png,
        &run.root().join("renders"),
    )?;
    let views: Vec<_> = dataset.views_of(Partition::Test).collect();
    write_overview(scene, &views, &run.root().join("overview.png"))?;
    if ffmpeg_available() {
        let video = RenderJob {
            scene,
            shots: &path,
            on_shot: &mut |_| {},
        };
        write_video(video, PictureLayer::Full, &run.root().join("spiral.mp4"))?;
    } else {
        println!("no ffmpeg on this machine: no video");
    }
    println!(
        "pictures, the model and results.json are in {}",
        run.root().display()
    );
    Ok(())
}
