//! The trainer: a run of DASH with its extensions.

use std::path::Path;
use std::sync::Arc;

use burn::tensor::Device;
use dash_model::{DynamicScene, GaussianRows, Gaussians};

use super::config::TrainConfig;
use super::core::{
    self, Adaptive, Backdrop, Densify, Exchange, Extension, Finished, FirstPoints, Hooks, Run,
    SkippedStep, StepReport, ViewSums, checkpoint, hold_out,
};
use super::paper::Dash;
use crate::Error;
use crate::dataset::{Dataset, Partition, View};

/// Share of a run after which its warm-up ends at the latest, if it has a backdrop.
const WARMUP_WITH_BACKDROP: f32 = 0.02;

/// A training run in memory.
///
/// ```
/// use std::sync::Arc;
///
/// use burn::tensor::Device;
/// use dash_train::dataset::{LoadOptions, Partition, load};
/// use dash_train::evaluate::evaluate;
/// use dash_train::synth::{SynthConfig, write};
/// use dash_train::train::{Preset, TrainConfig, Trainer};
///
/// let folder = tempfile::tempdir()?;
/// let clip = folder.path().join("clip");
/// let config = SynthConfig { cameras: 4, frames: 2, width: 32, height: 24, ..Default::default() };
/// write(&clip, &config)?;
/// let dataset = Arc::new(load(&clip, &LoadOptions::default())?);
///
/// let config = TrainConfig::preset(Preset::Quick);
/// let mut trainer = Trainer::new(config, dataset.clone(), &Device::flex())?;
/// for _ in 0..3 {
///     trainer.step()?;
/// }
/// let test = Partition::Test;
/// let scores = evaluate(trainer.scene(), &dataset, test, 1.0, &Default::default())?;
/// assert!(scores.psnr.is_some_and(f64::is_finite));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub struct Trainer {
    /// The configuration that it was begun with.
    config: TrainConfig,
    pub(crate) run: Run<Dash>,
    pub(crate) hooks: Hooks<Dash>,
}

/// What a run gets beside its configuration.
#[derive(Default)]
pub struct Additions {
    /// Extensions, whose hooks are called after those of the configuration.
    pub extensions: Vec<Box<dyn Extension<Dash>>>,
    /// The policy of density control; `None`: that of 3DGS.
    pub densify: Option<Box<dyn Densify>>,
    /// A scene whose static Gaussians are kept where they fit; see [`Run::add_backdrop`].
    pub backdrop: Option<DynamicScene>,
    /// Points that other runs on the same data have found, and that others will find here.
    pub first_points: FirstPoints,
    /// What joins the run with replicas that draw some of each step's views.
    pub exchange: Option<Box<dyn Exchange>>,
}

impl Trainer {
    /// A run at its first step.
    ///
    /// # Errors
    /// When the configuration is out of range or no view is left to train on.
    pub fn new(config: TrainConfig, dataset: Arc<Dataset>, device: &Device) -> Result<Self, Error> {
        Self::with(config, dataset, device, Additions::default())
    }

