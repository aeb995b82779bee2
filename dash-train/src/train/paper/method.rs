//! DASH as a method of the trainer.

use burn::tensor::{Gradients, Tensor};
use dash_model::MotionField;
use dash_model::parameters::{named_parameters, with_parameters};
use rand::SeedableRng;
use rand_pcg::Pcg64;
use serde::{Deserialize, Serialize};

use super::smoothness::{Probed, Request, probe};
use super::state::Dash;
use crate::Error;
use crate::dataset::View;
use crate::train::core::loss::static_motion;
use crate::train::core::{Forward, Method, ModuleVisit, Moved, Run, Saved, Set, ViewSums};

/// Steps between two looks at which Gaussians Eq. 5 holds still.
pub(crate) const MASK_INTERVAL: usize = 50;
/// Share of the static Gaussians' capacity that is not used before the decomposition: without room, dynamic Gaussians
/// would fill what the static set still lacks.
pub(crate) const KEPT_BACK: f32 = 0.25;
/// Keeps the slope of a square root finite at 0.
const TINY: f32 = 1e-12;
/// Parameters of the coarse field in a checkpoint.
const MOTION: &str = "motion.";

/// State that JSON holds.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct State {
    motion_space: Option<dash_model::SpaceBox>,
    has_field: bool,
    held_still: Vec<bool>,
    nothing_moves: bool,
}

