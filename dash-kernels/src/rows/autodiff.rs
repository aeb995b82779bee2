//! Backward nodes of [`take_rows`](super::take_rows) and [`join_rows`](super::join_rows).

use burn::backend::Autodiff;
use burn::backend::autodiff::checkpoint::{base::Checkpointer, strategy::CheckpointStrategy};
use burn::backend::autodiff::grads::Gradients;
use burn::backend::autodiff::ops::{Backward, Ops, OpsKind};
use burn::backend::tensor::FloatTensor;

use super::{JoinRows, JoinRowsVjp, TakeRows, TakeRowsVjp, places};
use crate::host::dims;

#[derive(Debug)]
struct TakeRowsBackward;

impl<B: TakeRowsVjp> Backward<B, 1> for TakeRowsBackward {
    /// The place of each row among those taken.
    type State = Vec<u32>;

    fn backward(self, ops: Ops<Self::State, 1>, grads: &mut Gradients, _: &mut Checkpointer) {
        let v_out = grads.consume::<B>(&ops.node);
        let [parent] = ops.parents;
        if let Some(node) = parent {
            grads.register::<B>(node.id, B::take_rows_vjp(v_out, ops.state));
        }
    }
}

impl<B: TakeRowsVjp, C: CheckpointStrategy> TakeRows for Autodiff<B, C> {
    fn take_rows(values: FloatTensor<Self>, rows: Vec<u32>) -> FloatTensor<Self> {
        let (values, node) = values.into_parts();
        match TakeRowsBackward
            .prepare::<C>([node])
            .compute_bound()
            .stateful()
        {
            OpsKind::Tracked(prep) => {
                let [n, _] = dims::<2>(&values);
                let state = places(n, &rows);
                prep.finish(state, B::take_rows(values, rows))
            }
            OpsKind::UnTracked(prep) => prep.finish(B::take_rows(values, rows)),
        }
    }
}

#[derive(Debug)]
struct JoinRowsBackward;

impl<B: JoinRowsVjp> Backward<B, 2> for JoinRowsBackward {
    /// Rows of the first.
    type State = usize;

    fn backward(self, ops: Ops<Self::State, 2>, grads: &mut Gradients, _: &mut Checkpointer) {
        let v_out = grads.consume::<B>(&ops.node);
        let gradients = B::join_rows_vjp(v_out, ops.state);
        for (parent, gradient) in ops.parents.into_iter().zip(gradients) {
            if let Some(node) = parent {
                grads.register::<B>(node.id, gradient);
            }
        }
    }
}

impl<B: JoinRowsVjp, C: CheckpointStrategy> JoinRows for Autodiff<B, C> {
    fn join_rows(first: FloatTensor<Self>, second: FloatTensor<Self>) -> FloatTensor<Self> {
        let (first, first_node) = first.into_parts();
        let (second, second_node) = second.into_parts();
        match JoinRowsBackward
            .prepare::<C>([first_node, second_node])
            .compute_bound()
            .stateful()
        {
            OpsKind::Tracked(prep) => {
                let [n, _] = dims::<2>(&first);
                prep.finish(n, B::join_rows(first, second))
            }
            OpsKind::UnTracked(prep) => prep.finish(B::join_rows(first, second)),
        }
    }
}
