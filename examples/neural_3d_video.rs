//! A capture in the Neural 3D Video layout (`poses_bounds.npy` with one folder of images or one
//! video per camera): trains, scores camera 0, and writes a video along a path between the cameras.
//!
//! `cargo run --release --example neural_3d_video -- FOLDER RUN [DOWNSCALE]`

use std::path::{Path, PathBuf};
use std::sync::Arc;

use dash_train::dataset::{self, Layout, LoadOptions, Partition};
use dash_train::device::DeviceChoice;
use dash_train::evaluate::{Process, evaluate_run};
use dash_train::process;
use dash_train::render::{PictureLayer, RenderJob, spiral_shots, write_video};
use dash_train::train::{
    DataConfig, Preset, RunConfig, RunFolder, TrainConfig, TrainOptions, train,
};

type Failure = Box<dyn std::error::Error + Send + Sync>;

fn main() -> Result<(), Failure> {
    process::prepare();
    // On a thread of the pool: from outside, every parallel loop would wake one and wait for it.
    rayon::scope(|_| run())
}

fn run() -> Result<(), Failure> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [folder, out, rest @ ..] = arguments.as_slice() else {
        return Err("expected FOLDER RUN [DOWNSCALE]".into());
    };
    let choice = DeviceChoice::Auto.resolved();
    let data = DataConfig {
        dataset: PathBuf::from(folder).canonicalize()?,
        layout: Some(Layout::N3dv),
        downscale: rest.first().map_or(Ok(2.0), |factor| factor.parse())?,
        test_cameras: Some(vec![0]),
        invert_masks: false,
        frames: None,
        skip_broken: false,
        device: choice.to_string(),
    };
    let dataset = Arc::new(dataset::load(
        &data.dataset,
        &LoadOptions {
            ..data.load_options()
        },
    )?);
    println!("{} cameras, {} frames", dataset.n_cameras, dataset.n_frames);

    // The quick preset with more Gaussians and steps: some minutes on a CPU at a small size.
    let mut train_config = TrainConfig::preset(Preset::Quick);
    train_config.set("iterations=8000")?;
    train_config.set("density_static.max_gaussians=20000")?;
    let config = RunConfig::new(data, train_config);
    let run = RunFolder::create(Path::new(out), &config)?;
    let device = choice.device()?;
    let options = TrainOptions {
        resume: false,
        curve: 0,
        on_step: &mut |report, seconds| {
            if report.step.is_multiple_of(500) {
                println!(
                    "{seconds:5.0} s  step {:6}  {:5.2} dB",
                    report.step, report.psnr
                );
            }
        },
        pace: None,
    };
    let (trainer, _) = train(&run, &config.train, dataset.clone(), &device, options)?;
    let name = config.data.device.as_str();
    let results = evaluate_run(
        &run,
        &dataset,
        Partition::Test,
        (&device, name),
        Process::Trained,
        &Default::default(),
    )?;
    println!(
        "PSNR {:.2} dB, moving pixels {:.2} dB",
        results.evaluation.psnr.unwrap_or(f64::NAN),
        results.evaluation.psnr_dynamic.unwrap_or(f64::NAN),
    );
    let shots = spiral_shots(&dataset, dataset.n_frames.max(2));
    let job = RenderJob {
        scene: trainer.scene(),
        shots: &shots,
        on_shot: &mut |_| {},
    };
    Ok(write_video(
        job,
        PictureLayer::Full,
        &run.root().join("spiral.mp4"),
    )?)
}