impl Method for Dash {
    fn stage(run: &Run<Self>) -> &'static str {
        let stages = run.stages();
        match run.step {
            _ if !run.may_move() => "static",
            step if step < stages.warmup => "warm-up",
            step if step < stages.end => "decomposition",
            _ => "4D",
        }
    }

    fn before_step(run: &mut Run<Self>) -> Result<(), Error> {
        if !run.may_move() {
            return Ok(());
        }
        let stages = run.stages();
        if run.step == stages.warmup && stages.warmup < stages.end {
            run.start_motion()?;
            run.sampler.restart();
        }
        if run.step == stages.end {
            run.decompose()?;
            run.sampler.restart();
        }
        Ok(())
    }

    fn moved(run: &Run<Self>, view: &View) -> Result<Option<Moved>, Error> {
        if let Some(displacement) = &run.method.displacement {
            let means = run.scene.static_set.means.val();
            let squared = displacement.clone().powi_scalar(2).sum_dim(1);
            let n = squared.dims()[0];
            return Ok(Some(Moved {
                means: means + displacement.clone(),
                motion: (squared + TINY).sqrt().reshape([n]),
            }));
        }
        let Some(coefficients) = run.coefficients()? else {
            return Ok(None);
        };
        let means = run.scene.static_set.means.val();
        let displacement = run
            .method
            .basis
            .displacement(coefficients.clone(), view.time)?;
        Ok(Some(Moved {
            means: means + displacement,
            motion: run.extents(coefficients)?,
        }))
    }

    fn dynamic_splats(
        run: &mut Run<Self>,
        view: &View,
    ) -> Result<(Option<Tensor<2>>, Vec<Tensor<1>>), Error> {
        let (camera, time) = (&view.camera, view.time);
        let around = run.method.around.take();
        run.method.unsteadiness = None;
        let Some(dynamic) = &run.scene.dynamic else {
            return Ok((None, Vec::new()));
        };
        let config = &run.method.config;
        let is_smooth =
            config.smoothness > 0.0 && run.step.is_multiple_of(config.smoothness_interval);
        if !is_smooth && !run.method.asks_around || dynamic.gaussians.is_empty() {
            return Ok((run.scene.dynamic_splats(camera, time)?, Vec::new()));
        }
        let request = Request {
            share: config.smoothness_share,
            is_smooth,
            around,
            extent: run.extent,
        };
        let settings = &run.scene.settings;
        let Probed {
            features,
            smoothness,
            unsteadiness,
        } = probe(dynamic, settings, time, &request, &mut run.rng)?;
        let weight = config.smoothness * config.smoothness_interval as f32;
        let terms = smoothness.map(|term| term * weight);
        let deformed = dynamic.deform_from(settings, time, features)?;
        let splats = run.scene.deformed_splats(deformed, camera)?;
        run.method.unsteadiness = unsteadiness;
        Ok((Some(splats), terms.into_iter().collect()))
    }

    /// Eq. 5, while the coarse field looks for motion.
    fn loss_terms(
        run: &mut Run<Self>,
        _view: &View,
        forward: &Forward,
    ) -> Result<Vec<Tensor<1>>, Error> {
        let method = &run.method;
        let (Some(space), Some(_), Some(motion)) =
            (&method.motion_space, &method.motion, &forward.motion)
        else {
            return Ok(Vec::new());
        };
        let cost = static_motion(motion.clone(), &method.held_still, space.diagonal());
        Ok(vec![cost * method.config.static_motion])
    }

    fn statistics(run: &Run<Self>, view: &View, splats: &Tensor<2>) -> Option<Tensor<2>> {
        let looks_for_motion = run.method.motion_space.is_some();
        looks_for_motion.then(|| run.method.scales_in(splats, view))
    }

    fn after_backward(run: &mut Run<Self>, statistics: Option<Tensor<2>>) -> Result<(), Error> {
        if let Some(scales) = statistics {
            run.method.scales.add(scales);
            if run.step.is_multiple_of(MASK_INTERVAL) {
                run.method.held_still = run.moving()?.iter().map(|moves| !moves).collect();
            }
        }
        Ok(())
    }

    fn update(run: &mut Run<Self>, gradients: &mut Gradients) {
        run.update_motion(gradients);
    }

    fn rate_factor(run: &Run<Self>, name: &str) -> f32 {
        if !name.ends_with(".trajectories") {
            1.0
        } else if name.starts_with(Set::Static.prefix()) {
            run.stages().trajectory_rate(run.step)
        } else if run.is_synchronized() {
            // They are known already, and spans add up: their far ends should not jump by as many steps as there are spans.
            1.0 / (run.method.basis.len() as f32 / 2.0).max(1.0).sqrt()
        } else {
            1.0
        }
    }

    fn visit(&mut self, visit: &mut ModuleVisit<'_>) {
        visit.module("motion", &mut self.motion);
    }

    fn rows_changed(&mut self, set: Set, sources: &[usize]) {
        if set == Set::Static && self.motion_space.is_some() {
            self.scales = self.scales.gather(sources);
            let held_still = &self.held_still;
            self.held_still = sources.iter().map(|&row| held_still[row]).collect();
        }
    }

    fn capacity(run: &Run<Self>, set: Set) -> usize {
        let [most_static, most_dynamic] = Set::BOTH.map(|set| run.densify(set).max_gaussians);
        let may_move = run.may_move();
        match set {
            Set::Static if !may_move => most_static.saturating_add(most_dynamic),
            Set::Static if run.step <= run.stages().end => {
                most_static - (KEPT_BACK * most_static as f32) as usize
            }
            Set::Static => most_static,
            Set::Dynamic => {
                let left = most_static.saturating_sub(run.scene.static_set.len());
                most_dynamic.saturating_add(left)
            }
        }
    }

    fn began(run: &Run<Self>, set: Set) -> usize {
        match set {
            Set::Static => 0,
            Set::Dynamic => run.stages().end,
        }
    }

    /// While the coarse stages look for motion, it must stay visible.
    fn may_reset(run: &Run<Self>, set: Set) -> bool {
        set == Set::Dynamic || run.method.motion_space.is_none()
    }

    fn save(&self) -> Saved {
        let mut saved = Saved::of_values(&State {
            motion_space: self.motion_space,
            has_field: self.motion.is_some(),
            held_still: self.held_still.clone(),
            nothing_moves: self.nothing_moves,
        });
        let (weighted, weights) = self.scales.totals();
        saved.insert("weighted", weighted);
        saved.insert("weights", weights);
        if let Some(motion) = &self.motion {
            let parameters = named_parameters(motion).into_iter();
            let named = parameters.map(|(name, tensor)| (format!("{MOTION}{name}"), tensor));
            saved.tensors.extend(named);
        }
        saved
    }

    fn restore(run: &mut Run<Self>, mut saved: Saved) -> Result<(), String> {
        let state: State = saved.read()?;
        let (weighted, weights) = (saved.take("weighted")?, saved.take("weights")?);
        let n_static = run.scene.static_set.len();
        for (what, found, expected) in [
            ("motions of static", weighted.len(), n_static),
            ("weights of static", weights.len(), weighted.len()),
            ("marks of static", state.held_still.len(), n_static),
        ] {
            if found != expected && found != 0 {
                return Err(format!(
                    "{found} {what} Gaussians, of which there are {expected}"
                ));
            }
        }
        let method = &mut run.method;
        method.motion = match state.motion_space {
            Some(space) if state.has_field => {
                // Its start is replaced by what was trained; any generator does.
                let mut unused = Pcg64::seed_from_u64(0);
                let skeleton = MotionField::new(
                    &method.motion_encoder,
                    method.config.motion_field.hidden,
                    method.basis,
                    space,
                    &mut unused,
                    &run.device,
                )
                .map_err(|e| e.to_string())?;
                let tensors = std::mem::take(&mut saved.tensors).into_iter();
                let own = tensors.filter_map(|(name, tensor)| {
                    Some((name.strip_prefix(MOTION)?.to_string(), tensor))
                });
                Some(with_parameters(skeleton, own.collect()).map_err(|e| e.to_string())?)
            }
            _ => None,
        };
        if let Some(motion) = &method.motion {
            run.optimizer.check_sizes("motion", motion)?;
        }
        method.motion_space = state.motion_space;
        method.held_still = state.held_still;
        method.nothing_moves = state.nothing_moves;
        method.scales = ViewSums::from_totals(&weighted, &weights, &run.device);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use burn::tensor::Device;
    use dash_model::GaussianRows;

    use super::*;
    use crate::synth;
    use crate::train::{Preset, TrainConfig, Trainer};

    fn run() -> Run<Dash> {
        let config = TrainConfig::preset(Preset::Quick);
        let dataset = Arc::new(synth::loaded(4, 4, [32, 24]));
        let trainer = Trainer::new(config, dataset, &Device::flex()).expect("valid");
        trainer.run
    }

    #[test]
    fn dynamic_gaussians_have_the_room_that_static_ones_leave() {
        let mut run = run();
        let most = [0, 9_000, 10_000, 11_000].map(|n| {
            let points = vec![[0.0; 3]; n];
            let rows = GaussianRows::from_points(&points, &points, 0, 0.1);
            run.scene.static_set = dash_model::Gaussians::from_rows(&rows, &run.device);
            Dash::capacity(&run, Set::Dynamic)
        });
        assert_eq!(most, [14_000, 5_000, 4_000, 4_000]);
    }

    #[test]
    fn static_gaussians_leave_room_before_the_decomposition_and_have_all_where_nothing_moves() {
        let mut run = run();
        let mut most = |step: usize, nothing_moves: bool| {
            (run.step, run.method.nothing_moves) = (step, nothing_moves);
            Dash::capacity(&run, Set::Static)
        };
        assert_eq!(most(2_700, false), 7_500);
        assert_eq!(most(2_701, false), 10_000);
        assert_eq!(most(0, true), 14_000);
    }
}
