//! A cost of floaters: dark smoke in empty space, which no training picture tells from what is behind it.

use std::collections::BTreeSet;

use burn::tensor::Tensor;
use dash_kernels::coverage::{FloaterWeights, floater_cost};
use dash_model::Gaussians;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::Error;
use crate::dataset::View;
use crate::train::core::{Extension, Forward, Run, Section};

/// Weight of the mean opacity of the static Gaussians: what no picture needs fades. Source: Kheradmand et al. 2024 (MCMC), 0.01.
const OPACITY: f32 = 0.01;
/// Weight of what Gaussians cover of the picture from nearer than half of the typical distance.
const NEARNESS: f32 = 0.016;
/// Up to so many poses of a monocular capture the cost of opacity has its whole weight.
const WHOLE_WEIGHT_POSES: usize = 16;

/// `[extensions.floaters]`: on or off.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct FloatersConfig {}

impl Section for FloatersConfig {}

/// A cost of opacity, which in monocular captures of more than 16 training poses falls as 16 / poses, and a cost of nearness.
pub struct Floaters {
    /// Factor of the cost of opacity.
    opacity_factor: f32,
    /// Weight of nearness.
    pub(crate) nearness: f32,
}

impl Floaters {
    /// From its section.
    pub fn new(_: FloatersConfig) -> Self {
        Self {
            opacity_factor: 1.0,
            nearness: NEARNESS,
        }
    }
}

/// What one pose alone gains from a floater is one part of `poses` of the loss, and so is the cost that stops it. More
/// would make surfaces translucent, where a time has one picture that holds them in place.
fn opacity_factor(poses: usize) -> f32 {
    WHOLE_WEIGHT_POSES as f32 / poses.max(WHOLE_WEIGHT_POSES) as f32
}

impl<M> Extension<M> for Floaters {
    fn name(&self) -> &'static str {
        "floaters"
    }

    fn init(&mut self, run: &mut Run<M>) {
        if !run.is_synchronized() {
            let poses: BTreeSet<usize> = run.views().map(|view| view.camera_index).collect();
            self.opacity_factor = opacity_factor(poses.len());
        }
    }

    fn loss_terms(
        &mut self,
        run: &mut Run<M>,
        view: &View,
        forward: &Forward,
    ) -> Result<Vec<Tensor<1>>, Error> {
        let of_static = FloaterWeights {
            opacity: OPACITY * self.opacity_factor,
            nearness: self.nearness,
        };
        let of_dynamic = FloaterWeights {
            opacity: 0.0,
            ..of_static
        };
        let cost = |set: &Gaussians, splats: &Tensor<2>, motion, weights: FloaterWeights| {
            let logits = set.opacity_logits.val();
            let splats = Tensor::from_inner(splats.clone());
            floater_cost(logits, splats, motion, &view.camera, weights)
        };
        let mut terms = Vec::new();
        let static_set = &run.scene.static_set;
        if !static_set.is_empty() {
            let motion = forward.motion.clone();
            terms.push(cost(static_set, &forward.static_splats, motion, of_static)?);
        }
        if let (Some(dynamic), Some(splats)) = (&run.scene.dynamic, &forward.dynamic_splats)
            && !dynamic.gaussians.is_empty()
        {
            terms.push(cost(&dynamic.gaussians, splats, None, of_dynamic)?);
        }
        Ok(terms)
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use burn::tensor::Device;

    use super::*;
    use crate::dataset::Partition;
    use crate::synth;
    use crate::train::{Preset, TrainConfig, Trainer};

    /// The factor of a run on views of 24 cameras.
    fn of_a_run(keeps: impl Fn(&View) -> bool) -> f32 {
        let mut dataset = synth::loaded(24, 96, [16, 16]);
        dataset.views.retain(|view| keeps(view));
        for view in &mut dataset.views {
            view.partition = Partition::Train;
        }
        let config = TrainConfig::preset(Preset::Quick);
        let trainer = Trainer::new(config, Arc::new(dataset), &Device::flex()).expect("valid");
        trainer.hooks.get::<Floaters>().expect("on").opacity_factor
    }

    #[test]
    fn the_cost_of_opacity_falls_with_the_poses() {
        assert_eq!(opacity_factor(1), 1.0);
        assert_eq!(opacity_factor(16), 1.0);
        assert_eq!(opacity_factor(160), 0.1);
    }

    #[test]
    fn poses_count_once_in_monocular_captures() {
        assert_eq!(of_a_run(|_| true), 1.0);
        let in_turns = |view: &View, n: usize| view.camera_index == 7 * view.frame % n;
        assert_eq!(of_a_run(|view| in_turns(view, 24)), 16.0 / 24.0);
        assert_eq!(of_a_run(|view| in_turns(view, 12)), 1.0);
    }
}
