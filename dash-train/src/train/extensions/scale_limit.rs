//! A limit of scales: Gaussians that are too large are shrunk instead of pruned.
//!
//! A dark background is cheapest with a few Gaussians many times as long as the scene. They cost the training views
//! nothing, which see them edge-on or hidden, and are a veil before a novel view.

use burn::tensor::Tensor;
use dash_model::Gaussians;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::train::core::{Extension, Method, Rules, Run, SceneScale, Section, Set};

/// Steps between two looks: in so many a log scale grows by a tenth at most.
const INTERVAL: usize = 10;

/// Largest scale, in units of the extent, or of the distance from the scene's centre where that is more. Source: 3DGS
/// prunes above 0.1.
const MAX_SCALE: f32 = 0.1;

/// `[extensions.scale_limit]`: on or off. The largest scale is 0.1, in units of the extent, or of the distance from the scene's
/// centre where that is more, above which 3DGS prunes.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ScaleLimitConfig {}

impl Section for ScaleLimitConfig {}

/// See [`ScaleLimitConfig`].
pub struct ScaleLimit;

impl ScaleLimit {
    /// From its section.
    pub fn new(_: ScaleLimitConfig) -> Self {
        Self
    }
}

impl<M: Method> Extension<M> for ScaleLimit {
    fn name(&self) -> &'static str {
        "scale_limit"
    }

    fn density_rules(&self, _set: Set, _n: usize, rules: &mut Rules) {
        rules.prunes_oversized = false;
    }

    fn after_update(&mut self, run: &mut Run<M>) {
        // The sets in turns, so that no step of a GPU has the launches of both.
        for (set, turn) in Set::BOTH.into_iter().zip([0, INTERVAL / 2]) {
            if run.step % INTERVAL != turn {
                continue;
            }
            let gaussians = run.gaussians(set).filter(|set| !set.is_empty());
            if let Some(gaussians) = gaussians.cloned() {
                let limited = shrunk(gaussians, MAX_SCALE, run.scale());
                run.set_gaussians(set, limited);
            }
        }
    }
}

/// The same Gaussians, no axis longer than `limit` times what [`SceneScale`] says for the mean.
fn shrunk(mut set: Gaussians, limit: f32, scale: SceneScale) -> Gaussians {
    let means = set.means.val().inner();
    let centre = Tensor::<2>::from_floats([scale.centre], &means.device());
    let distance = (means - centre).square().sum_dim(1).sqrt();
    let longest = (distance.clamp_min(scale.extent) * limit).log();
    set.log_scales = set.log_scales.map(|log_scales| {
        let log_scales = log_scales.inner();
        let longest = longest.expand(log_scales.dims());
        Tensor::from_inner(log_scales.min_pair(longest)).require_grad()
    });
    set
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use burn::tensor::Device;
    use dash_model::GaussianRows;

    use super::*;
    use crate::synth;
    use crate::train::{Preset, TrainConfig, Trainer};

    const SCALE: SceneScale = SceneScale {
        centre: [1.0, 0.0, 0.0],
        extent: 2.0,
    };

    fn after(mean: [f32; 3], scales: [f32; 3]) -> [f32; 3] {
        let mut rows = GaussianRows::from_points(&[mean], &[[0.5; 3]], 0, 0.1);
        rows.log_scales[0] = scales.map(f32::ln);
        let device = Device::flex().autodiff();
        let set = Gaussians::from_rows(&rows, &device);
        let after = shrunk(set, 0.1, SCALE);
        assert!(after.log_scales.val().is_require_grad());
        after.to_rows().log_scales[0].map(f32::exp)
    }

    fn assert_close(found: [f32; 3], expected: [f32; 3]) {
        let close = |(a, b): (f32, f32)| (a / b - 1.0).abs() < 1e-5;
        assert!(
            found.into_iter().zip(expected).all(close),
            "{found:?} {expected:?}"
        );
    }

    #[test]
    fn the_long_axes_of_a_large_one_are_shortened() {
        assert_close(after([1.5, 0.0, 0.0], [52.0, 0.01, 0.3]), [0.2, 0.01, 0.2]);
        assert_close(after([1.5, 0.0, 0.0], [0.19, 0.01, 0.1]), [0.19, 0.01, 0.1]);
    }

    #[test]
    fn what_is_farther_out_may_be_larger() {
        assert_close(after([1.0, 30.0, 40.0], [52.0, 4.0, 6.0]), [5.0, 4.0, 5.0]);
    }

    #[test]
    fn training_shrinks_oversized_gaussians_where_it_is_on() {
        let longest = |is_on: bool| {
            let mut config = TrainConfig::preset(Preset::Quick);
            if !is_on {
                config.extensions.scale_limit = None;
            }
            let dataset = Arc::new(synth::loaded(6, 2, [32, 24]));
            let mut trainer = Trainer::new(config, dataset, &Device::flex()).expect("valid");
            let SceneScale { centre, extent } = trainer.run.scale();
            let large = 9.0 * extent;
            let rows = GaussianRows::from_points(&[centre], &[[0.5; 3]], 1, large);
            trainer.start_from(&rows);
            for _ in 0..INTERVAL {
                trainer.step().expect("trains");
            }
            let rows = trainer.run.scene.static_set.to_rows();
            rows.log_scales[0][0].exp() / trainer.run.extent
        };
        let shrunk = longest(true);
        assert!((shrunk / 0.1 - 1.0).abs() < 0.01, "{shrunk}");
        let left = longest(false);
        assert!(left > 1.0, "{left}");
    }
}
