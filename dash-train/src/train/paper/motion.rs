//! Coarse motion (Eqs. 3-5): of a field, or of trajectories of the Gaussians' own.

use std::ops::RangeInclusive;

use burn::tensor::{Gradients, Tensor};
use dash_kernels::splats::{DEPTH, RADIUS_X};
use dash_model::decomposition::{MotionStatistics, select_dynamic};
use dash_model::{HashEncoder, MotionField, SpaceBox};

use super::config::{Form, MotionMeasure, Trajectories};
use super::state::Dash;
use crate::Error;
use crate::dataset::View;
use crate::train::core::{Rate, Run, ViewSums, to_host};

/// Sizes of scenes that are measured in their own units.
const ORDINARY_EXTENTS: RangeInclusive<f32> = 0.05..=2000.0;
/// The size of a room, metres.
const ROOM: f32 = 4.0;
/// Half the side of the released code's box, world units.
pub(super) const RELEASED_BOUND: f32 = 1.0;

impl Run<Dash> {
    /// Starts the decomposition stage.
    pub(crate) fn start_motion(&mut self) -> Result<(), Error> {
        let n = self.scene.static_set.len();
        let method = &mut self.method;
        let space = match method.config.form {
            Form::Released => SpaceBox::fixed(RELEASED_BOUND),
            Form::Paper => self.region,
        };
        method.motion = Some(MotionField::new(
            &method.motion_encoder,
            method.config.motion_field.hidden,
            method.basis,
            space,
            &mut self.rng,
            &self.device,
        )?);
        method.motion_space = Some(space);
        method.scales = ViewSums::new(n, &self.device);
        method.held_still = vec![true; n];
        Ok(())
    }

    /// Trajectory coefficients `[N, B * 3]` of all Gaussians; `None` while nothing moves and after the decomposition.
    pub(crate) fn coefficients(&self) -> Result<Option<Tensor<2>>, Error> {
        let set = &self.scene.static_set;
        Ok(match (&self.method.motion, &set.trajectories) {
            (Some(field), _) => Some(field.coefficients(set.means.val())?),
            (None, Some(own)) => Some(own.val()),
            (None, None) => None,
        })
    }

    /// How far the trajectories of `coefficients [N, B * 3]` go, `[N]`, world units. The smallest length that this tells
    /// from rest is a millionth, so scenes of an extraordinary size are measured in units that suit them.
    pub(crate) fn extents(&self, coefficients: Tensor<2>) -> Result<Tensor<1>, Error> {
        let basis = self.method.basis;
        Ok(match motion_unit(self.extent) {
            None => basis.extent(coefficients)?,
            Some(unit) => basis.extent(coefficients / unit)? * unit,
        })
    }

    /// Which Gaussians move, as far as the coarse stages know.
    pub(super) fn moving(&self) -> Result<Vec<bool>, Error> {
        let rule = &self.method.config;
        let Some(coefficients) = self.coefficients()? else {
            return Ok(vec![false; self.scene.static_set.len()]);
        };
        let extents = to_host(self.extents(coefficients)?);
        let motion: Vec<f32> = extents
            .iter()
            .zip(self.method.mean_scales())
            .map(|(extent, scale)| extent * scale)
            .collect();
        Ok(select_dynamic(
            &motion,
            rule.static_quantile,
            rule.motion_floor,
        ))
    }

    /// One step of the optimizer on the coarse field.
    pub(super) fn update_motion(&mut self, gradients: &mut Gradients) {
        let left = self.motion_left();
        if let Some(motion) = self.method.motion.take() {
            let views = self.config.batch;
            let rate = |name: &str| self.method.motion_rate(left, name).of_views(views);
            self.method.motion = Some(self.optimizer.step("motion", motion, gradients, rate));
        }
    }

    /// Factor of the coarse field's learning rates at this step. The paper's lines are thrown away after the decomposition and need not
    /// come to rest before; their rates decay with those of the 4D field, as in the released code.
    fn motion_left(&self) -> f32 {
        match self.method.config.trajectories {
            Trajectories::Linear => {
                let progress = self.step as f32 / self.config.iterations as f32;
                self.rates.field_left(progress)
            }
            Trajectories::Polyline => self.stages().field_rate(self.step),
        }
    }
}

impl Dash {
    /// How large a world unit of each visible Gaussian's motion appears in a view, and 1 beside it `[N, 2]`, given its splats `[N, C]`.
    pub(super) fn scales_in(&self, splats: &Tensor<2>, view: &View) -> Tensor<2> {
        let column = |column: usize| splats.clone().narrow(1, column, 1);
        let (depth, radius) = (column(DEPTH), column(RADIUS_X));
        let visible = radius
            .greater_elem(0.0)
            .bool_and(depth.clone().greater_elem(0.0));
        let scale = match self.config.measure {
            MotionMeasure::World => depth.ones_like(),
            MotionMeasure::DistanceWeighted => (depth.clone() * depth + 1e-6).recip(),
            MotionMeasure::Screen => {
                depth.recip() * (view.camera.fx / view.camera.width as f64) as f32
            }
        };
        let shown = visible.clone().float();
        let scale = scale.mask_fill(visible.bool_not(), 0.0);
        Tensor::cat(vec![scale, shown], 1)
    }

    /// How large a world unit of each Gaussian's motion appears, mean over the views that showed it.
    pub(crate) fn mean_scales(&self) -> Vec<f32> {
        let (sums, views) = self.scales.totals();
        MotionStatistics::from_totals(sums, views).means()
    }

    /// The rate of a parameter of the coarse field, when so much is left of it.
    pub(crate) fn motion_rate(&self, left: f32, name: &str) -> Rate {
        let config = &self.config.motion_field;
        if HashEncoder::is_table(name) {
            Rate::plain(config.grid_rate * left)
        } else {
            Rate {
                damping: self.damping,
                ..Rate::plain(config.network_rate * left)
            }
        }
    }
}

/// What makes a scene that is much smaller or larger than a room or a town about as large as a room: a power of
/// two, so that dividing by it rounds nothing.
fn motion_unit(extent: f32) -> Option<f32> {
    let extraordinary = !ORDINARY_EXTENTS.contains(&extent) && extent > 0.0 && extent.is_finite();
    extraordinary.then(|| (extent / ROOM).log2().round().exp2())
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use burn::tensor::Device;

    use crate::synth;
    use crate::train::{Preset, TrainConfig, Trainer};

    #[test]
    fn lines_learn_until_the_decomposition_and_polylines_come_to_rest() {
        let dataset = Arc::new(synth::loaded(4, 4, [32, 24]));
        // The last step of the decomposition, 8 % and 35 % of the run.
        for (preset, expected) in [
            (Preset::Paper, 0.1_f32.powf(0.08)),
            (Preset::Reference, 0.01_f32.powf(0.08)),
            (Preset::Default, 0.0),
        ] {
            let mut config = TrainConfig::preset(preset);
            config.initial_points = [50, 50];
            let trainer = Trainer::new(config, dataset.clone(), &Device::flex()).expect("valid");
            let mut run = trainer.run;
            run.step = run.stages().end - 1;
            let left = run.motion_left();
            assert!((left - expected).abs() < 2e-3, "{preset:?}: {left}");
        }
    }
}
