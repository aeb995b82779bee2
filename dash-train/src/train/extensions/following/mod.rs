//! Following: the first stages see a growing window of time, so that the coarse field follows motion from frame to frame
//! instead of finding it blurred over the whole clip. Training starts in the middle of the clip and goes both ways.
//!
//! What moves fast is looked for by block matching ([`block_matching`]), what is small counts more ([`small_motion`]), and
//! before the decomposition each Gaussian gets a trajectory of its own.

mod block_matching;
mod room;
mod small_motion;
mod window;

use burn::tensor::Tensor;
use dash_model::{Gaussians, TrajectoryBasis};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use self::block_matching::{Memory, NUMBERS, meet_new_frames};
use self::small_motion::SmallMotion;
use self::window::{teaches_gaussians, time_window};
use crate::Error;
use crate::dataset::View;
use crate::train::core::loss::weighted_error;
use crate::train::core::{Extension, Forward, Run, Saved, Set, to_host};
use crate::train::paper::Dash;

/// Weight of how far fast Gaussians are from where block matching found them.
const MEMORY_WEIGHT: f32 = 0.001;
/// Part of the typical gradient that is added to Adam's denominator in the coarse field's networks.
const DAMPING: f32 = 1.0;

/// `[extensions.following]`
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct FollowingConfig {
    /// Share of the decomposition after which the coarse field hands over to trajectories of the Gaussians' own.
    /// Source: ours.
    pub handover: f32,
    /// Steps from the end of the warm-up to the handover, at least: a run in which they are fewer gives them a larger
    /// share, from a shorter warm-up and a later decomposition. Source: ours.
    pub min_steps: usize,
}

/// See [`FollowingConfig`].
pub struct Following {
    config: FollowingConfig,
    /// Where fast Gaussians were found, while the coarse field looks for motion.
    memory: Memory,
    /// What cameras saw where following begins, while the coarse field looks for motion.
    small: Option<SmallMotion>,
}

impl Following {
    /// From its section.
    pub fn new(config: FollowingConfig) -> Self {
        Self {
            config,
            memory: Memory::default(),
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
        let Some(span) = run.start.filter(|_| run.method.motion.is_some()) else {
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
        run.method.handover = self.config.handover;
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
        if run.start.is_some() && run.may_move() {
            room::make_room(run, self.config.min_steps);
        }
        Ok(())
    }

    fn before_step(&mut self, run: &mut Run<Dash>) -> Result<(), Error> {
        let stages = run.stages();
        if run.may_move() && run.step == stages.handover && stages.handover < stages.end {
            hand_over(run)?;
        }
        if run.method.motion.is_none() {
            self.memory.clear();
        }
        meet_new_frames(run, &mut self.memory)
    }

    fn next_view(&mut self, run: &mut Run<Dash>) -> Option<usize> {
        let (window, known) = time_window(run, run.step)?;
        let (views, train_views) = (&run.dataset.views, &run.train_views);
        let time = |place: usize| views[train_views[place]].time;
        let (seen, new) = (|i| window.holds(time(i)), |i| !known.holds(time(i)));
        let n = train_views.len();
        let (sampler, rng) = (&mut run.sampler, &mut run.rng);
        Some(sampler.next_of_growing(n, seen, new, time, rng))
    }

    fn before_forward(&mut self, run: &mut Run<Dash>, view: &View) {
        run.updates_scene &= teaches_gaussians(run, view.time);
    }

    fn loss_terms(
        &mut self,
        run: &mut Run<Dash>,
        view: &View,
        forward: &Forward,
    ) -> Result<Vec<Tensor<1>>, Error> {
        let mut terms = Vec::new();
        if let Some(field) = &run.method.motion {
            let (basis, device) = (run.method.basis, &run.device);
            let cost = self.memory.cost(field, basis, run.step, device)?;
            terms.extend(cost.map(|cost| cost * MEMORY_WEIGHT));
        }
        terms.extend(self.small_motion(run, view, forward)?);
        Ok(terms)
    }

    fn save(&self) -> Saved {
        let mut saved = Saved::default();
        saved.insert("memory", self.memory.to_numbers());
        saved
    }

    fn restore(&mut self, _run: &Run<Dash>, mut saved: Saved) -> Result<(), String> {
        let memory = saved.take("memory")?;
        if !memory.len().is_multiple_of(NUMBERS) {
            return Err(format!("`memory` of {} numbers", memory.len()));
        }
        self.memory = Memory::from_numbers(&memory);
        Ok(())
    }
}

/// Gives every Gaussian the trajectory that the coarse field has for it.
fn hand_over(run: &mut Run<Dash>) -> Result<(), Error> {
    let Some(own) = run.coefficients()? else {
        return Ok(());
    };
    run.method.motion = None;
    run.optimizer.forget("motion.");
    let mut rows = run.scene.static_set.to_rows();
    rows.trajectory_width = own.dims()[1];
    rows.trajectories = to_host(own);
    run.scene.static_set = Gaussians::from_rows(&rows, &run.device);
    let name = format!("{}trajectories", Set::Static.prefix());
    run.optimizer.forget(&name);
    Ok(())
}