    /// A run at its first step with extensions or a density control of your own.
    ///
    /// # Errors
    /// When the configuration is out of range or no view is left to train on.
    pub fn with(
        config: TrainConfig,
        dataset: Arc<Dataset>,
        device: &Device,
        additions: Additions,
    ) -> Result<Self, Error> {
        config.validate()?;
        let schedule = config.for_capture(&dataset).schedule();
        let method = |facts: &_| Dash::new(config.method.clone(), facts);
        let mut run = Run::new(schedule, dataset, device, &additions.first_points, method)?;
        run.scene.settings.trajectory_basis = run.method.basis;
        run.scene.settings.offsets = config.method.offsets();
        if let Some(room) = &additions.backdrop {
            run.add_backdrop(room)?;
            // The static Gaussians are known: the warm-up needs fewer steps, the dynamic ones need as many.
            let [warmup, decomposition] = &mut run.method.config.stages;
            let earlier = *warmup - warmup.min(WARMUP_WITH_BACKDROP);
            *warmup -= earlier;
            *decomposition -= earlier;
        }
        let mut extensions = config.extensions.build();
        extensions.extend(additions.extensions);
        let densify = additions.densify.unwrap_or_else(|| Box::new(Adaptive));
        let mut hooks = Hooks::new(extensions, densify, &mut run);
        if let Some(exchange) = &additions.exchange
            && exchange.replicas() > run.config.batch
        {
            let (n, views) = (exchange.replicas(), run.config.batch);
            return Err(Error::Replicas(format!(
                "expected a view a step for each of {n}, found `batch` = {views}; set it to {n} or more"
            )));
        }
        hooks.exchange = additions.exchange;
        Ok(Self { config, run, hooks })
    }

    /// The scene as trained so far, without a backdrop.
    pub fn scene(&self) -> &DynamicScene {
        &self.run.scene
    }

    /// The scene as trained so far, with the backdrop if there is one.
    pub fn whole_scene(&self) -> DynamicScene {
        self.run.whole(&self.run.scene)
    }

    /// The configuration that the run was begun with.
    pub fn config(&self) -> &TrainConfig {
        &self.config
    }

    /// The state of the run.
    pub fn run(&self) -> &Run<Dash> {
        &self.run
    }

    /// Steps done so far.
    pub fn steps_done(&self) -> usize {
        self.run.step
    }

    /// Whether all steps are done.
    pub fn is_finished(&self) -> bool {
        self.run.step >= self.run.config.iterations
    }

    /// One optimisation step, with what its step number brings: changes of stage, density control.
    ///
    /// A step in which the loss, a parameter or a gradient is not finite changes no parameter and no moment: what is at
    /// fault is removed or cleared, and told by a warning and by [`Trainer::take_skipped_steps`], on a GPU within fifty steps.
    ///
    /// # Errors
    /// When too many steps in a row had to be skipped, or a kernel refuses its input.
    pub fn step(&mut self) -> Result<StepReport, Error> {
        core::step(&mut self.run, &mut self.hooks)
    }

    /// The trained scene in its stored form: with extension `prune`, without what it does not need.
    ///
    /// # Errors
    /// When rendering fails.
    pub fn finished(&self) -> Result<Finished, Error> {
        self.hooks.finish(&self.run)
    }

    /// Mean PSNR over views that are neither trained on nor tested, dB; `None` when none are held
    /// out.
    ///
    /// # Errors
    /// When rendering fails.
    pub fn validation_psnr(&self) -> Result<Option<f64>, Error> {
        let run = &self.run;
        hold_out::psnr(&self.whole_scene(), &run.dataset, &run.validation_views)
    }

    /// Mean PSNR of the training views, dB.
    ///
    /// # Errors
    /// When rendering fails.
    pub fn training_psnr(&self) -> Result<f64, Error> {
        let run = &self.run;
        let psnr = hold_out::psnr(&self.whole_scene(), &run.dataset, &run.train_views)?;
        Ok(psnr.unwrap_or(f64::NAN))
    }

    /// The steps skipped since the last call, because something in them was not finite.
    pub fn take_skipped_steps(&mut self) -> Vec<SkippedStep> {
        self.run.take_skipped_steps()
    }

    /// Seconds that steps have waited for images; `None` where all images are in memory.
    pub fn waited_seconds(&self) -> Option<f64> {
        let decoded = self.run.dataset.frame_statistics();
        decoded.map(|_| self.run.waited_secs())
    }

    /// Views of the dataset's test partition.
    pub fn test_views(&self) -> impl Iterator<Item = &View> {
        let views = self.run.dataset.views.iter();
        views.filter(|view| view.partition == Partition::Test)
    }

