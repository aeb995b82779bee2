//! One run of a benchmark.

use std::path::Path;
use std::sync::Arc;

use burn::tensor::Device;

use super::{Benchmark, RunOptions};
use crate::Error;
use crate::dataset::Dataset;
use crate::results::{take_up, train_and_score};
use crate::train::{DataConfig, RunConfig, StepReport, TrainConfig, TrainOptions, check_dataset};

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
        let run = take_up(root, &config, "benchmark")?;
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
