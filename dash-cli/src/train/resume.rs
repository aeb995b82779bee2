//! A run that goes on.

use std::sync::Arc;

use dash_train::train::{RunConfig, RunFolder, TrainConfig};
use dash_train::windows::Windows;

use super::{Begun, TrainArgs};
use crate::Shared;
use crate::configuration::{ConfigFile, Overrides, name};
use crate::data::{load_dataset, other_data};
use crate::failure::Failure;
use crate::values;

/// The run that goes on, and its dataset, which may have been moved.
pub fn take_up(
    args: &TrainArgs,
    shared: &Shared,
    overrides: &Overrides<'_>,
    file: &ConfigFile,
) -> Result<Begun, Failure> {
    if Windows::are_in(&args.out) {
        return Err(Failure::usage(format!(
            "--resume: {} is a clip in windows of time; the command that began it goes on without --resume",
            args.out.display()
        )));
    }
    let run = RunFolder::open(&args.out)?;
    let mut config = run.config()?;
    check_same(args, shared, overrides, file, &config)?;
    let folder = values::absolute(&args.dataset)?;
    let is_moved = folder != config.data.dataset;
    config.data.dataset = folder;
    let dataset = load_dataset(&config.data, args.data.memory, false)?;
    if is_moved {
        run.follow_dataset(&dataset)?;
    }
    Ok(Begun {
        run,
        config,
        dataset: Arc::new(dataset),
        first_points: Default::default(),
    })
}

/// A resumed run is the one that was begun: options may repeat its values, not change them.
fn check_same(
    args: &TrainArgs,
    shared: &Shared,
    overrides: &Overrides<'_>,
    file: &ConfigFile,
    config: &RunConfig,
) -> Result<(), Failure> {
    let refuse = |option: &str, found: String| {
        Err(Failure::usage(format!(
            "{option} contradicts the run in {}, which has {found}; leave it out with --resume, or \
             start another run",
            args.out.display()
        )))
    };
    if args
        .values
        .preset
        .is_some_and(|preset| preset != config.train.preset)
    {
        return refuse("--preset", name(config.train.preset));
    }
    let data = &config.data;
    if let Some((option, found)) = other_data(&args.data, data) {
        return refuse(option, found);
    }
    if shared
        .device
        .is_some_and(|device| device.resolved().to_string() != data.device)
    {
        return refuse("--device", data.device.clone());
    }
    let again: TrainConfig = overrides.apply(config.train.clone(), file)?;
    if again != config.train {
        return refuse(
            "--config, --set, --batch, --iterations, --keep or --seed",
            "other values in config.toml".into(),
        );
    }
    Ok(())
}
