//! Backward node of [`squared_extent`](super::squared_extent).

use burn::backend::Autodiff;
use burn::backend::autodiff::checkpoint::{base::Checkpointer, strategy::CheckpointStrategy};
use burn::backend::autodiff::grads::Gradients;
use burn::backend::autodiff::ops::{Backward, Ops, OpsKind};
use burn::backend::tensor::FloatTensor;

use super::{Polyline, SquaredExtent, SquaredExtentVjp};

#[derive(Debug)]
struct SquaredExtentBackward;

impl<B: SquaredExtentVjp> Backward<B, 1> for SquaredExtentBackward {
    type State = (FloatTensor<B>, Polyline);

    fn backward(self, ops: Ops<Self::State, 1>, grads: &mut Gradients, _: &mut Checkpointer) {
        let v_out = grads.consume::<B>(&ops.node);
        let (coefficients, polyline) = ops.state;
        let [parent] = ops.parents;
        if let Some(node) = parent {
            let gradient = B::squared_extent_vjp(coefficients, v_out, polyline);
            grads.register::<B>(node.id, gradient);
        }
    }
}

impl<B: SquaredExtentVjp, C: CheckpointStrategy> SquaredExtent for Autodiff<B, C> {
    fn squared_extent(coefficients: FloatTensor<Self>, polyline: Polyline) -> FloatTensor<Self> {
        let (coefficients, node) = coefficients.into_parts();
        match SquaredExtentBackward
            .prepare::<C>([node])
            .compute_bound()
            .stateful()
        {
            OpsKind::Tracked(prep) => {
                let out = B::squared_extent(coefficients.clone(), polyline);
                prep.finish((coefficients, polyline), out)
            }
            OpsKind::UnTracked(prep) => prep.finish(B::squared_extent(coefficients, polyline)),
        }
    }
}
