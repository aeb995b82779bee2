//! Learning rates by parameter.

use dash_model::HashEncoder;

use super::config::OptimizerConfig;

/// Rate of means at the start, in units of the extent. Source: 3DGS, 1.6e-4.
pub(crate) const MEANS: f32 = 1.6e-4;

/// The learning rates of the scene's parameters in a run. Extensions may change them before the first step.
#[derive(Debug, Clone, PartialEq)]
pub struct Rates {
    /// Means at the start and at the end, in units of the extent.
    pub means: [f32; 2],
    /// Trajectories at the start, in units of the extent; they decay as the means.
    pub trajectories: f32,
    /// Quaternions.
    pub quats: f32,
    /// Log scales.
    pub scales: f32,
    /// Opacity logits.
    pub opacities: f32,
    /// Constant colour.
    pub sh_dc: f32,
    /// Higher colour coefficients.
    pub sh_rest: f32,
    /// Features of Gaussians' own, in fields that take them.
    pub embeddings: f32,
    /// Hash tables and feature planes.
    pub grid: f32,
    /// Decoders.
    pub network: f32,
    /// Factor of the rates of a field at the end.
    pub field_final: f32,
}

impl Rates {
    /// Those of a configuration and of 3DGS (embeddings: E-D3DGS).
    pub fn of(config: &OptimizerConfig) -> Self {
        Self {
            means: [MEANS, config.means_final],
            trajectories: MEANS,
            quats: 1e-3,
            scales: 5e-3,
            opacities: 0.05,
            sh_dc: 2.5e-3,
            sh_rest: 2.5e-3 / 20.0,
            embeddings: 2.5e-3,
            grid: config.grid,
            network: config.network,
            field_final: config.field_final,
        }
    }

    /// Factor of the rates of a field at a share of the run.
    pub(crate) fn field_left(&self, progress: f32) -> f32 {
        decay([1.0, self.field_final], progress)
    }

    /// The rate of each parameter of the scene by its path, at a share of the run, in a scene of so many world units.
    pub(super) fn at(&self, progress: f32, extent: f32) -> impl Fn(&str) -> f32 {
        let means_left = decay(self.means, progress) / self.means[0].max(1e-30);
        let means = self.means[0] * means_left * extent;
        let trajectories = self.trajectories * means_left * extent;
        let field = self.field_left(progress);
        let rates = self.clone();
        move |name| match name.rsplit('.').next() {
            Some("means") => means,
            Some("quats") => rates.quats,
            Some("log_scales") => rates.scales,
            Some("opacity_logits") => rates.opacities,
            Some("sh_dc") => rates.sh_dc,
            Some("sh_rest") => rates.sh_rest,
            Some("trajectories") => trajectories,
            Some("embeddings") => rates.embeddings * field,
            _ if HashEncoder::is_table(name) => rates.grid * field,
            _ => rates.network * field,
        }
    }
}

/// An exponential way from one rate to another; the first where either is 0.
fn decay([from, to]: [f32; 2], progress: f32) -> f32 {
    if from <= 0.0 || to <= 0.0 {
        from
    } else {
        from * (to / from).powf(progress)
    }
}
