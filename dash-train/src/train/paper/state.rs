//! The state of a run of DASH beside the scene.

use burn::tensor::Tensor;
use dash_model::{DeformationConfig, HashEncoderConfig, MotionField, SpaceBox, TrajectoryBasis};

use super::config::{Decomposition, MethodConfig, Trajectories, spans};
use super::stages::Stages;
use crate::Error;
use crate::train::core::{Around, CaptureFacts, Run, ViewSums};

/// Most spans of a polyline.
const MAX_SPANS: usize = 48;

/// Marks Gaussians of a run's static set, given which of them move.
pub(crate) type FindGaussians = Box<dyn Fn(&Run<Dash>, &[bool]) -> Result<Vec<bool>, Error> + Send>;

/// What DASH keeps beside the scene.
pub struct Dash {
    /// Its configuration; an extension may move the stages before the first step.
    pub config: MethodConfig,
    /// Share of the decomposition after which the coarse field hands over to trajectories of the Gaussians' own; at 1
    /// it stays until the decomposition, as in the paper.
    pub handover: f32,
    /// Form of the coarse trajectories.
    pub basis: TrajectoryBasis,
    /// The coarse field's encoder.
    pub(crate) motion_encoder: HashEncoderConfig,
    /// Share of the typical gradient that is added to Adam's denominator in the networks of the coarse field; 0 is plain
    /// Adam. All of the scene shares these networks: steps of full length along next to no gradient would shake what is
    /// at rest.
    pub damping: f32,
    /// The 4D field to be made.
    pub field: DeformationConfig,
    /// Whether it was found that nothing moves.
    pub nothing_moves: bool,
    /// The coarse field, from the warm-up until Gaussians have trajectories of their own.
    pub motion: Option<MotionField>,
    /// The space of coarse motion; present from the warm-up to the decomposition.
    pub motion_space: Option<SpaceBox>,
    /// How large a world unit of each Gaussian's motion appears, summed over views.
    pub scales: ViewSums,
    /// Which Gaussians Eq. 5 holds still.
    pub held_still: Vec<bool>,
    /// Where an extension puts the static set in the step's view, relative to its means `[N, 3]`.
    pub(crate) displacement: Option<Tensor<2>>,
    /// Whether an extension asks for dynamic Gaussians at times around the present view's.
    pub(crate) asks_around: bool,
    /// These times, where there are any around the present view's.
    pub(crate) around: Option<Around>,
    /// Which Gaussians an extension makes dynamic at the decomposition, because they change otherwise; told which ones move.
    pub(crate) find_changing: Option<FindGaussians>,
    /// What was found there: mean distance of dynamic Gaussians from a straight way, in extents.
    pub(crate) unsteadiness: Option<Tensor<1>>,
}

impl Dash {
    /// For a capture.
    pub fn new(config: MethodConfig, facts: &CaptureFacts) -> Self {
        let basis = match config.trajectories {
            Trajectories::Linear => TrajectoryBasis::Linear,
            Trajectories::Polyline => {
                TrajectoryBasis::polyline(spans(facts.n_frames).min(MAX_SPANS))
            }
        };
        Self {
            handover: 1.0,
            basis,
            motion_encoder: config.motion_encoder(),
            damping: 0.0,
            field: config.deformation(facts),
            nothing_moves: false,
            motion: None,
            motion_space: None,
            scales: ViewSums::default(),
            held_still: Vec::new(),
            displacement: None,
            asks_around: false,
            around: None,
            find_changing: None,
            unsteadiness: None,
            config,
        }
    }

    /// The shares of the run at which the stages end: warm-up, handover, decomposition.
    pub(crate) fn stage_shares(&self) -> [f32; 3] {
        let [warmup, decomposition] = self.config.stages;
        let end = match self.config.decomposition {
            Decomposition::All => warmup,
            Decomposition::Moving | Decomposition::AllWithMotion | Decomposition::None => {
                decomposition
            }
        };
        [warmup, warmup + self.handover * (end - warmup), end]
    }
}

impl Run<Dash> {
    /// The steps at which stages change.
    pub fn stages(&self) -> Stages {
        let shares = self.method.stage_shares();
        let [warmup, handover, end] = shares.map(|share| self.config.step_at(share));
        Stages {
            warmup,
            handover,
            end,
        }
    }

    /// Whether anything may move in this run.
    pub fn may_move(&self) -> bool {
        self.method.config.decomposition != Decomposition::None
            && self.dataset.n_frames > 1
            && !self.method.nothing_moves
    }

    /// Whether Gaussians can be registered to each time by itself, and have trajectories that follow.
    pub fn suits_scene_flow(&self) -> bool {
        self.is_synchronized() && self.method.config.trajectories == Trajectories::Polyline
    }

    /// Whether the step that begins has made Gaussians dynamic.
    pub fn has_just_decomposed(&self) -> bool {
        self.may_move() && self.step == self.stages().end && self.scene.dynamic.is_some()
    }
}
