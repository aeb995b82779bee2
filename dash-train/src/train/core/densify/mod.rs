//! Density control: which Gaussians are cloned, split, pruned or relocated, and when.
//!
//! A policy, [`Densify`], decides what becomes of the rows of a set. The mechanics here and in the step carry it out:
//! rounds, opacity resets, and the moments and statistics that follow the rows.

mod adaptive;
mod statistics;

use burn::tensor::Tensor;
use dash_model::{GaussianRows, Gaussians};
use rand_pcg::Pcg64;

use super::config::{DensifyConfig, ScheduleConfig};
use super::sets::Set;
pub use adaptive::Adaptive;
pub use statistics::DensityStatistics;

/// Opacity that a reset leaves at most. Source: 3DGS.
const RESET_OPACITY: f32 = 0.01;

/// Decides what becomes of the Gaussians of a set.
pub trait Densify: Send {
    /// One round.
    fn round(&mut self, round: &Round<'_>, rng: &mut Pcg64) -> Edit;
}

/// What a policy knows in a round.
pub struct Round<'a> {
    /// Which set.
    pub set: Set,
    /// Steps done.
    pub step: usize,
    /// Its Gaussians.
    pub rows: &'a GaussianRows,
    /// What was gathered since the last round.
    pub statistics: &'a DensityStatistics,
    /// The set's configuration.
    pub config: &'a DensifyConfig,
    /// What extensions may change.
    pub rules: Rules,
    /// Most Gaussians that there may be after it.
    pub max_gaussians: usize,
    /// Whether opacities have been reset, so that too large Gaussians may be pruned.
    pub was_reset: bool,
    /// What lengths are measured by.
    pub scale: SceneScale,
}

/// What extensions may change in a round.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rules {
    /// Mean gradient above which a Gaussian is cloned or split, in units of half the image.
    pub gradient_threshold: f32,
    /// Whether oversized Gaussians are pruned once opacities were reset.
    pub prunes_oversized: bool,
}

/// The rows after a round, and where each came from.
#[derive(Debug, Clone)]
pub struct Edit {
    /// The new rows.
    pub rows: GaussianRows,
    /// For each, the row before the round that it comes from.
    pub sources: Vec<usize>,
    /// Whether its optimizer moments start anew.
    pub fresh: Vec<bool>,
}

/// What lengths are measured by.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SceneScale {
    /// Centre of the scene, world units.
    pub centre: [f32; 3],
    /// Its size, world units.
    pub extent: f32,
}

impl SceneScale {
    /// The unit of length at a mean: the extent, and farther out the distance from the centre, since a background may
    /// be larger as it is farther away.
    pub fn at(self, mean: [f32; 3]) -> f32 {
        let distance = glam::Vec3::from(mean).distance(self.centre.into());
        self.extent.max(distance)
    }
}

/// Whether a round of a set is due at `step`.
pub(super) fn round_due(schedule: &ScheduleConfig, config: &DensifyConfig, step: usize) -> bool {
    let [from, until] = config.during.map(|share| schedule.step_at(share));
    step >= from && step < until && step.is_multiple_of(schedule.densify.interval)
}

/// Whether opacities are reset at `step`, for rounds that began to count at `since`. Before the first round nothing would
/// replace what a reset hides. Rounds go on for half an interval at least: those that a reset makes transparent and that
/// come back slowly are replaced, not pruned by the last round.
pub(super) fn reset_due(
    schedule: &ScheduleConfig,
    config: &DensifyConfig,
    since: usize,
    step: usize,
) -> bool {
    let [from, until] = config.during.map(|share| schedule.step_at(share));
    schedule
        .densify
        .opacity_reset_interval
        .is_some_and(|interval| {
            step > since
                && step >= from
                && step + interval / 2 <= until
                && (step - since).is_multiple_of(interval)
        })
}

/// Whether the time of the first reset is over at `step`.
pub(super) fn was_reset(
    schedule: &ScheduleConfig,
    config: &DensifyConfig,
    since: usize,
    step: usize,
) -> bool {
    let from = schedule.step_at(config.during[0]);
    schedule
        .densify
        .opacity_reset_interval
        .is_some_and(|interval| {
            let intervals = from.saturating_sub(since).div_ceil(interval).max(1);
            step > since + intervals * interval
        })
}

/// The same Gaussians, none more opaque than [`RESET_OPACITY`].
pub(super) fn with_low_opacity(mut set: Gaussians) -> Gaussians {
    let limit = dash_model::logit(RESET_OPACITY);
    set.opacity_logits = set
        .opacity_logits
        .map(|logits| Tensor::from_inner(logits.inner().clamp_max(limit)).require_grad());
    set
}
