//! A cost of visible motion: Gaussians that no picture needs to move come to rest.

use burn::tensor::Tensor;
use dash_kernels::coverage::visible_motion;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::Error;
use crate::dataset::View;
use crate::train::core::{Extension, Forward, Run};
use crate::train::paper::Dash;

/// Motion above which more of it costs little more, in shares of the image's width, while the field looks for it.
const FAR_IN_FIELD: f32 = 0.2;
/// The same once every Gaussian has a trajectory of its own.
const FAR_ALONE: f32 = 0.05;
/// The same of a rig: scene flow has found fast motion before, and a cost of it would only hold it back.
const FAR_OF_FLOW: f32 = 0.01;

/// `[extensions.rest_cost]`
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct RestCostConfig {
    /// Weight of visible motion while the coarse field looks for motion, in shares of the image's width and as a mean over
    /// the picture. Source: ours.
    pub field: f32,
    /// Weight of visible motion once every Gaussian has a trajectory of its own. Source: ours.
    pub gaussians: f32,
    /// `field` and `gaussians` where scene flow finds motion, as of a rig: what it moves in error has to come to rest. Source: ours.
    pub flow: [f32; 2],
}

/// See [`RestCostConfig`].
pub struct RestCost(pub(crate) RestCostConfig);

impl RestCost {
    /// From its section.
    pub fn new(config: RestCostConfig) -> Self {
        Self(config)
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
            true => (self.0.flow, FAR_OF_FLOW),
            false => ([self.0.field, self.0.gaussians], FAR_ALONE),
        };
        let looks = run.method.motion.is_some() || run.method.displacement.is_some();
        let (weight, far) = match looks {
            true => (looking, FAR_IN_FIELD),
            false => (alone, far_alone),
        };
        // A cost of no weight is not worked out.
        if weight <= 0.0 {
            return Ok(Vec::new());
        }
        let splats = Tensor::from_inner(forward.static_splats.clone());
        let cost = visible_motion(motion.clone(), splats, &view.camera, far)?;
        Ok(vec![cost * weight])
    }
}
