//! When there are more Gaussians or fewer, and how large they may be.

use serde::{Deserialize, Serialize};

/// Adaptive density control of one set (Kerbl et al. 2023, section 5).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DensityConfig {
    /// Share of the run at which it starts.
    pub from: f32,
    /// Share of the run at which it ends.
    pub until: f32,
    /// Steps between rounds (3DGS: 100).
    pub interval: usize,
    /// Mean screen-space gradient above which a Gaussian is cloned or split, in units of half the
    /// image (3DGS: 2e-4).
    pub gradient_threshold: f32,
    /// Number of Gaussians in this set above which the threshold rises in proportion to their number, so
    /// that each of many has to pay for more; 0: it never does.
    #[serde(default)]
    pub crowd: usize,
    /// Share of the Gaussians that the split makes dynamic which is no crowd yet, if it is more than that number;
    /// only where every time by itself shows the scene's shape, as a rig's do.
    #[serde(default)]
    pub crowd_of_split: f32,
    /// Largest scale that is cloned rather than split, in units of the extent (3DGS: 0.01).
    pub clone_scale: f32,
    /// Opacity below which a Gaussian is removed (3DGS: 0.005).
    pub min_opacity: f32,
    /// Scale above which a Gaussian is too large, in units of the extent (3DGS: 0.1), or of its distance from the
    /// scene's middle where that is more.
    pub max_scale: f32,
    /// What becomes of those that are too large.
    #[serde(default)]
    pub oversized: Oversized,
    /// Steps between opacity resets (3DGS: 3,000); 0 for none.
    pub opacity_reset_interval: usize,
    /// Most Gaussians of this set. Dynamic ones may also have what static ones leave of theirs; static ones, in a run in
    /// which nothing may move, those of the dynamic ones.
    pub max_gaussians: usize,
}

/// What becomes of Gaussians that are too large.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Oversized {
    /// Removed by density control, once opacities were reset (3DGS).
    #[default]
    Removed,
    /// Shrunk to that scale along the axes that are longer, from the first step on. Ours.
    Shrunk,
}
