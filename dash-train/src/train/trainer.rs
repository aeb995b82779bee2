//! The three stages: warm-up, decomposition, 4D.

use std::collections::BTreeSet;
use std::sync::Arc;

use burn::tensor::Device;
use dash_model::decomposition::MotionStatistics;
use dash_model::scene_file::TablePrecision;
use dash_model::{
    DynamicScene, Gaps, GaussianRows, Gaussians, MotionField, SceneSettings, SpaceBox,
};
use rand::SeedableRng;
use rand_pcg::Pcg64;

use super::average::{self, Average};
use super::coarse::{Part, Stages};
use super::config::TrainConfig;
use super::density::DensityStatistics;
use super::guard::{self, Skipped, SkippedStep};
use super::initial::{Core, initial_points, near_plane};
use super::leave_out::{self, Decision};
use super::matching::Memory;
use super::moved::Moved;
use super::optimizer::{Optimizer, to_host};
use super::regularity::Times;
use super::sampler::ViewSampler;
use super::{coarse, matching, promote, review, statistics, update, validation};
use crate::TrainError;
use crate::dataset::{Dataset, Partition, View};

/// Steps between two times from which on what lies between makes the field coarser.
const LONG_GAP: f32 = 3.5;

/// Path prefix of the static Gaussians' parameters.
pub(crate) const STATIC: &str = "scene.static_set.";
/// Path prefix of the dynamic Gaussians' parameters.
pub(crate) const DYNAMIC: &str = "scene.dynamic.gaussians.";

/// What one step did.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StepReport {
    /// Steps done so far.
    pub step: usize,
    /// The whole loss.
    pub loss: f32,
    /// Peak signal-to-noise ratio of the step's training view, dB.
    pub psnr: f32,
    /// Static Gaussians.
    pub n_static: usize,
    /// Dynamic Gaussians.
    pub n_dynamic: usize,
    /// Whether the step changed nothing because something was not finite; `loss` and `psnr` then need not
    /// be finite either.
    pub skipped: bool,
}

/// A training run in memory.
pub struct Trainer {
    pub(crate) config: TrainConfig,
    pub(crate) device: Device,
    pub(crate) dataset: Arc<Dataset>,
    pub(crate) train_views: Vec<usize>,
    pub(crate) validation_views: Vec<usize>,
    /// Size of the scene, world units.
    pub(crate) extent: f32,
    /// The part of space that the capture is about.
    pub(crate) core: Core,
    /// The part of the clip that training starts from, if it has one.
    pub(crate) start_part: Option<Part>,
    /// The training views' times.
    pub(crate) times: Times,
    pub(crate) scene: DynamicScene,
    /// The coarse field, from the warm-up until Gaussians have trajectories of their own.
    pub(crate) motion: Option<MotionField>,
    /// The space of coarse motion; present from the warm-up to the split.
    pub(crate) motion_space: Option<SpaceBox>,
    /// What cameras saw where following begins, while the coarse field looks for motion.
    pub(crate) moved: Option<Moved>,
    /// Where what moves fast was found, while the coarse field looks for motion.
    pub(crate) found_places: Memory,
    pub(crate) optimizer: Optimizer,
    /// The mean of the parameters, towards the end.
    pub(crate) average: Average,
    pub(crate) rng: Pcg64,
    pub(crate) sampler: ViewSampler,
    /// Spent in steps on waiting for images.
    waited_secs: f64,
    pub(crate) step: usize,
    pub(crate) density_static: DensityStatistics,
    pub(crate) density_dynamic: DensityStatistics,
    /// How large motion appears, per world unit.
    pub(crate) motion_statistics: MotionStatistics,
    pub(crate) held_still: Vec<bool>,
    /// What was kept and left out so far.
    pub(crate) decisions: Vec<Decision>,
    /// Steps left out because something was not finite.
    pub(crate) skipped: Skipped,
}

