//! Backward nodes of [`visible_motion`](super::visible_motion) and [`nearness`](super::nearness).

use burn::backend::Autodiff;
use burn::backend::autodiff::checkpoint::{base::Checkpointer, strategy::CheckpointStrategy};
use burn::backend::autodiff::grads::Gradients;
use burn::backend::autodiff::ops::{Backward, Ops, OpsKind};
use burn::backend::tensor::FloatTensor;

use super::{Coverage, CoverageVjp, FloaterWeights, PictureSize};

/// The gradient of a cost was worked out with it; here it is multiplied by the loss's.
#[derive(Debug)]
struct CostBackward;

impl<B: CoverageVjp> Backward<B, 1> for CostBackward {
    /// The gradient of the cost.
    type State = FloatTensor<B>;

    fn backward(self, ops: Ops<Self::State, 1>, grads: &mut Gradients, _: &mut Checkpointer) {
        let v_cost = grads.consume::<B>(&ops.node);
        let [parent] = ops.parents;
        if let Some(node) = parent {
            grads.register::<B>(node.id, B::float_mul(ops.state, v_cost));
        }
    }
}

impl<B: CoverageVjp, C: CheckpointStrategy> Coverage for Autodiff<B, C> {
    fn visible_motion(
        extents: FloatTensor<Self>,
        splats: FloatTensor<Self>,
        picture: PictureSize,
        far: f32,
    ) -> FloatTensor<Self> {
        let ((extents, node), (splats, _)) = (extents.into_parts(), splats.into_parts());
        match CostBackward.prepare::<C>([node]).compute_bound().stateful() {
            OpsKind::Tracked(prep) => {
                let (cost, gradient) =
                    B::visible_motion_and_gradient(extents, splats, picture, far);
                prep.finish(gradient, cost)
            }
            OpsKind::UnTracked(prep) => {
                prep.finish(B::visible_motion(extents, splats, picture, far))
            }
        }
    }

    fn floater_cost(
        opacity_logits: FloatTensor<Self>,
        splats: FloatTensor<Self>,
        motion: FloatTensor<Self>,
        picture: PictureSize,
        weights: FloaterWeights,
        moves: bool,
    ) -> FloatTensor<Self> {
        let ((logits, node), (splats, _)) = (opacity_logits.into_parts(), splats.into_parts());
        let (motion, _) = motion.into_parts();
        match CostBackward.prepare::<C>([node]).compute_bound().stateful() {
            OpsKind::Tracked(prep) => {
                let (cost, gradient) =
                    B::floater_cost_and_gradient(logits, splats, motion, picture, weights, moves);
                prep.finish(gradient, cost)
            }
            OpsKind::UnTracked(prep) => prep.finish(B::floater_cost(
                logits, splats, motion, picture, weights, moves,
            )),
        }
    }
}
