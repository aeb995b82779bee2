//! Following: motion is learnt from frame to frame, instead of being found blurred over the whole clip. Training starts in
//! the middle of the clip and goes both ways.
//!
//! A rig shows where everything is at each time: scene flow registers the Gaussians to one frame after another
//! ([`scene_flow`]), and fast ones are looked for by block matching ([`block_matching`]). A monocular capture
//! does not: its coarse field sees a growing window of time ([`window`]). Small moving objects count more
//! ([`small_motion`]), and before the decomposition each Gaussian gets a trajectory of its own.

mod block_matching;
mod scene_flow;
mod small_motion;
mod steps;
mod window;

pub(crate) use self::steps::{FLOW_END, FLOW_REST, FLOW_WARMUP, FRAME_STEPS, stages_of_flow};

use burn::tensor::{Gradients, Tensor};
use dash_model::{Gaussians, TrajectoryBasis};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use self::scene_flow::SceneFlow;
use self::small_motion::SmallMotion;
use self::window::{teaches_gaussians, time_window};
use crate::Error;
use crate::dataset::View;
use crate::train::core::loss::weighted_error;
use crate::train::core::{
    Extension, Forward, GradientVisit, Ranges, RowEdit, Run, Saved, Section, Set, to_host,
};
use crate::train::paper::Dash;

/// Share of the typical gradient that is added to Adam's denominator in the coarse field's networks.
const DAMPING: f32 = 1.0;
/// Share of the decomposition after which scene flow hands over, as of a rig: what does not move then comes to rest.
const FLOW_HANDOVER: f32 = 0.8;

/// `[extensions.following]`
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct FollowingConfig {
    /// Share of the decomposition after which the coarse field hands over to trajectories of the Gaussians' own.
    /// Source: ours.
    pub handover: f32,
    /// Steps from the end of the warm-up to the handover, at least: a run in which they are fewer gives them a larger
    /// share, from a shorter warm-up and a later decomposition. Not with scene flow. Source: ours.
    pub min_steps: usize,
}

impl Section for FollowingConfig {
    fn check(&self, ranges: &mut Ranges) {
        ranges.share("handover", self.handover);
    }
}

impl FollowingConfig {
    /// The handover of a capture that scene flow finds motion in, or of another.
    pub(crate) fn handover_of(&self, has_scene_flow: bool) -> f32 {
        match has_scene_flow {
            true => FLOW_HANDOVER,
            false => self.handover,
        }
    }
}

/// See [`FollowingConfig`].
pub struct Following {
    config: FollowingConfig,
    /// From the warm-up of a rig until the handover.
    flow: Option<SceneFlow>,
    /// What cameras saw where following begins, while motion is looked for.
    small: Option<SmallMotion>,
}

impl Following {
    /// From its section.
    pub fn new(config: FollowingConfig) -> Self {
        Self {
            config,
            flow: None,
            small: None,
        }
    }

    /// What changed counts more in the error, as far as it covers little.
    fn small_motion(
        &mut self,
        run: &Run<Dash>,
        view: &View,
        forward: &Forward,
    ) -> Result<Option<Tensor<1>>, Error> {
        let looks = run.method.motion.is_some() || self.flow.is_some();
        let Some(span) = run.start.filter(|_| looks) else {
            self.small = None;
            return Ok(None);
        };
        // A resumed run looks again.
        let small = match self.small.take() {
            Some(small) => small,
            None => SmallMotion::since(run, span)?,
        };
        let small = self.small.insert(small);
        let weights = match &forward.target_on_host {
            Some(rgb) => small.weights(view, rgb),
            None => small.weights(view, &view.rgb(run.scene.settings.background)?),
        };
        Ok(weights.map(|weights| {
            let (image, target) = (forward.image.clone(), forward.target.clone());
            weighted_error(image, target, weights) * (1.0 - run.config.dssim)
        }))
    }
}