impl Trainer {
    /// A run at its first step.
    ///
    /// # Errors
    /// When the configuration is out of range or no view is left to train on.
    pub fn new(
        config: TrainConfig,
        dataset: Arc<Dataset>,
        device: &Device,
    ) -> Result<Self, TrainError> {
        config.validate()?;
        let device = device.clone().autodiff();
        let (train_views, validation_views) = validation::hold_out(&dataset);
        if train_views.is_empty() {
            return Err(TrainError::NoTrainingViews {
                dataset: dataset.root.clone(),
            });
        }
        let start_part = coarse::start_part(&dataset, &train_views);
        let mut config = if coarse::shown_at_once(start_part) {
            // A vertex of the field's grid at a frame that is held out would learn nothing.
            let frames = train_views.iter().map(|&view| dataset.views[view].frame);
            config.for_frames(frames.collect::<BTreeSet<_>>().len(), true)
        } else {
            config.for_frames(dataset.n_frames, false)
        };
        if let Some(part) = start_part {
            config.follow_from(part.middle());
        }
        let mut rng = Pcg64::seed_from_u64(config.seed);
        let background = config.background.or(dataset.background).unwrap_or([0.0; 3]);
        let points = initial_points(
            &dataset,
            &train_views,
            start_part,
            background,
            [config.min_initial_points, config.max_initial_points],
            &mut rng,
        )?;
        let times = train_views.iter().map(|&view| dataset.views[view].time);
        let gaps = config
            .gap_steps
            .map(|steps| Gaps::between(times.clone(), steps));
        let has_long_gaps = Gaps::between(times.clone(), LONG_GAP).lie_within();
        if has_long_gaps && !coarse::shown_at_once(start_part) {
            config.coarsen_for_gaps();
        }
        let times = Times::of(times);
        let core = Core::of(&dataset, &points);
        let near_plane = config
            .near_plane
            .unwrap_or_else(|| near_plane(train_views.iter().map(|&i| &dataset.views[i]), &points));
        let extent = config.learning_rates.extent.unwrap_or(core.extent);
        let rows = GaussianRows::from_points(
            &points.positions,
            &points.colors,
            config.sh_degree,
            0.01 * extent,
        );
        let scene = DynamicScene {
            static_set: Gaussians::from_rows(&rows, &device),
            dynamic: None,
            settings: SceneSettings {
                background,
                sh_degree: 0,
                near_plane,
                ndc_limit: config.ndc_limit,
                trajectory_basis: config.decomposition.basis,
                offsets: config.field.offsets,
                gaps: gaps.unwrap_or_default(),
            },
        };
        let n = rows.len();
        Ok(Self {
            config,
            device,
            dataset,
            train_views,
            validation_views,
            extent,
            core,
            start_part,
            times,
            scene,
            motion: None,
            motion_space: None,
            moved: None,
            found_places: Memory::default(),
            optimizer: Optimizer::default(),
            average: Average::default(),
            rng,
            sampler: ViewSampler::default(),
            waited_secs: 0.0,
            step: 0,
            density_static: DensityStatistics::new(n),
            density_dynamic: DensityStatistics::new(0),
            motion_statistics: MotionStatistics::default(),
            held_still: Vec::new(),
            decisions: Vec::new(),
            skipped: Skipped::default(),
        })
    }

    /// The scene as trained so far.
    pub fn scene(&self) -> &DynamicScene {
        &self.scene
    }

    /// The configuration of the run.
    pub fn config(&self) -> &TrainConfig {
        &self.config
    }

    /// Steps done so far.
    pub fn steps_done(&self) -> usize {
        self.step
    }

    /// Whether all steps are done.
    pub fn is_finished(&self) -> bool {
        self.step >= self.config.iterations
    }

    /// Mean PSNR over views that are neither trained on nor tested, dB; `None` when none are held
    /// out.
    ///
    /// # Errors
    /// When rendering fails.
    pub fn validation_psnr(&self) -> Result<Option<f64>, TrainError> {
        validation::psnr(&self.scene, &self.dataset, &self.validation_views)
    }

    /// Whether anything may move in this run.
    pub(crate) fn may_move(&self) -> bool {
        self.config.decomposition.enabled
            && self.dataset.n_frames > 1
            && !leave_out::nothing_moves(&self.decisions)
    }

    /// What is left of the scene as trained so far when parts that it does not need are left out (with
    /// [`Keep::All`](super::Keep::All) all of it), the precision that its tables need, and which parts
    /// were kept and left out, and why.
    ///
    /// # Errors
    /// When rendering fails.
    pub fn needed_scene(
        &self,
    ) -> Result<(DynamicScene, TablePrecision, Vec<Decision>), TrainError> {
        leave_out::after_training(self)
    }

