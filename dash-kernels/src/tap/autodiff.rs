//! Backward node of [`tap`](super::tap).

use burn::backend::Autodiff;
use burn::backend::autodiff::checkpoint::{base::Checkpointer, strategy::CheckpointStrategy};
use burn::backend::autodiff::grads::Gradients;
use burn::backend::autodiff::ops::{Backward, Ops, OpsKind};
use burn::backend::tensor::FloatTensor;

use super::Tap;

#[derive(Debug)]
struct TapBackward;

impl<B: Tap> Backward<B, 2> for TapBackward {
    type State = ();

    fn backward(self, ops: Ops<Self::State, 2>, grads: &mut Gradients, _: &mut Checkpointer) {
        let gradient = grads.consume::<B>(&ops.node);
        for node in ops.parents.into_iter().flatten() {
            grads.register::<B>(node.id, gradient.clone());
        }
    }
}

impl<B: Tap, C: CheckpointStrategy> Tap for Autodiff<B, C> {
    fn tap(values: FloatTensor<Self>, leaf: FloatTensor<Self>) -> FloatTensor<Self> {
        let ((values, of_values), (_, of_leaf)) = (values.into_parts(), leaf.into_parts());
        match TapBackward
            .prepare::<C>([of_values, of_leaf])
            .compute_bound()
            .stateful()
        {
            OpsKind::Tracked(prep) => prep.finish((), values),
            OpsKind::UnTracked(prep) => prep.finish(values),
        }
    }
}
