//! Training.
//!
//! # Map
//! - `core`: the step and its mechanics, whatever the method: optimizer, density control, view sampler, guard, checkpoints.
//! - `paper`: DASH as a [`Method`]: stages, coarse motion, decomposition, smoothness.
//! - `extensions`: ideas beyond the paper, one file or folder each.
//! - `config`: the configuration and its presets.
//! - `trainer`: a run in memory; `budget`: how many steps of one fit into a time; `run`: a run on disk;
//!   `reference`: the page of all keys.
//!
//! Arrows go down this list, from its end to its start.
//!
//! # Extending it
//! A loss, a schedule or anything per step is an [`Extension`]; another densification strategy is a [`Densify`]; another
//! method is a [`Method`]. [`Additions`] brings your own into a [`Trainer`].

pub(crate) mod budget;
pub mod config;
pub mod core;
pub mod extensions;
pub mod paper;
mod reference;
mod run;
mod trainer;

pub(crate) use budget::TYPICAL_POWER;
pub use budget::{Budget, OnTrial};
pub use config::{Keep, Preset, TrainConfig};
pub use core::{
    Decision, Densify, Extension, Finished, FirstPoints, MAX_SKIPPED_IN_A_ROW, Method, NonFinite,
    Place, SkippedStep, StepReport,
};
pub use reference::reference;
pub use run::{
    DataConfig, LogLine, RunConfig, RunFolder, StageEnds, TrainOptions, latest_checkpoint,
    read_config, train,
};

/// Says what a dataset lacks for its shape to be found, before a run is begun.
///
/// # Errors
/// [`Error::TooLittle`](crate::Error::TooLittle) where training can't begin.
pub fn check_dataset(dataset: &crate::dataset::Dataset) -> Result<(), crate::Error> {
    core::shortage::check(dataset)
}

pub use trainer::{
    Additions, Trainer, checkpoint_config, load_checkpoint, load_checkpoint_with, save_checkpoint,
};