impl Extension<Dash> for Following {
    fn name(&self) -> &'static str {
        "following"
    }

    /// Trajectories start from where things are in the middle of the span that following starts from.
    fn init(&mut self, run: &mut Run<Dash>) {
        run.method.handover = self.config.handover_of(run.suits_scene_flow());
        run.method.damping = DAMPING;
        if let Some(span) = run.start {
            // A line is a polyline of one span.
            run.method.basis = TrajectoryBasis::Polyline {
                spans: run.method.basis.len(),
                anchor: span.middle(),
            };
            run.scene.settings.trajectory_basis = run.method.basis;
        }
    }

    fn begin(&mut self, run: &mut Run<Dash>) -> Result<(), Error> {
        if run.may_move() && run.suits_scene_flow() {
            steps::lengthen_for_flow(run);
        } else if run.may_move() && run.start.is_some() {
            steps::lengthen(run, self.config.min_steps);
        }
        Ok(())
    }

    fn before_step(&mut self, run: &mut Run<Dash>) -> Result<(), Error> {
        let stages = run.stages();
        let steps = [stages.warmup, stages.handover];
        run.method.displacement = None;
        if run.may_move() && run.suits_scene_flow() && (steps[0]..steps[1]).contains(&run.step) {
            // The coarse field is not asked.
            run.method.motion = None;
            let flow = self.flow.get_or_insert_with(|| SceneFlow::new(run));
            flow.advance(run, steps)?;
        } else if run.may_move() && run.step == stages.handover && stages.handover < stages.end {
            hand_over(run)?;
        }
        Ok(())
    }

    fn next_view(&mut self, run: &mut Run<Dash>) -> Option<usize> {
        if let Some(flow) = &self.flow {
            let shows = |&view: &usize| flow.shows(run, &run.dataset.views[view]);
            let shown: Vec<bool> = run.train_views.iter().map(shows).collect();
            let next = run
                .sampler
                .next(shown.len(), |place| shown[place], &mut run.rng);
            return Some(next);
        }
        let (window, known) = time_window(run, run.step)?;
        let (views, train_views) = (&run.dataset.views, &run.train_views);
        let time = |place: usize| views[train_views[place]].time;
        let (seen, new) = (|i| window.holds(time(i)), |i| !known.holds(time(i)));
        let n = train_views.len();
        let (sampler, rng) = (&mut run.sampler, &mut run.rng);
        Some(sampler.next_of_growing(n, seen, new, time, rng))
    }

    fn before_forward(&mut self, run: &mut Run<Dash>, view: &View) -> Result<(), Error> {
        run.updates_scene &= self.flow.is_some() || teaches_gaussians(run, view.time);
        if let Some(flow) = &mut self.flow {
            run.method.displacement = flow.displacement(run)?;
        }
        Ok(())
    }

    fn loss_terms(
        &mut self,
        run: &mut Run<Dash>,
        view: &View,
        forward: &Forward,
    ) -> Result<Vec<Tensor<1>>, Error> {
        Ok(self.small_motion(run, view, forward)?.into_iter().collect())
    }

    fn gradients(&self, visit: &mut GradientVisit<'_>) {
        if let Some(flow) = &self.flow {
            flow.gradients(visit);
        }
    }

    fn after_backward(&mut self, run: &mut Run<Dash>, gradients: &mut Gradients) {
        if let Some(flow) = &mut self.flow {
            flow.learn(run, gradients);
        }
    }

    fn after_step(&mut self, run: &mut Run<Dash>) -> Result<(), Error> {
        if run.step == run.stages().handover
            && let Some(flow) = self.flow.take()
        {
            let own = flow.trajectories(run, run.method.basis)?;
            give_trajectories(run, own);
        }
        Ok(())
    }

    fn rows_changed(&mut self, edit: &RowEdit) {
        if let Some(flow) = &mut self.flow
            && edit.set == Set::Static
        {
            flow.gather(&edit.sources);
        }
    }

    fn save(&self) -> Saved {
        self.flow
            .as_ref()
            .map_or_else(Saved::default, SceneFlow::save)
    }

    fn restore(&mut self, run: &Run<Dash>, saved: Saved) -> Result<(), String> {
        self.flow = match saved == Saved::default() {
            true => None,
            false => Some(SceneFlow::restore(run, saved)?),
        };
        Ok(())
    }
}

/// Gives every Gaussian the trajectory that the coarse field has for it.
fn hand_over(run: &mut Run<Dash>) -> Result<(), Error> {
    if run.method.motion.is_some()
        && let Some(own) = run.coefficients()?
    {
        give_trajectories(run, own);
    }
    Ok(())
}

/// Gives every Gaussian a trajectory of its own, of coefficients `[N, B * 3]`, in place of the coarse field.
fn give_trajectories(run: &mut Run<Dash>, own: Tensor<2>) {
    run.method.motion = None;
    run.optimizer.forget("motion.");
    run.optimizer.forget("scene_flow.");
    let mut rows = run.scene.static_set.to_rows();
    rows.trajectory_width = own.dims()[1];
    rows.trajectories = to_host(own);
    run.scene.static_set = Gaussians::from_rows(&rows, &run.device);
    let name = format!("{}trajectories", Set::Static.prefix());
    run.optimizer.forget(&name);
}
