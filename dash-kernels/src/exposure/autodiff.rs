//! Backward node of [`expose`](super::expose).

use burn::backend::Autodiff;
use burn::backend::autodiff::checkpoint::{base::Checkpointer, strategy::CheckpointStrategy};
use burn::backend::autodiff::grads::Gradients;
use burn::backend::autodiff::ops::{Backward, Ops, OpsKind};
use burn::backend::tensor::FloatTensor;

use super::{Expose, ExposeVjp};

#[derive(Debug)]
struct ExposeBackward;

impl<B: ExposeVjp> Backward<B, 2> for ExposeBackward {
    /// Splats and response.
    type State = [FloatTensor<B>; 2];

    fn backward(self, ops: Ops<Self::State, 2>, grads: &mut Gradients, _: &mut Checkpointer) {
        let v_out = grads.consume::<B>(&ops.node);
        let [splats, response] = ops.state;
        let gradients = B::expose_vjp(splats, response, v_out);
        for (parent, gradient) in ops.parents.into_iter().zip(gradients) {
            if let Some(node) = parent {
                grads.register::<B>(node.id, gradient);
            }
        }
    }
}

impl<B: ExposeVjp, C: CheckpointStrategy> Expose for Autodiff<B, C> {
    fn expose(splats: FloatTensor<Self>, response: FloatTensor<Self>) -> FloatTensor<Self> {
        let (splats, of_splats) = splats.into_parts();
        let (response, of_response) = response.into_parts();
        match ExposeBackward
            .prepare::<C>([of_splats, of_response])
            .compute_bound()
            .stateful()
        {
            OpsKind::Tracked(prep) => {
                let state = [splats.clone(), response.clone()];
                prep.finish(state, B::expose(splats, response))
            }
            OpsKind::UnTracked(prep) => prep.finish(B::expose(splats, response)),
        }
    }
}
