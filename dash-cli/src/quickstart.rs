//! `dash quickstart`: from nothing to pictures.

use std::path::PathBuf;

use clap::Args;
use dash_train::quickstart::{QuickstartConfig, quickstart};
use dash_train::synth::SceneKind;

use crate::Shared;
use crate::failure::Failure;
use crate::progress::TrainProgress;
use crate::summary;
use crate::values;

/// Make a synthetic clip, train on it, score it, and write pictures and a video
#[derive(Args)]
#[command(after_help = "Example:
  dash quickstart --out out/first --iterations 2000

OUT/data holds the clip, OUT/run the run: overview.png, renders/, spiral.mp4 (where ffmpeg is installed), results.json
and scene/, the model.")]
pub struct QuickstartArgs {
    /// Folder to make
    #[arg(long, value_name = "DIR", default_value = "out/quickstart")]
    out: PathBuf,
    /// Optimisation steps [default: the preset `quick`'s]
    #[arg(long, value_name = "N", value_parser = values::count, allow_negative_numbers = true)]
    iterations: Option<usize>,
    /// What to render
    #[arg(long, value_enum, value_name = "NAME", default_value_t)]
    scene: SceneKind,
}

pub fn run(args: &QuickstartArgs, shared: &Shared) -> Result<String, Failure> {
    let mut config = QuickstartConfig {
        scene: args.scene,
        device: shared.device.unwrap_or_default(),
        ..QuickstartConfig::default()
    };
    if let Some(iterations) = args.iterations {
        config.train.set(&format!("iterations={iterations}"))?;
    }
    let mut progress = TrainProgress::new(config.train.iterations, shared);
    let trained = quickstart(&args.out, &config, &mut |report, secs| {
        progress.step(report, secs);
    });
    progress.finish();
    let done = trained?;
    let root = done.run.root().display();
    let scores = done.results.as_ref().map(summary::results);
    Ok(format!(
        "{}\npictures, the model and results.json are in {root}",
        scores.unwrap_or_default()
    ))
}
