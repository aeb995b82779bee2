//! Time gaps: times between training views that are too far apart to be interpolated by the field alone.
//!
//! Through a gap Gaussians go in straight lines, or turn once where they agree on it. Beside one the field is coarser, and
//! a monocular capture has dynamic Gaussians go straight and steadily between neighbouring times.

use burn::tensor::Tensor;
use dash_model::Gaps;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::Error;
use crate::dataset::View;
use crate::train::core::{Extension, Forward, Ranges, Run, Section};
use crate::train::paper::Dash;

/// Typical steps between training times above which they are ends of a gap: between one step and two.
const GAP_STEPS: f32 = 1.5;
/// The same for gaps that make the field coarser.
const LONG_GAP_STEPS: f32 = 3.5;

/// `[extensions.gaps]`
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct GapsConfig {
    /// Factor of the field's resolutions in space where a monocular capture lacks three times in a row or more. Motion into a
    /// gap is continued from the times beside it; fine cells see one picture each, too few to show that motion. Source: ours.
    pub coarsen: f32,
    /// Weight of how far dynamic Gaussians are from a straight way at one speed between neighbouring training times, in
    /// units of the extent, times the photometric loss, in monocular captures. Source: ours.
    pub steadiness: f32,
}

impl Section for GapsConfig {
    fn check(&self, ranges: &mut Ranges) {
        ranges.factor("coarsen", self.coarsen);
        ranges.not_negative("steadiness", self.steadiness);
    }
}

/// See [`GapsConfig`].
pub struct TimeGaps(GapsConfig);

impl TimeGaps {
    /// From its section.
    pub fn new(config: GapsConfig) -> Self {
        Self(config)
    }
}

impl Extension<Dash> for TimeGaps {
    fn name(&self) -> &'static str {
        "gaps"
    }

    fn init(&mut self, run: &mut Run<Dash>) {
        let times: Vec<f32> = run.views().map(|view| view.time).collect();
        let between = |steps: f32| Gaps::between(times.iter().copied(), steps);
        run.scene.settings.gaps = between(GAP_STEPS);
        let is_synchronized = run.is_synchronized();
        if between(LONG_GAP_STEPS).any_closed() && !is_synchronized {
            let encoder = &mut run.method.field.encoder;
            for cells in [&mut encoder.base_resolution, &mut encoder.finest_resolution] {
                for axis in cells.iter_mut().take(3) {
                    *axis = ((*axis as f32 * self.0.coarsen).ceil() as u32).max(1);
                }
            }
        }
        run.method.asks_around = self.0.steadiness > 0.0 && !is_synchronized;
    }

    fn before_forward(&mut self, run: &mut Run<Dash>, view: &View) -> Result<(), Error> {
        let dynamic = run.scene.dynamic.as_ref();
        let has_dynamic = dynamic.is_some_and(|dynamic| !dynamic.gaussians.is_empty());
        if run.method.asks_around && has_dynamic {
            run.method.around = run.times.around(view.time, &mut run.rng);
        }
        Ok(())
    }

    fn loss_terms(
        &mut self,
        run: &mut Run<Dash>,
        _view: &View,
        forward: &Forward,
    ) -> Result<Vec<Tensor<1>>, Error> {
        let Some(cost) = run.method.unsteadiness.take() else {
            return Ok(Vec::new());
        };
        Ok(vec![weighed(cost, &forward.loss, self.0.steadiness)])
    }
}

/// A cost that counts as much as the photometric loss is large: the less exactly pictures can be matched, the less each
/// of them says about where things are. The loss itself gains nothing by it.
fn weighed(cost: Tensor<1>, photometric: &Tensor<1>, weight: f32) -> Tensor<1> {
    cost * photometric.clone().detach() * weight
}

#[cfg(test)]
mod tests {
    use burn::tensor::Device;

    use super::*;
    use crate::train::core::to_host;

    #[test]
    fn steadiness_counts_by_the_photometric_loss() {
        let device = Device::flex().autodiff();
        let leaf = |value: f32| Tensor::<1>::from_floats([value], &device).require_grad();
        let (cost, photometric) = (leaf(2.0), leaf(0.25));
        let term = weighed(cost.clone(), &photometric, 20.0);
        assert_eq!(to_host(term.clone()), [10.0]);
        let gradients = term.backward();
        let v_cost = cost.grad(&gradients).expect("counts");
        assert_eq!(to_host(v_cost), [5.0]);
        assert!(photometric.grad(&gradients).is_none());
    }
}