    /// One optimisation step, with what its step number brings: stage changes, density control.
    ///
    /// A step in which the loss, a parameter or a gradient is not finite changes no parameter and no
    /// moment: what is at fault is removed or cleared, and told by a warning and by
    /// [`Trainer::take_skipped_steps`].
    ///
    /// # Errors
    /// When too many steps in a row had to be skipped, or a kernel refuses its input.
    pub fn step(&mut self) -> Result<StepReport, TrainError> {
        if self.step == 0 {
            self.begin()?;
        }
        coarse::enter_stage(self)?;
        matching::meet_new_frames(self)?;
        let sh_interval = self.config.step_at(self.config.sh_interval).max(1);
        self.scene.settings.sh_degree = (self.step / sh_interval).min(self.config.sh_degree);

        let dataset = self.dataset.clone();
        let view = self.next_view();
        self.announce_views(view);
        let view = &dataset.views[view];
        let waited = self.waiting();
        let forward = self.forward(view)?;
        self.waited_secs += self.waiting() - waited;
        let loss = to_host(forward.loss.clone())[0];
        let mse = to_host(forward.mse.clone())[0];
        let mut gradients = forward.loss.backward();
        let faults = guard::look(self, &gradients, loss);
        let skipped = faults.is_some();
        match faults {
            None => {
                statistics::gather(self, &forward, view, &mut gradients)?;
                drop(forward);
                update::parameters(self, view.time, &mut gradients);
                self.skipped.end_row();
            }
            Some(faults) => guard::skip(self, faults, &view.name, loss)?,
        }
        self.step += 1;
        update::densities(self);
        self.review()?;
        average::gather(self);

        let (n_static, n_dynamic) = self.scene.counts();
        Ok(StepReport {
            step: self.step,
            loss,
            psnr: -10.0 * mse.max(1e-10).log10(),
            n_static,
            n_dynamic,
            skipped,
        })
    }

    /// The steps skipped since the last call, because something in them was not finite.
    pub fn take_skipped_steps(&mut self) -> Vec<SkippedStep> {
        self.skipped.take()
    }

    /// What is decided before the first step: whether anything moves, and the stages of runs that are
    /// short for following it. Where nothing does, the preset's stages stay as they are.
    fn begin(&mut self) -> Result<(), TrainError> {
        leave_out::before_training(self)?;
        if self.start_part.is_some() && self.may_move() {
            self.config.make_room_for_following();
        }
        Ok(())
    }

    /// The view to train on.
    fn next_view(&mut self) -> usize {
        let (views, train_views) = (&self.dataset.views, &self.train_views);
        let time = |index: usize| views[train_views[index]].time;
        let n = train_views.len();
        let index = if let Some((window, known)) = coarse::time_window(self, self.step) {
            let (seen, new) = (|i| window.holds(time(i)), |i| !known.holds(time(i)));
            self.sampler
                .next_of_growing(n, seen, new, time, &mut self.rng)
        } else {
            self.sampler.next(n, |_| true, &mut self.rng)
        };
        train_views[index]
    }

    /// Seconds that anyone has waited for images.
    fn waiting(&self) -> f64 {
        let statistics = self.dataset.frame_statistics();
        statistics.map_or(0.0, |statistics| statistics.waited_secs)
    }

    /// Seconds that steps have waited for images; `None` where all images are in memory.
    pub fn waited_seconds(&self) -> Option<f64> {
        self.dataset.frame_statistics().map(|_| self.waited_secs)
    }

    /// Tells the dataset which views come next, where the order is a new one.
    fn announce_views(&mut self, view: usize) {
        let train_views = &self.train_views;
        if let Some(upcoming) = self.sampler.tell_new_round() {
            let upcoming = std::iter::once(view).chain(upcoming.map(|i| train_views[i]));
            let views = upcoming.map(|index| &self.dataset.views[index]);
            self.dataset.announce(views);
        }
    }

    /// Lets dynamic Gaussians that do not move become static.
    fn review(&mut self) -> Result<(), TrainError> {
        let interval = self.config.decomposition.review_interval;
        let start = Stages::of(self).end;
        let due = interval > 0 && self.step > start && (self.step - start).is_multiple_of(interval);
        if due && !average::is_taken(self) {
            review::review(self)?;
            if !review::is_grown(self) {
                promote::promote(self)?;
            }
        }
        Ok(())
    }

    /// Indices of the views that are trained on.
    pub fn train_views(&self) -> &[usize] {
        &self.train_views
    }

    /// Views of the dataset's test split.
    pub fn test_views(&self) -> impl Iterator<Item = &View> {
        self.dataset
            .views
            .iter()
            .filter(|view| view.partition == Partition::Test)
    }
}

/// Replaces the first Gaussians of a run that has not begun.
pub(crate) fn start_from(trainer: &mut Trainer, rows: &GaussianRows) {
    trainer.scene.static_set = Gaussians::from_rows(rows, &trainer.device);
    trainer.density_static = DensityStatistics::new(rows.len());
}

/// Mean PSNR of the training views, dB.
pub(crate) fn training_psnr(trainer: &Trainer) -> Result<f64, TrainError> {
    let psnr = validation::psnr(&trainer.scene, &trainer.dataset, &trainer.train_views)?;
    Ok(psnr.unwrap_or(f64::NAN))
}

#[cfg(test)]
mod tests;
