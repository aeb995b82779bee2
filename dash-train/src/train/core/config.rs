//! The configuration of what every method shares.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::ranges::Ranges;

/// What a run does at which step, and what it starts from.
#[derive(Debug, Clone, PartialEq)]
pub struct ScheduleConfig {
    /// Optimisation steps, of `batch` views each.
    pub iterations: usize,
    /// Views of a step.
    pub batch: usize,
    /// Seed of everything random.
    pub seed: u64,
    /// Largest spherical-harmonics degree, 0 to 3.
    pub sh_degree: usize,
    /// Share of the run after which the active degree rises by one.
    pub sh_interval: f32,
    /// Share of D-SSIM against L1 in the photometric loss.
    pub dssim: f32,
    /// Gaussians nearer to a camera than this are not drawn, world units; absent: measured.
    pub near_plane: Option<f64>,
    /// Extent of the scene, world units; absent: measured.
    pub extent: Option<f32>,
    /// Fewest and most points that the first Gaussians are made of.
    pub initial_points: [usize; 2],
    /// Learning rates.
    pub optimizer: OptimizerConfig,
    /// Density control of both sets.
    pub densify: DensifySets,
}

impl ScheduleConfig {
    /// The step at a share of the run.
    pub fn step_at(&self, share: f32) -> usize {
        (share * self.iterations as f32).round() as usize
    }
}

/// Adam learning rates. The rates of means at the start (1.6e-4 of the scene's extent; Gaussians' own trajectories have it, too), of
/// quaternions (1e-3), log scales (5e-3), opacity logits (0.05) and colours (2.5e-3, higher degrees a twentieth) are those of 3DGS
/// and fixed.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct OptimizerConfig {
    /// Means and Gaussians' own trajectories at the end, reached exponentially, in units of the scene's extent. Source: 3DGS,
    /// 1.6e-6.
    pub means_final: f32,
    /// Hash tables and feature planes at the start. Source: ours; the released code has 8e-3.
    pub grid: f32,
    /// Decoders at the start. Source: ours; the released code has 1.6e-4.
    pub network: f32,
    /// Factor of the rates of tables and decoders at the end, reached exponentially; also of the coarse field's where its
    /// trajectories are lines. Source: ours; released code 0.01.
    pub field_final: f32,
}

/// Density control of the static Gaussians (of all, before the decomposition) and of the dynamic ones.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct DensifySets {
    /// Mean gradient of the screen position above which a Gaussian is cloned or split, in units of half the image.
    /// Source: 3DGS, 2e-4.
    pub gradient_threshold: f32,
    /// Pixels of the pictures that `max_gaussians` and `initial_points` are for. For larger pictures of a rig, both grow with
    /// the square root of the number of pixels. Absent: neither grows. Source: ours.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pixels: Option<usize>,
    /// Steps between rounds. Source: 3DGS, 100.
    pub interval: usize,
    /// Steps between opacity resets, of which none comes before density control of a set starts; absent: none. Source: 3DGS, 3,000.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub opacity_reset_interval: Option<usize>,
    /// Of the static set.
    #[serde(rename = "static")]
    pub static_set: DensifyConfig,
    /// Of the dynamic set.
    pub dynamic: DensifyConfig,
}

/// Adaptive density control of one set (Kerbl et al. 2023, section 5). The largest scale that is cloned (0.01 of the
/// extent), the opacity below which a Gaussian is pruned (0.005) and the scale above which it is pruned (0.1 of the
/// extent) are those of 3DGS and fixed.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct DensifyConfig {
    /// Shares of the run at which it starts and ends. Source: 3DGS, rounds from step 600 to 14,900 of 30,000.
    pub during: [f32; 2],
    /// Most Gaussians of this set. The dynamic set may use what the static set leaves free. If nothing may move, the static
    /// set may use the dynamic set's limit, too. Source: ours; 3DGS has no limit.
    pub max_gaussians: usize,
}

impl OptimizerConfig {
    /// The ranges of its keys.
    pub(crate) fn check(&self, ranges: &mut Ranges) {
        ranges.not_negative("means_final", self.means_final);
        ranges.not_negative("grid", self.grid);
        ranges.not_negative("network", self.network);
        ranges.not_negative("field_final", self.field_final);
    }
}

impl DensifySets {
    /// The ranges of its keys.
    pub(crate) fn check(&self, ranges: &mut Ranges) {
        ranges.not_negative("gradient_threshold", self.gradient_threshold);
        if let Some(pixels) = self.pixels {
            ranges.at_least_one("pixels", pixels);
        }
        ranges.at_least_one("interval", self.interval);
        if let Some(interval) = self.opacity_reset_interval {
            ranges.at_least_one("opacity_reset_interval", interval);
        }
        for (name, set) in [("static", &self.static_set), ("dynamic", &self.dynamic)] {
            ranges.section(name, |ranges| {
                for share in set.during {
                    ranges.not_negative("during", share);
                }
                ranges.in_order("during", set.during);
            });
        }
        let most = self.static_set.max_gaussians;
        ranges.section("static", |ranges| {
            ranges.at_least_one("max_gaussians", most)
        });
    }
}
