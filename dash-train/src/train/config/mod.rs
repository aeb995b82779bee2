//! Everything that decides a training run.

mod deviations;
mod presets;
mod ranges;
mod set;
pub(super) mod shown;
#[cfg(test)]
pub(crate) mod tests;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::core::{DensifySets, OptimizerConfig, ScheduleConfig, is_synchronized};
use super::extensions::ExtensionsConfig;
use super::paper::MethodConfig;
use crate::dataset::{Dataset, Partition};
pub use deviations::deviations;

/// Named starting points for a [`TrainConfig`].
#[derive(
    Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema, clap::ValueEnum,
)]
#[serde(rename_all = "snake_case")]
pub enum Preset {
    /// Ours, 15,000 steps: an hour or more on a CPU.
    Default,
    /// The paper's equations as written, 30,000 steps.
    Paper,
    /// The released code's values and forms, 50,000 steps.
    Reference,
    /// Ours, 6,000 smaller steps: minutes on a CPU.
    Quick,
    /// Ours, 30,000 steps: a night, or a GPU.
    Best,
}

/// Whether parts that a scene does not need are left out: the extension `prune` on the command line.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "snake_case")]
pub enum Keep {
    /// Every part stays.
    All,
    /// A part goes when measurements say that the scene does without.
    Needed,
}

/// A training run. Written with every value to `config.toml`: running it again gives the same result.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct TrainConfig {
    /// The preset that the values came from.
    pub preset: Preset,
    /// Optimisation steps, of `batch` views each. Stages are shares of it, so a shorter run keeps its form, as long as there are
    /// enough steps to follow motion in. Source: 3DGS, 30,000.
    pub iterations: usize,
    /// Views of a step, whose mean gradient it follows; learning rates grow with the square root. They are drawn one after the
    /// other, so each takes memory for its gradients and splats alone. Source: 3DGS, 1.
    pub batch: usize,
    /// Steps for each training view, at least: where there are more views than `iterations` has steps for, a run that is not
    /// told its number of steps takes more. Absent: as many steps for any capture. Source: ours.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub visits: Option<usize>,
    /// Seed of everything random. Source: ours.
    pub seed: u64,
    /// Largest spherical-harmonics degree, 0 to 3. Source: 3DGS, 3.
    pub sh_degree: usize,
    /// Share of the run after which the active degree rises by one. Source: 3DGS, 1,000 of 30,000 steps.
    pub sh_interval: f32,
    /// Share of D-SSIM against L1 in the photometric loss (Eq. 6). Source: 3DGS, 0.2.
    pub dssim: f32,
    /// Gaussians nearer to a camera than this are not drawn, world units. Absent: half of the distance at which the
    /// training cameras see something. Source: the released code has 0.2.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub near_plane: Option<f64>,
    /// Fewest and most points that the first Gaussians are made of. Where the dataset brings fewer, depth maps of
    /// the views that training starts from give more; what is too many is thinned evenly. Source: ours.
    pub initial_points: [usize; 2],
    /// Steps between checkpoints. Source: ours.
    pub checkpoint_interval: usize,
    /// Ideas beyond the paper; one without a section does not run. Before the sections that must be there: a file that was
    /// cut off lacks some of these.
    #[serde(default)]
    pub extensions: ExtensionsConfig,
    /// DASH: stages, decomposition, fields.
    pub method: MethodConfig,
    /// Learning rates.
    pub optimizer: OptimizerConfig,
    /// Density control.
    pub densify: DensifySets,
}

impl TrainConfig {
    /// The step at a share of the run.
    pub fn step_at(&self, share: f32) -> usize {
        (share * self.iterations as f32).round() as usize
    }

    /// The steps that a capture is given where nobody says how many.
    pub fn steps_for(&self, dataset: &Dataset) -> usize {
        let views = dataset.views_of(Partition::Train).count();
        let visits = self.visits.unwrap_or(0) * views;
        self.iterations.max(visits.div_ceil(self.batch))
    }

    /// Sets whether parts that the scene does not need are left out.
    pub fn keep(&mut self, keep: Keep) {
        self.extensions.prune = match keep {
            Keep::All => None,
            Keep::Needed => Some(self.extensions.prune.take().unwrap_or_default()),
        };
    }

    /// The same with as many Gaussians as the pictures of a capture are given. Where few cameras show a time, larger
    /// pictures hold no more of them in place.
    pub(crate) fn for_capture(&self, dataset: &Dataset) -> Self {
        match is_synchronized(dataset) {
            true => self.for_pictures(dataset.pixels()),
            false => self.clone(),
        }
    }

    /// The same with as many Gaussians as pictures of so many pixels are given.
    fn for_pictures(&self, pixels: usize) -> Self {
        let mut config = self.clone();
        if let Some(most) = self.densify.pixels {
            let factor = (pixels as f64 / most as f64).sqrt().max(1.0);
            let grow = |n: &mut usize| *n = (*n as f64 * factor).round() as usize;
            config.initial_points.iter_mut().for_each(grow);
            grow(&mut config.densify.static_set.max_gaussians);
            grow(&mut config.densify.dynamic.max_gaussians);
        }
        config
    }

    /// The part that every method shares.
    pub(crate) fn schedule(&self) -> ScheduleConfig {
        ScheduleConfig {
            iterations: self.iterations,
            batch: self.batch,
            seed: self.seed,
            sh_degree: self.sh_degree,
            sh_interval: self.sh_interval,
            dssim: self.dssim,
            near_plane: self.near_plane,
            extent: self.method.form.extent(),
            initial_points: self.initial_points,
            optimizer: self.optimizer.clone(),
            densify: self.densify.clone(),
        }
    }
}
