//! Scores of a finished run: its `results.json`.

use std::fs;
use std::io::Write;
use std::path::Path;
use std::sync::Arc;

use burn::tensor::Device;
use dash_model::scene_file::write_atomically;
use dash_model::unfinished::discard;
use serde::{Deserialize, Serialize};

use crate::Error;
use crate::dataset::{Dataset, Partition};
use crate::evaluate::{Evaluation, Perceptual, evaluate, storage_bytes};
use crate::process::{peak_memory_bytes, reset_peak_memory};
use crate::train::{Preset, RunConfig, RunFolder, TrainOptions, train};

/// `results.json`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Results {
    /// The dataset's name.
    pub dataset: String,
    /// The device of the evaluation.
    pub device: String,
    /// The preset that the run started from.
    pub preset: Preset,
    /// The run's seed.
    pub seed: u64,
    /// Training steps.
    pub iterations: usize,
    /// Seconds of training, evaluation and file writing excluded; of a comparison's runs, at the speed that its
    /// machine had when it began.
    pub train_seconds: Option<f64>,
    /// Size of `RUN/scene`.
    pub storage_bytes: u64,
    /// Most resident memory of the process that `metric_settings.peak_memory` names.
    pub peak_memory_bytes: Option<u64>,
    /// The scores.
    #[serde(flatten)]
    pub evaluation: Evaluation,
}

/// The calling process, whose memory is recorded.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Process {
    /// It has just trained the run.
    Trained,
    /// It only evaluates.
    Evaluates,
}

pub(crate) const TRAINING_MEMORY: &str =
    "most resident memory of the process that trained, dataset included";
const EVALUATION_MEMORY: &str = "most resident memory of the process that evaluated, dataset included; that of training is not known";

/// The folder of a run of a comparison or benchmark (`owner`): what an interrupted one left of it, on whatever device, or a
/// new one.
///
/// # Errors
/// When another run is there, or the folder can't be written.
pub(crate) fn take_up(root: &Path, config: &RunConfig, owner: &str) -> Result<RunFolder, Error> {
    let Ok(run) = RunFolder::open(root) else {
        return RunFolder::create(root, config);
    };
    let mut found = run.config()?.as_begun();
    found.data.device.clone_from(&config.data.device);
    if found == *config {
        return Ok(run);
    }
    Err(Error::run(
        root,
        format!(
            "expected this {owner}'s run, found another one's, or one of data that has changed since (config.toml \
             differs); remove the folder to train it again, or choose another --out"
        ),
    ))
}

/// Trains one of a process' runs, scores its test views, and removes its checkpoints.
///
/// # Errors
/// Those of [`train`] and [`evaluate_run`], and when the checkpoints can't be removed.
pub(crate) fn train_and_score(
    run: &RunFolder,
    config: &RunConfig,
    dataset: &Arc<Dataset>,
    device: &Device,
    perceptual: &Perceptual,
    options: TrainOptions<'_>,
) -> Result<Results, Error> {
    reset_peak_memory();
    train(run, &config.train, dataset.clone(), device, options)?;
    let device = (device, config.data.device.as_str());
    let process = Process::Trained;
    let results = evaluate_run(run, dataset, Partition::Test, device, process, perceptual)?;
    remove_checkpoints(run)?;
    Ok(results)
}

/// Removes a run's checkpoints, if there are any.
pub(crate) fn remove_checkpoints(run: &RunFolder) -> Result<(), Error> {
    let checkpoints = run.checkpoints_path();
    discard(&checkpoints).map_err(|e| Error::io(&checkpoints, "remove", e))
}

/// Scores a finished run and writes `results.json` for its test views, `results_train.json` for its training
/// views; `perceptual` holds what LPIPS needs, by default nothing.
///
/// # Errors
/// When the run is unfinished, there are no such views, or a file can't be read or written.
pub fn evaluate_run(
    run: &RunFolder,
    dataset: &Dataset,
    partition: Partition,
    device: (&Device, &str),
    process: Process,
    perceptual: &Perceptual,
) -> Result<Results, Error> {
    let config = run.config()?;
    let scene = run.scene(device.0)?;
    // Before the evaluation adds its own.
    let trained_peak = match process {
        Process::Trained => peak_memory_bytes(),
        Process::Evaluates => recorded_training_peak(run),
    };
    let mut evaluation = evaluate(
        &scene,
        dataset,
        partition,
        config.data.downscale,
        perceptual,
    )?;
    let (peak, rule) = match trained_peak {
        Some(peak) => (Some(peak), TRAINING_MEMORY),
        None => (peak_memory_bytes(), EVALUATION_MEMORY),
    };
    evaluation.metric_settings.peak_memory = rule.into();
    let results = Results {
        dataset: dataset.name.clone(),
        device: device.1.into(),
        preset: config.train.preset,
        seed: config.train.seed,
        iterations: config.train.iterations,
        train_seconds: run.log()?.last().map(|line| line.seconds),
        storage_bytes: storage_bytes(&run.scene_path())?,
        peak_memory_bytes: peak,
        evaluation,
    };
    results.write(&run.scores_path(partition))?;
    Ok(results)
}

impl Results {
    /// Writes them to a file.
    pub(crate) fn write(&self, path: &Path) -> Result<(), Error> {
        let json = serde_json::to_vec_pretty(self).map_err(|e| Error::Config(e.to_string()))?;
        Ok(write_atomically(path, |mut file| file.write_all(&json))?)
    }
}

/// Reads a run's `results.json`; `None` when the run has none yet.
///
/// # Errors
/// When the file can't be read or is damaged.
pub fn read_results(run: &RunFolder) -> Result<Option<Results>, Error> {
    read_scores(&run.results_path())
}

/// The scores in a file, if it is there.
pub(crate) fn read_scores(path: &Path) -> Result<Option<Results>, Error> {
    let text = match fs::read(path) {
        Ok(text) => text,
        Err(e) if e.kind() == std::io::ErrorKind::NotFound => return Ok(None),
        Err(e) => return Err(Error::io(path, "read", e)),
    };
    serde_json::from_slice(&text).map(Some).map_err(|e| {
        Error::run(
            path,
            format!("expected a run's results, found {e}; write them again with `dash eval`"),
        )
    })
}

/// A run that was trained and scored, with its scores; `None` where there is none, or it is not finished.
///
/// # Errors
/// As [`read_results`].
pub fn scored(root: &Path) -> Result<Option<(RunFolder, Results)>, Error> {
    let Ok(run) = RunFolder::open(root) else {
        return Ok(None);
    };
    Ok(read_results(&run)?.map(|results| (run, results)))
}

/// A damaged file is about to be replaced, so it is no reason to fail.
fn recorded_training_peak(run: &RunFolder) -> Option<u64> {
    let before = read_results(run).ok().flatten()?;
    (before.evaluation.metric_settings.peak_memory == TRAINING_MEMORY)
        .then_some(before.peak_memory_bytes)
        .flatten()
}
