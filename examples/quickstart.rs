//! Makes the synthetic scene `bounce`, trains the 4D model on it and says how far it got.
//!
//! `cargo run --release --example quickstart -- [--out DIR] [--iterations N]`

use std::path::PathBuf;
use std::sync::Arc;

use burn::tensor::Device;
use dash_train::dataset::{self, LoadOptions};
use dash_train::synth::{self, SynthConfig};
use dash_train::train::{Preset, TrainConfig, Trainer};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut out = PathBuf::from("out/quickstart");
    let mut config = TrainConfig::preset(Preset::Quick);
    let mut arguments = std::env::args().skip(1);
    while let (Some(name), Some(value)) = (arguments.next(), arguments.next()) {
        match name.as_str() {
            "--out" => out = PathBuf::from(value),
            "--iterations" => config.set(&format!("iterations={value}"))?,
            other => return Err(format!("unknown option {other}").into()),
        }
    }
    let data = out.join("bounce");
    if !data.exists() {
        println!("{}", synth::write(&data, &SynthConfig::default())?);
    }
    let data = Arc::new(dataset::load(&data, &LoadOptions::default())?);
    let mut trainer = Trainer::new(config, data, &Device::flex())?;
    while !trainer.is_finished() {
        let report = trainer.step()?;
        if report.step.is_multiple_of(200) || trainer.is_finished() {
            println!(
                "step {:5}  training PSNR {:5.2} dB  {} static, {} dynamic Gaussians",
                report.step, report.psnr, report.n_static, report.n_dynamic
            );
        }
    }
    println!("validation PSNR {:?} dB", trainer.validation_psnr()?);
    trainer.scene().save(&out.join("scene"))?;
    Ok(())
}