    /// Replaces the first Gaussians of a run that has not begun.
    pub(crate) fn start_from(&mut self, rows: &GaussianRows) {
        self.run.scene.static_set = Gaussians::from_rows(rows, &self.run.device);
        self.run.static_state.gathered = ViewSums::new(rows.len(), &self.run.device);
    }
}

/// Writes `folder/NNNNNN` for the trainer's step.
///
/// # Errors
/// [`Error::Io`] or a model error; what was there before stays.
pub fn save_checkpoint(trainer: &Trainer, folder: &Path, train_seconds: f64) -> Result<(), Error> {
    let Trainer { config, run, hooks } = trainer;
    checkpoint::save(run, hooks, config, folder, train_seconds)
}

/// The configuration that a checkpoint was trained with.
///
/// # Errors
/// When the checkpoint can't be read.
pub fn checkpoint_config(checkpoint: &Path) -> Result<TrainConfig, Error> {
    Ok(checkpoint::read_state(checkpoint)?.config)
}

/// Rebuilds a trainer as it was, and the seconds it had trained.
///
/// # Errors
/// When the checkpoint can't be read, is damaged, or belongs to another dataset.
pub fn load_checkpoint(
    checkpoint: &Path,
    dataset: Arc<Dataset>,
    device: &Device,
) -> Result<(Trainer, f64), Error> {
    load_checkpoint_with(checkpoint, dataset, device, Additions::default())
}

/// The same for a run with extensions or a density control of your own.
///
/// # Errors
/// When the checkpoint can't be read, is damaged, belongs to another dataset or to other extensions.
pub fn load_checkpoint_with(
    path: &Path,
    dataset: Arc<Dataset>,
    device: &Device,
    additions: Additions,
) -> Result<(Trainer, f64), Error> {
    let load = || {
        let mut state = checkpoint::read_state::<TrainConfig>(path)?;
        if let Some(what) = state.contradiction(&dataset) {
            return Err(Error::run(
                &dataset.root,
                format!("{what}; the dataset was changed: restore it, or start another run"),
            ));
        }
        let config = state.config.clone();
        let schedule = config.for_capture(&dataset).schedule();
        state.give_points(path, &schedule, &dataset, &additions.first_points)?;
        let room = additions.backdrop.clone();
        let mut trainer = Trainer::with(config, dataset.clone(), device, additions)?;
        let seconds = std::mem::take(&mut state.train_seconds);
        if let (Some(room), Some(kept)) = (room, state.kept.take()) {
            let backdrop = Backdrop::new(&room, kept, device);
            trainer.run.backdrop = Some(backdrop.map_err(|found| other_backdrop(path, &found))?);
        }
        checkpoint::restore(&mut trainer.run, &mut trainer.hooks, state, path)?;
        Ok((trainer, seconds))
    };
    load().map_err(|error| checkpoint::with_remedy(path, error))
}

/// What is wrong where a backdrop is not the one that a run was begun with.
pub(super) fn other_backdrop(path: &Path, found: &str) -> Error {
    let told = "expected the Gaussians of the backdrop that the run was begun with, found";
    let remedy = "bring that run back, or train this one anew";
    Error::run(path, format!("{told} {found}; {remedy}"))
}

/// Checks that a dataset in another folder is the one that a checkpoint was trained on.
///
/// # Errors
/// When the checkpoint can't be read, or says that it is another one.
pub(super) fn check_moved(path: &Path, dataset: &Dataset, from: &Path) -> Result<(), Error> {
    let state = checkpoint::read_state::<TrainConfig>(path)
        .map_err(|error| checkpoint::with_remedy(path, error))?;
    match state.contradiction(dataset) {
        None => Ok(()),
        Some(what) => Err(Error::run(
            &dataset.root,
            format!(
                "{what}; name the run's own dataset, {} or where that was moved, or start another run",
                from.display()
            ),
        )),
    }
}

#[cfg(test)]
mod tests;
