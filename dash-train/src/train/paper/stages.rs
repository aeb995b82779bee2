//! The stages of a run.

/// Share of the coarse field's time after which it has seen every frame and comes to rest.
pub const GROWN: f32 = 0.8;

/// The steps at which the stages before the 4D one change.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Stages {
    /// End of the warm-up: the coarse field starts.
    pub warmup: usize,
    /// The coarse field hands over: each Gaussian gets a trajectory of its own. The end, where it does not.
    pub handover: usize,
    /// The decomposition: Gaussians become dynamic.
    pub end: usize,
}

impl Stages {
    /// Factor of the coarse field's learning rate at `step`, where its trajectories are polylines. The field comes to rest once it has seen all times:
    /// Adam's steps do not get smaller by themselves, and jitter would pass for motion.
    pub fn field_rate(self, step: usize) -> f32 {
        ((1.0 - share(self.warmup, self.handover, step)) / (1.0 - GROWN)).clamp(0.0, 1.0)
    }

    /// Factor of the rate of the Gaussians' own trajectories at `step`, until the decomposition.
    pub fn trajectory_rate(self, step: usize) -> f32 {
        1.0 - share(self.handover, self.end, step).min(1.0)
    }

    /// How far `step` is between the warm-up's end and the handover.
    pub fn followed(self, step: usize) -> f32 {
        share(self.warmup, self.handover, step)
    }
}

/// How far `step` is between two others.
fn share(from: usize, to: usize, step: usize) -> f32 {
    step.saturating_sub(from) as f32 / to.saturating_sub(from).max(1) as f32
}
