//! Makes the synthetic scene `bounce`, trains the 4D model on it, scores it on the camera that was
//! held out, and writes pictures, a video (where ffmpeg is there) and `results.json`.
//!
//! `cargo run --release --example quickstart -- [--out DIR] [--iterations N] [--scene NAME]`

use std::path::PathBuf;

use dash_train::process;
use dash_train::quickstart::{QuickstartConfig, quickstart};

type Failure = Box<dyn std::error::Error + Send + Sync>;

fn main() -> Result<(), Failure> {
    process::run(run)
}

fn run() -> Result<(), Failure> {
    let (mut out, mut config) = (PathBuf::from("out/quickstart"), QuickstartConfig::default());
    let mut arguments = std::env::args().skip(1);
    while let (Some(name), Some(value)) = (arguments.next(), arguments.next()) {
        match name.as_str() {
            "--out" => out = PathBuf::from(value),
            "--iterations" => config.train.set(&format!("iterations={value}"))?,
            "--scene" => config.scene = value.parse()?,
            other => return Err(format!("unknown option {other}").into()),
        }
    }
    let last = config.train.iterations;
    println!(
        "a synthetic clip, then {last} steps of training; all of it goes to {}",
        out.display()
    );
    let done = quickstart(&out, &config, &mut |report, seconds| {
        if report.step.is_multiple_of(500) || report.step == last {
            println!(
                "{seconds:4.0} s  step {:5} of {last}  {:13}  training PSNR {:5.2} dB  {} static, {} dynamic",
                report.step, report.stage, report.psnr, report.n_static, report.n_dynamic
            );
        }
    })?;
    if let Some(scores) = done.scores() {
        println!(
            "test camera: PSNR {:.2} dB, moving pixels {:.2} dB; decomposition F1 {:.3}",
            scores.psnr.unwrap_or(f64::NAN),
            scores.psnr_dynamic.unwrap_or(f64::NAN),
            scores
                .decomposition
                .as_ref()
                .map_or(f64::NAN, |found| found.f1),
        );
    }
    let root = done.run.root().display();
    println!("{root}/overview.png shows captured, rendered, static and dynamic pictures;");
    println!("the model, results.json and, where ffmpeg is installed, spiral.mp4 lie beside it");
    Ok(())
}
