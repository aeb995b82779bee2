//! Backward node of [`space_time`](super::space_time).

use burn::backend::Autodiff;
use burn::backend::autodiff::checkpoint::{base::Checkpointer, strategy::CheckpointStrategy};
use burn::backend::autodiff::grads::Gradients;
use burn::backend::autodiff::ops::{Backward, Ops, OpsKind};
use burn::backend::tensor::FloatTensor;

use super::{Bounds, SpaceTime, SpaceTimeVjp};

#[derive(Debug)]
struct SpaceTimeBackward;

impl<B: SpaceTimeVjp> Backward<B, 1> for SpaceTimeBackward {
    type State = (FloatTensor<B>, Bounds);

    fn backward(self, ops: Ops<Self::State, 1>, grads: &mut Gradients, _: &mut Checkpointer) {
        let v_out = grads.consume::<B>(&ops.node);
        let (positions, bounds) = ops.state;
        let [parent] = ops.parents;
        if let Some(node) = parent {
            grads.register::<B>(node.id, B::space_time_vjp(positions, v_out, bounds));
        }
    }
}

impl<B: SpaceTimeVjp, C: CheckpointStrategy> SpaceTime for Autodiff<B, C> {
    fn space_time(
        positions: FloatTensor<Self>,
        steps: FloatTensor<Self>,
        rows: Vec<u32>,
        bounds: Bounds,
        time: f32,
    ) -> FloatTensor<Self> {
        let ((positions, node), (steps, _)) = (positions.into_parts(), steps.into_parts());
        match SpaceTimeBackward
            .prepare::<C>([node])
            .compute_bound()
            .stateful()
        {
            OpsKind::Tracked(prep) => {
                let out = B::space_time(positions.clone(), steps, rows, bounds, time);
                prep.finish((positions, bounds), out)
            }
            OpsKind::UnTracked(prep) => {
                prep.finish(B::space_time(positions, steps, rows, bounds, time))
            }
        }
    }
}
