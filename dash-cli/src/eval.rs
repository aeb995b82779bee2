//! `dash eval`: a run's scores.

use std::path::{Path, PathBuf};

use burn::tensor::Device;
use clap::{Args, ValueEnum};
use dash_train::dataset::Partition;
use dash_train::results::{Process, evaluate_run};
use dash_train::train::RunFolder;
use dash_train::windows::{WindowedClip, Windows};

use crate::Shared;
use crate::data::dataset_of;
use crate::failure::Failure;
use crate::lpips::LpipsArgs;
use crate::summary;

/// Score a run against its dataset's images and write RUN/results.json
#[derive(Args)]
#[command(after_help = "Examples:
  dash eval runs/room --split test
  dash eval runs/room --dataset /mnt/moved/room
  dash eval runs/room --lpips-alex alexnet-owt-7be5be79.pth alex.pth

What each number means is in results.json under metric_settings. Scores of the training views are written to
results_train.json instead. The dataset is read from where the run's config.toml says, or from --dataset, with
the run's options (downscale, frames, test cameras ..). peak_memory_bytes stays that of training where it is
known.

Weights of LPIPS are .safetensors or .pth files; of the latter only tensors are read, and nothing in
them is executed.")]
pub struct EvalArgs {
    /// A run's folder, or that of a long clip's windows
    run: PathBuf,
    /// Which views
    #[arg(long, value_enum, default_value_t)]
    split: SplitName,
    /// Where the dataset is, if it was moved; or a folder with further held-out views of the same scene, whose
    /// poses and times mean the same
    #[arg(long, value_name = "DIR")]
    dataset: Option<PathBuf>,
    #[command(flatten)]
    lpips: LpipsArgs,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, ValueEnum)]
enum SplitName {
    /// Views held out from training
    #[default]
    Test,
    /// Views trained on
    Train,
}

impl SplitName {
    fn partition(self) -> Partition {
        match self {
            Self::Test => Partition::Test,
            Self::Train => Partition::Train,
        }
    }
}

pub fn run(args: &EvalArgs, shared: &Shared) -> Result<String, Failure> {
    let choice = shared.device.unwrap_or_default().resolved();
    let device = choice.device()?;
    if Windows::are_in(&args.run) {
        return of_windows(args, &device, &choice.to_string());
    }
    let run = RunFolder::open(&args.run)?;
    let config = run.config()?;
    // A damaged scene is found before the images are read.
    run.scene(&device)?;
    let perceptual = args.lpips.files().load(&device)?;
    let dataset = dataset_of(&config.data, args.dataset.as_deref(), false)?;
    let partition = args.split.partition();
    let is_own =
        |folder: &Path| folder.canonicalize().ok() == config.data.dataset.canonicalize().ok();
    if let Some(other) = args.dataset.as_deref().filter(|other| !is_own(other)) {
        tracing::warn!(
            "{}: the run was trained on {}; scores of {} take the place of its own",
            args.run.display(),
            config.data.dataset.display(),
            other.display()
        );
    }
    let name = choice.to_string();
    let results = evaluate_run(
        &run,
        &dataset,
        partition,
        (&device, &name),
        Process::Evaluates,
        &perceptual,
    )?;
    Ok(format!(
        "{}\nwritten to {}",
        summary::results(&results),
        run.scores_path(partition).display()
    ))
}

/// Windows of time as one clip.
fn of_windows(args: &EvalArgs, device: &Device, name: &str) -> Result<String, Failure> {
    let clip = WindowedClip::open(&args.run, device)?;
    let perceptual = args.lpips.files().load(device)?;
    let dataset = dataset_of(&clip.windows().data, args.dataset.as_deref(), true)?;
    let partition = args.split.partition();
    let results = clip.evaluate(&dataset, partition, name, &perceptual)?;
    Ok(format!(
        "{}\nwritten to {}",
        summary::results(&results),
        args.run.join(RunFolder::scores_name(partition)).display()
    ))
}
