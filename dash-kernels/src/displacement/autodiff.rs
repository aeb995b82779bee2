//! Backward node of [`displacement`](super::displacement).

use burn::backend::Autodiff;
use burn::backend::autodiff::checkpoint::{base::Checkpointer, strategy::CheckpointStrategy};
use burn::backend::autodiff::grads::Gradients;
use burn::backend::autodiff::ops::{Backward, Ops, OpsKind};
use burn::backend::tensor::FloatTensor;

use super::{Displacement, DisplacementVjp};

#[derive(Debug)]
struct DisplacementBackward;

impl<B: DisplacementVjp> Backward<B, 1> for DisplacementBackward {
    type State = Vec<f32>;

    fn backward(self, ops: Ops<Self::State, 1>, grads: &mut Gradients, _: &mut Checkpointer) {
        let v_out = grads.consume::<B>(&ops.node);
        let [parent] = ops.parents;
        if let Some(node) = parent {
            grads.register::<B>(node.id, B::displacement_vjp(v_out, ops.state));
        }
    }
}

impl<B: DisplacementVjp, C: CheckpointStrategy> Displacement for Autodiff<B, C> {
    fn displacement(coefficients: FloatTensor<Self>, basis: Vec<f32>) -> FloatTensor<Self> {
        let (coefficients, node) = coefficients.into_parts();
        match DisplacementBackward
            .prepare::<C>([node])
            .compute_bound()
            .stateful()
        {
            OpsKind::Tracked(prep) => {
                let out = B::displacement(coefficients, basis.clone());
                prep.finish(basis, out)
            }
            OpsKind::UnTracked(prep) => prep.finish(B::displacement(coefficients, basis)),
        }
    }
}
