//! Motion before the split: a field discovers it from frame to frame, then every Gaussian gets a
//! trajectory of its own, which it keeps only as far as the pictures pay for it.

use burn::tensor::Tensor;
use dash_model::Gaussians;

use super::config::TimeWindow;
use super::optimizer::to_host;
use super::split;
use super::trainer::{STATIC, Trainer};
use crate::TrainError;

/// Share of the field's time after which a growing window has all times.
const GROWN: f32 = 0.8;
/// Frames that count as new when the window reaches them.
const NEW_FRAMES: f32 = 2.0;
/// Cameras at the first time that a growing window needs.
const MIN_CAMERAS: usize = 4;

/// The steps at which the stages before the 4D one change.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Stages {
    /// End of the warm-up: the coarse field starts.
    pub(crate) warmup: usize,
    /// Each Gaussian gets a trajectory of its own.
    pub(crate) settle: usize,
    /// The split.
    pub(crate) end: usize,
}

impl Stages {
    /// The stages of a run.
    pub(crate) fn of(trainer: &Trainer) -> Self {
        let (config, stages) = (&trainer.config, &trainer.config.stages);
        let settle = stages.warmup + stages.settle * (stages.decomposition - stages.warmup);
        Self {
            warmup: config.step_at(stages.warmup),
            settle: config.step_at(settle),
            end: config.step_at(stages.decomposition),
        }
    }

    /// What is left of the coarse field's rate at `step`. It comes to rest once it has seen all
    /// times: Adam's steps do not get smaller by themselves, and what still jitters would pass for
    /// motion.
    pub(crate) fn field_rate(self, step: usize) -> f32 {
        ((1.0 - share(self.warmup, self.settle, step)) / (1.0 - GROWN)).clamp(0.0, 1.0)
    }

    /// What is left of the rate of the Gaussians' own trajectories at `step`, until the split.
    pub(crate) fn trajectory_rate(self, step: usize) -> f32 {
        1.0 - share(self.settle, self.end, step).min(1.0)
    }
}

/// How far `step` is between two others.
fn share(from: usize, to: usize, step: usize) -> f32 {
    step.saturating_sub(from) as f32 / to.saturating_sub(from).max(1) as f32
}

/// Changes stage where the step number says so.
pub(crate) fn enter_stage(trainer: &mut Trainer) -> Result<(), TrainError> {
    if !trainer.may_move() {
        return Ok(());
    }
    let stages = Stages::of(trainer);
    if trainer.step == stages.warmup && stages.warmup < stages.end {
        split::start_motion(trainer)?;
        trainer.sampler.restart();
    }
    if trainer.step == stages.settle && stages.settle < stages.end {
        settle(trainer)?;
    }
    if trainer.step == stages.end {
        split::split(trainer)?;
        trainer.sampler.restart();
    }
    Ok(())
}

/// Trajectory coefficients `[N, B * 3]` of all Gaussians; `None` while nothing moves and after the
/// split.
pub(crate) fn coefficients(trainer: &Trainer) -> Result<Option<Tensor<2>>, TrainError> {
    let set = &trainer.scene.static_set;
    Ok(match (&trainer.motion, &set.trajectories) {
        (Some(field), _) => Some(field.coefficients(set.means.val())?),
        (None, Some(own)) => Some(own.val()),
        (None, None) => None,
    })
}

/// Whether the first two stages start from the first time and see more and more.
pub(crate) fn window_grows(trainer: &Trainer) -> bool {
    let times = || {
        trainer
            .train_views
            .iter()
            .map(|&i| trainer.dataset.views[i].time)
    };
    let first = times().fold(1.0, f32::min);
    let at_first = times().filter(|&time| time == first).count();
    trainer.config.stages.window == TimeWindow::Growing
        && trainer.may_move()
        && at_first >= MIN_CAMERAS
}

/// Whether a view at `time` teaches the Gaussians too, and not the coarse field alone: until the field
/// has followed what moves into a new frame, that frame would teach them to fade where they should be
/// moved.
pub(crate) fn teaches_gaussians(trainer: &Trainer, time: f32) -> bool {
    trainer.motion.is_none() || time <= time_window(trainer, trainer.step).1
}

/// The latest time that is trained on at `step`, and the time after which frames are new.
pub(crate) fn time_window(trainer: &Trainer, step: usize) -> (f32, f32) {
    const ALL: (f32, f32) = (1.0, 1.0);
    if !window_grows(trainer) {
        return ALL;
    }
    let times = trainer
        .train_views
        .iter()
        .map(|&i| trainer.dataset.views[i].time);
    let first = times.fold(1.0, f32::min);
    let stages = Stages::of(trainer);
    if step < stages.warmup {
        return (first, first);
    }
    let grown = share(stages.warmup, stages.settle, step) / GROWN;
    if grown >= 1.0 {
        return ALL;
    }
    let window = first + (1.0 - first) * grown;
    let frame = 1.0 / (trainer.dataset.n_frames - 1).max(1) as f32;
    (window, (window - NEW_FRAMES * frame).max(first))
}

/// Gives every Gaussian the trajectory that the field has for it.
fn settle(trainer: &mut Trainer) -> Result<(), TrainError> {
    let Some(own) = coefficients(trainer)? else {
        return Ok(());
    };
    trainer.motion = None;
    trainer.optimizer.forget("motion.");
    let mut rows = trainer.scene.static_set.to_rows();
    rows.trajectory_width = own.dims()[1];
    rows.trajectories = to_host(own);
    trainer.scene.static_set = Gaussians::from_rows(&rows, &trainer.device);
    trainer.optimizer.forget(&format!("{STATIC}trajectories"));
    Ok(())
}
