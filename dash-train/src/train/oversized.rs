//! Gaussians that are too large are shrunk.
//!
//! What a dark background needs is cheapest with a few Gaussians many times as long as the scene. They cost the training
//! views nothing that they pass edge-on or behind something, and are a veil before a camera that was held out.

use burn::tensor::Tensor;
use dash_model::Gaussians;

use super::config::{DensityConfig, Oversized};
use super::density::Measure;
use super::trainer::Trainer;

/// Steps between two looks: in so many a log scale grows by a tenth at most.
const INTERVAL: usize = 10;

/// Shrinks those of both sets that are too large, where that is asked for and due with the trainer's step.
pub(crate) fn shrink(trainer: &mut Trainer, measure: Measure) {
    if !trainer.step.is_multiple_of(INTERVAL) {
        return;
    }
    let config = &trainer.config;
    let scene = &mut trainer.scene;
    if shrinks(&config.density_static, &scene.static_set) {
        let limit = config.density_static.max_scale;
        scene.static_set = shrunk(scene.static_set.clone(), limit, measure);
    }
    if let Some(dynamic) = &mut scene.dynamic
        && shrinks(&config.density_dynamic, &dynamic.gaussians)
    {
        let limit = config.density_dynamic.max_scale;
        dynamic.gaussians = shrunk(dynamic.gaussians.clone(), limit, measure);
    }
}

fn shrinks(config: &DensityConfig, set: &Gaussians) -> bool {
    config.oversized == Oversized::Shrunk && !set.is_empty()
}

/// The same Gaussians, no axis longer than `limit` times what [`Measure`] says for the mean.
fn shrunk(mut set: Gaussians, limit: f32, measure: Measure) -> Gaussians {
    let means = set.means.val().inner();
    let centre = Tensor::<2>::from_floats([measure.centre], &means.device());
    let distance = (means - centre).square().sum_dim(1).sqrt();
    let longest = (distance.clamp_min(measure.extent) * limit).log();
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
    use crate::train::trainer::start_from;
    use crate::train::{Preset, TrainConfig};

    const MEASURE: Measure = Measure {
        centre: [1.0, 0.0, 0.0],
        extent: 2.0,
    };

    fn after(mean: [f32; 3], scales: [f32; 3]) -> [f32; 3] {
        let mut rows = GaussianRows::from_points(&[mean], &[[0.5; 3]], 0, 0.1);
        rows.log_scales[0] = scales.map(f32::ln);
        let device = Device::flex().autodiff();
        let set = Gaussians::from_rows(&rows, &device);
        let after = shrunk(set, 0.1, MEASURE);
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
    fn training_shrinks_what_is_too_large_unless_it_is_to_be_removed() {
        let longest = |oversized: Oversized| {
            let mut config = TrainConfig::preset(Preset::Quick);
            config.density_static.oversized = oversized;
            let dataset = Arc::new(synth::loaded(6, 2, [32, 24]));
            let mut trainer = Trainer::new(config, dataset, &Device::flex()).expect("valid");
            let middle = trainer.core.space;
            let middle = std::array::from_fn(|axis| 0.5 * (middle.min[axis] + middle.max[axis]));
            let large = 9.0 * trainer.extent;
            let rows = GaussianRows::from_points(&[middle], &[[0.5; 3]], 1, large);
            start_from(&mut trainer, &rows);
            for _ in 0..INTERVAL {
                trainer.step().expect("trains");
            }
            let rows = trainer.scene.static_set.to_rows();
            rows.log_scales[0][0].exp() / trainer.extent
        };
        let shrunk = longest(Oversized::Shrunk);
        assert!((shrunk / 0.1 - 1.0).abs() < 0.01, "{shrunk}");
        let left = longest(Oversized::Removed);
        assert!(left > 1.0, "{left}");
    }
}
