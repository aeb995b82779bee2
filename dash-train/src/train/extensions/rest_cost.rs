//! A cost of visible motion: Gaussians that no picture needs to move come to rest.

use burn::tensor::Tensor;
use dash_kernels::coverage::visible_motion;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::Error;
use crate::dataset::View;
use crate::train::core::{Extension, Forward, Run, Section};
use crate::train::paper::Dash;

/// Motion above which more of it costs little more, in shares of the image's width, while the field looks for it.
const FAR_IN_FIELD: f32 = 0.2;
/// The same once every Gaussian has a trajectory of its own.
const FAR_ALONE: f32 = 0.05;
/// The same of a rig: scene flow has found fast motion before, and a cost of it would only hold it back.
const FAR_OF_FLOW: f32 = 0.01;

/// Weights of visible motion, in shares of the image's width and as a mean over the picture: while the coarse field looks for
/// motion, and once every Gaussian has a trajectory of its own.
const WEIGHTS: [f32; 2] = [0.1, 2.5];
/// The same of a rig: what scene flow moves in error has to come to rest.
const WEIGHTS_OF_FLOW: [f32; 2] = [0.3, 10.0];

/// `[extensions.rest_cost]`: on or off.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct RestCostConfig {}

impl Section for RestCostConfig {}

/// A cost of visible motion.
pub struct RestCost;

impl RestCost {
    /// From its section.
    pub fn new(_: RestCostConfig) -> Self {
        Self
    }
}

impl Extension<Dash> for RestCost {
    fn name(&self) -> &'static str {
        "rest_cost"
    }

    fn loss_terms(
        &mut self,
        run: &mut Run<Dash>,
        view: &View,
        forward: &Forward,
    ) -> Result<Vec<Tensor<1>>, Error> {
        let (Some(motion), Some(_)) = (&forward.motion, run.method.motion_space) else {
            return Ok(Vec::new());
        };
        let ([looking, alone], far_alone) = match run.suits_scene_flow() {
            true => (WEIGHTS_OF_FLOW, FAR_OF_FLOW),
            false => (WEIGHTS, FAR_ALONE),
        };
        let looks = run.method.motion.is_some() || run.method.displacement.is_some();
        let (weight, far) = match looks {
            true => (looking, FAR_IN_FIELD),
            false => (alone, far_alone),
        };
        let splats = Tensor::from_inner(forward.static_splats.clone());
        let cost = visible_motion(motion.clone(), splats, &view.camera, far)?;
        Ok(vec![cost * weight])
    }
}
