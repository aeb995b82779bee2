//! One run of a benchmark.

use std::path::Path;
use std::sync::Arc;

use burn::tensor::Device;

use super::{Benchmark, RunOptions};
use crate::Error;
use crate::dataset::Dataset;
use crate::results::train_and_score;
use crate::train::{
    DataConfig, RunConfig, RunFolder, StepReport, TrainConfig, TrainOptions, check_dataset,
};

/// A scene whose runs are trained.
pub(super) struct Training<'a> {
    pub(super) benchmark: &'a Benchmark,
    pub(super) data: &'a DataConfig,
    pub(super) dataset: Arc<Dataset>,
    pub(super) device: &'a Device,
    pub(super) options: &'a RunOptions<'a>,
}

impl Training<'_> {
    /// Steps of a run.
    pub(super) fn iterations(&self) -> usize {
        self.benchmark.train.steps_for(&self.dataset)
    }

    /// Trains and scores a run, from its newest checkpoint where it was interrupted.
    pub(super) fn run(
        self,
        seed: u64,
        root: &Path,
        on_step: &mut dyn FnMut(&StepReport, f64),
    ) -> Result<(), Error> {
        check_dataset(&self.dataset)?;
        let config = TrainConfig {
            seed,
            iterations: self.iterations(),
            ..self.benchmark.train.clone()
        };
        let config = RunConfig::new(self.data.clone(), config);
        let run = take_up(root, &config)?;
        let options = TrainOptions {
            resume: true,
            curve: 0,
            on_step,
            watch: None,
            stop: self.options.stop,
            clock: None,
            additions: Default::default(),
        };
        let perceptual = self.options.perceptual;
        train_and_score(
            &run,
            &config,
            &self.dataset,
            self.device,
            perceptual,
            options,
        )?;
        Ok(())
    }
}

/// The run's folder: what an interrupted benchmark left of it, or a new one.
fn take_up(root: &Path, config: &RunConfig) -> Result<RunFolder, Error> {
    let Ok(run) = RunFolder::open(root) else {
        return RunFolder::create(root, config);
    };
    if run.config()?.as_begun() == *config {
        return Ok(run);
    }
    Err(Error::run(
        root,
        "expected this benchmark's run, found another one's, or one of a scene that has changed since (config.toml \
         differs); remove the folder to train it again, or choose another --out",
    ))
}
