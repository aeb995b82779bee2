//! Which values a configuration may have.

use super::TrainConfig;
use crate::Error;

/// Most units of a hidden layer.
const MAX_UNITS: usize = 4096;
/// Most hidden layers.
const MAX_LAYERS: usize = 64;
/// Most functions of time of the coarse trajectories; scene files have the same limit.
const MAX_BASIS_FUNCTIONS: usize = 4096;

impl TrainConfig {
    /// Checks every value against its range.
    ///
    /// # Errors
    /// The first value that is out of range, and the range.
    pub fn validate(&self) -> Result<(), Error> {
        let check = |ok: bool, what: &str| {
            if ok {
                Ok(())
            } else {
                Err(Error::Config(what.to_string()))
            }
        };
        let shares = [
            self.sh_interval,
            self.stages.warmup,
            self.stages.decomposition,
            self.stages.settle,
            self.stages.averaged,
            self.loss.dssim,
            self.loss.moved_share,
            self.decomposition.quantile,
        ];
        check(self.iterations > 0, "iterations must be at least 1")?;
        check(self.sh_degree <= 3, "sh_degree must be 0 to 3")?;
        check(
            shares.iter().all(|s| (0.0..=1.0).contains(s)),
            "sh_interval, stages.*, loss.dssim, loss.moved_share and decomposition.quantile must be in [0, 1]",
        )?;
        check(
            self.stages.warmup <= self.stages.decomposition,
            "stages.warmup must not be after stages.decomposition",
        )?;
        check(
            self.checkpoint_interval > 0 && self.validation_interval > 0,
            "checkpoint_interval and validation_interval must be at least 1",
        )?;
        check(
            [&self.density_static, &self.density_dynamic]
                .iter()
                .all(|d| d.interval > 0),
            "density_*.interval must be at least 1",
        )?;
        check(
            [&self.density_static, &self.density_dynamic]
                .iter()
                .all(|d| d.crowd_of_split >= 0.0 && d.crowd_of_split.is_finite()),
            "density_*.crowd_of_split must not be negative",
        )?;
        check(
            [&self.density_static, &self.density_dynamic]
                .iter()
                .all(|d| d.max_scale > 0.0 && d.max_scale.is_finite()),
            "density_*.max_scale must be above 0",
        )?;
        check(
            self.near_plane
                .is_none_or(|near| near > 0.0 && near.is_finite()),
            "near_plane must be greater than 0",
        )?;
        check(
            self.ndc_limit
                .is_none_or(|limit| limit >= 1.0 && limit.is_finite()),
            "ndc_limit must be at least 1, the border of the picture",
        )?;
        check(
            self.gap_steps
                .is_none_or(|steps| steps >= 1.0 && steps.is_finite()),
            "gap_steps must be at least 1",
        )?;
        check(
            self.background
                .is_none_or(|b| b.iter().all(|v| (0.0..=1.0).contains(v))),
            "background must be three numbers in [0, 1]",
        )?;
        let decoder = &self.field.deformation;
        check(
            [self.decomposition.hidden, decoder.hidden]
                .iter()
                .all(|units| (1..=MAX_UNITS).contains(units))
                && (1..=MAX_LAYERS).contains(&decoder.layers),
            &format!(
                "decomposition.hidden and field.deformation.hidden must be 1 to {MAX_UNITS}, \
                 field.deformation.layers 1 to {MAX_LAYERS}"
            ),
        )?;
        check(
            self.decomposition.basis.len() <= MAX_BASIS_FUNCTIONS,
            &format!("decomposition.basis may have up to {MAX_BASIS_FUNCTIONS} spans"),
        )?;
        check(
            self.decomposition.promote_floor >= 0.0 && self.decomposition.promote_floor.is_finite(),
            "decomposition.promote_floor must not be negative",
        )?;
        check(
            self.decomposition.matching_floor >= 0.0
                && self.decomposition.matching_floor.is_finite(),
            "decomposition.matching_floor must not be negative",
        )?;
        check(
            (0.0..=1.0).contains(&self.decomposition.basis.anchor()),
            "decomposition.basis may have an anchor in [0, 1]",
        )?;
        let fitted = self.for_frames(2, false);
        let motion = fitted
            .decomposition
            .encoder
            .layout()
            .map_err(|e| Error::Config(format!("decomposition.encoder: {e}")))?;
        check(
            motion.dims() == 3,
            "decomposition.encoder must have 3 resolutions in base and in finest",
        )?;
        fitted
            .field
            .deformation
            .validate()
            .map_err(|e| Error::Config(format!("field.deformation: {e}")))?;
        let loss = &self.loss;
        check(
            [
                loss.static_motion,
                loss.smoothness,
                loss.field_motion,
                loss.visible_motion,
                loss.static_opacity,
                loss.nearness,
                loss.steadiness,
                loss.found_places,
            ]
            .iter()
            .all(|weight| weight.is_finite() && *weight >= 0.0),
            "the weights in loss.* must be finite and not negative",
        )?;
        check(
            loss.smoothness_share > 0.0 && loss.smoothness_share <= 1.0,
            "loss.smoothness_share must be above 0 and at most 1",
        )?;
        check(
            loss.smoothness_interval > 0,
            "loss.smoothness_interval must be at least 1",
        )?;
        check(
            self.field.cells_with_gaps > 0.0 && self.field.cells_with_gaps <= 1.0,
            "field.cells_with_gaps must be above 0 and at most 1",
        )?;
        let rates = &self.learning_rates;
        check(
            [
                rates.means,
                rates.means_final,
                rates.means_in_turns,
                rates.at_once,
                rates.quats,
                rates.scales,
                rates.opacities,
                rates.sh_dc,
                rates.sh_rest,
                rates.trajectories,
                rates.embeddings,
                rates.grid,
                rates.network,
                rates.motion_grid,
                rates.motion_network,
                rates.motion_damping,
                rates.field_final,
            ]
            .iter()
            .all(|r| r.is_finite() && *r >= 0.0),
            "learning_rates.* must be finite and not negative",
        )
    }
}
