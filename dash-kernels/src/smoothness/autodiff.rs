//! Backward node of [`smoothness`](super::smoothness).

use burn::backend::autodiff::checkpoint::{base::Checkpointer, strategy::CheckpointStrategy};
use burn::backend::autodiff::grads::Gradients;
use burn::backend::autodiff::ops::{Backward, Ops, OpsKind};
use burn::backend::tensor::FloatTensor;
use burn::backend::{Autodiff, AutodiffBackend};

use super::{FieldSmoothness, FieldSmoothnessVjp};
use crate::outputs::Outputs;

#[derive(Debug)]
struct SmoothnessBackward;

impl<B: FieldSmoothnessVjp> Backward<B, 1> for SmoothnessBackward {
    /// The outputs' gradients, the features, their points and rows.
    type State = (Outputs<B, 3>, FloatTensor<B>, usize, Vec<u32>);

    fn backward(self, ops: Ops<Self::State, 1>, grads: &mut Gradients, _: &mut Checkpointer) {
        grads.consume::<B>(&ops.node);
        let (gathered, features, n, rows) = ops.state;
        let [parent] = ops.parents;
        if let Some(node) = parent {
            let v_features = B::smoothness_vjp(features, gathered.take(), n, rows);
            grads.register::<B>(node.id, v_features);
        }
    }
}

impl<B: FieldSmoothnessVjp, C: CheckpointStrategy> FieldSmoothness for Autodiff<B, C> {
    fn smoothness(
        features: FloatTensor<Self>,
        n: usize,
        rows: Vec<u32>,
    ) -> (FloatTensor<Self>, FloatTensor<Self>, FloatTensor<Self>) {
        let (features, node) = features.into_parts();
        let (own, cost, others) = B::smoothness(features.clone(), n, rows.clone());
        let prepared = SmoothnessBackward.prepare::<C>([node]);
        match prepared.compute_bound().stateful() {
            OpsKind::UnTracked(_) => (
                Self::from_inner(own),
                Self::from_inner(cost),
                Self::from_inner(others),
            ),
            OpsKind::Tracked(prep) => {
                let gathered = Outputs::<B, 3>::new();
                let state = (gathered.clone(), features, n, rows);
                let operation: FloatTensor<Self> = prep.finish(state, cost.clone());
                (
                    gathered.of::<C>(&operation, 0, own),
                    gathered.of::<C>(&operation, 1, cost),
                    gathered.of::<C>(&operation, 2, others),
                )
            }
        }
    }
}
