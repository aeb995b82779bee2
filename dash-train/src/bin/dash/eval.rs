//! `dash eval`: a run's scores.

use std::path::PathBuf;

use clap::{Args, ValueEnum};
use dash_train::dataset::{Split, load};
use dash_train::evaluate::{Process, evaluate_run};
use dash_train::train::RunFolder;

use crate::Shared;
use crate::failure::Failure;
use crate::summary;

/// Score a run against its dataset's images and write RUN/results.json
#[derive(Args)]
#[command(after_help = "Example:\n  dash eval runs/room --split test

What each number means is in results.json under metric_settings. The dataset is read from where the
run's config.toml says. peak_memory_bytes stays that of training where it is known.")]
pub struct EvalArgs {
    /// A run's folder
    run: PathBuf,
    /// Which views
    #[arg(long, value_enum, default_value_t)]
    split: SplitName,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, ValueEnum)]
enum SplitName {
    /// Views held out from training
    #[default]
    Test,
    /// Views trained on
    Train,
}

pub fn run(args: &EvalArgs, shared: &Shared) -> Result<String, Failure> {
    let run = RunFolder::open(&args.run)?;
    let config = run.config()?;
    let choice = shared.device.unwrap_or_default().resolved();
    let device = choice.device()?;
    // A damaged scene is found before the images are read.
    run.scene(&device)?;
    let dataset = load(&config.data.dataset, &config.data.load_options())?;
    let split = match args.split {
        SplitName::Test => Split::Test,
        SplitName::Train => Split::Train,
    };
    let name = choice.to_string();
    let results = evaluate_run(&run, &dataset, split, (&device, &name), Process::Evaluates)?;
    Ok(format!(
        "{}\nwritten to {}",
        summary::results(&results),
        run.results_path().display()
    ))
}
