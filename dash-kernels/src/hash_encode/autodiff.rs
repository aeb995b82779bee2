//! Backward node of [`hash_encode`](super::hash_encode).

use burn::backend::Autodiff;
use burn::backend::autodiff::checkpoint::{base::Checkpointer, strategy::CheckpointStrategy};
use burn::backend::autodiff::grads::Gradients;
use burn::backend::autodiff::ops::{Backward, Ops, OpsKind};
use burn::backend::tensor::FloatTensor;

use super::{HashEncode, HashEncodeVjp, HashGridLayout};

#[derive(Debug)]
struct HashEncodeBackward;

impl<B: HashEncodeVjp> Backward<B, 2> for HashEncodeBackward {
    type State = (FloatTensor<B>, FloatTensor<B>, HashGridLayout);

    fn backward(self, ops: Ops<Self::State, 2>, grads: &mut Gradients, _: &mut Checkpointer) {
        let v_out = grads.consume::<B>(&ops.node);
        let (positions, table, layout) = ops.state;
        let needed = ops.parents.each_ref().map(Option::is_some);
        let gradients = B::hash_encode_vjp(positions, table, v_out, &layout, needed);
        for (parent, gradient) in ops.parents.into_iter().zip(gradients) {
            if let (Some(node), Some(gradient)) = (parent, gradient) {
                grads.register::<B>(node.id, gradient);
            }
        }
    }
}

impl<B: HashEncodeVjp, C: CheckpointStrategy> HashEncode for Autodiff<B, C> {
    fn hash_encode(
        positions: FloatTensor<Self>,
        table: FloatTensor<Self>,
        layout: HashGridLayout,
    ) -> FloatTensor<Self> {
        let (positions, positions_node) = positions.into_parts();
        let (table, table_node) = table.into_parts();
        match HashEncodeBackward
            .prepare::<C>([positions_node, table_node])
            .compute_bound()
            .stateful()
        {
            OpsKind::Tracked(prep) => {
                let out = B::hash_encode(positions.clone(), table.clone(), layout.clone());
                prep.finish((positions, table, layout), out)
            }
            OpsKind::UnTracked(prep) => prep.finish(B::hash_encode(positions, table, layout)),
        }
    }
}
