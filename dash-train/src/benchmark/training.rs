//! One run of a benchmark.

use std::path::Path;
use std::sync::Arc;

use burn::tensor::Device;
use dash_model::unfinished::discard;

use super::{Benchmark, RunOptions};
use crate::Error;
use crate::dataset::{Dataset, Partition};
use crate::process::reset_peak_memory;
use crate::results::{Process, evaluate_run};
use crate::train::{
    DataConfig, RunConfig, RunFolder, StepReport, TrainConfig, TrainOptions, check_dataset, train,
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
            ..self.benchmark.train.clone()
        };
        let config = RunConfig::new(self.data.clone(), config);
        let run = take_up(root, &config)?;
        reset_peak_memory();
        let options = TrainOptions {
            resume: true,
            curve: 0,
            on_step,
            stop: self.options.stop,
            clock: None,
            additions: Default::default(),
        };
        train(
            &run,
            &config.train,
            self.dataset.clone(),
            self.device,
            options,
        )?;
        evaluate_run(
            &run,
            &self.dataset,
            Partition::Test,
            (self.device, self.data.device.as_str()),
            Process::Trained,
            self.options.perceptual,
        )?;
        let checkpoints = run.checkpoints_path();
        discard(&checkpoints).map_err(|e| Error::io(&checkpoints, "remove", e))
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
