//! A whole run in one call: load a dataset, train on it, score the held-out views.

use std::path::Path;
use std::sync::Arc;

use dash_model::DynamicScene;

use crate::Error;
use crate::dataset::{self, Dataset, Layout, Partition};
use crate::device::DeviceChoice;
use crate::evaluate::Evaluation;
use crate::results::{Process, Results, evaluate_run};
use crate::train::{
    DataConfig, Preset, RunConfig, RunFolder, StepReport, TrainConfig, TrainOptions, check_dataset,
    train,
};

/// How [`reconstruct`] loads and trains.
#[derive(Debug, Clone)]
pub struct ReconstructConfig {
    /// The dataset's layout; recognised by its files when `None`.
    pub layout: Option<Layout>,
    /// Factor by which images are made smaller, at least 1.
    pub downscale: f64,
    /// Indices of the cameras to hold out; the layout's own choice when `None`.
    pub test_cameras: Option<Vec<usize>>,
    /// Where to compute.
    pub device: DeviceChoice,
    /// The training.
    pub train: TrainConfig,
}

impl Default for ReconstructConfig {
    /// The preset `quick` on the best device that there is.
    fn default() -> Self {
        Self {
            layout: None,
            downscale: 1.0,
            test_cameras: None,
            device: DeviceChoice::Auto,
            train: TrainConfig::preset(Preset::Quick),
        }
    }
}

/// A finished run.
#[derive(Debug)]
pub struct Reconstruction {
    /// Its folder.
    pub run: RunFolder,
    /// What it was trained on, test views included.
    pub dataset: Arc<Dataset>,
    /// The scene at the end of training. That in the run's folder leaves out what it can do without.
    pub scene: DynamicScene,
    /// What its `results.json` holds; `None` where nothing is held out.
    pub results: Option<Results>,
}

impl Reconstruction {
    /// Scores of the test views; `None` where nothing is held out.
    pub fn scores(&self) -> Option<&Evaluation> {
        self.results.as_ref().map(|results| &results.evaluation)
    }
}

/// Trains on the dataset in a folder and scores the result; `run` is the folder to make.
///
/// It takes as many steps as `config.train.iterations` says. Without `--iterations`, `dash train` takes more for a capture of very many
/// views: [`TrainConfig::steps_for`].
///
/// `on_step` is called after every step with the seconds trained so far. In a program that does nothing else call
/// [`process::run`](crate::process::run) around it.
///
/// # Errors
/// When the dataset can't be loaded, `run` is not empty, the device is missing, or training fails.
pub fn reconstruct(
    dataset: &Path,
    run: &Path,
    config: &ReconstructConfig,
    on_step: &mut dyn FnMut(&StepReport, f64),
) -> Result<Reconstruction, Error> {
    let choice = config.device.resolved();
    let (device, name) = (choice.device()?, choice.to_string());
    let folder = std::path::absolute(dataset).map_err(|e| Error::io(dataset, "find", e))?;
    let data = DataConfig {
        dataset: folder,
        layout: config.layout,
        downscale: config.downscale,
        test_cameras: config.test_cameras.clone(),
        drop_cameras: Vec::new(),
        frames: None,
        invert_masks: false,
        skip_broken: false,
        backdrop: None,
        device: name.clone(),
    };
    let dataset = Arc::new(dataset::load(&data.dataset, &data.load_options())?);
    check_dataset(&dataset)?;
    let run = RunFolder::create(run, &RunConfig::new(data, config.train.clone()))?;
    let options = TrainOptions {
        resume: false,
        curve: 0,
        on_step,
        watch: None,
        clock: None,
        stop: &|| false,
        additions: Default::default(),
    };
    let (trainer, _) = train(&run, &config.train, dataset.clone(), &device, options)?;
    let scene = trainer.scene().clone();
    drop(trainer);
    let results = match dataset.views_of(Partition::Test).next() {
        None => None,
        Some(_) => Some(evaluate_run(
            &run,
            &dataset,
            Partition::Test,
            (&device, &name),
            Process::Trained,
            &Default::default(),
        )?),
    };
    Ok(Reconstruction {
        run,
        dataset,
        scene,
        results,
    })
}
