//! Operations with several outputs, whose gradients are taken together.
//!
//! A node of Burn's graph has one output. So there is a node for the operation and one for each output. Nodes of outputs put
//! their gradients aside; the node of the operation, whose turn comes after all of them, takes them together.

use std::sync::{Arc, Mutex, PoisonError};

use burn::backend::autodiff::checkpoint::{base::Checkpointer, strategy::CheckpointStrategy};
use burn::backend::autodiff::grads::Gradients;
use burn::backend::autodiff::ops::{Backward, Ops, OpsKind};
use burn::backend::tensor::FloatTensor;
use burn::backend::{Autodiff, Backend};

/// Gradients of an operation's `N` outputs, as far as they have come.
#[derive(Debug)]
pub(crate) struct Outputs<B: Backend, const N: usize>(Arc<Mutex<[Option<FloatTensor<B>>; N]>>);

impl<B: Backend, const N: usize> Clone for Outputs<B, N> {
    fn clone(&self) -> Self {
        Self(self.0.clone())
    }
}

impl<B: Backend, const N: usize> Outputs<B, N> {
    /// Before any gradient has come.
    pub fn new() -> Self {
        Self(Arc::new(Mutex::new([const { None }; N])))
    }

    /// The gradients, for the operation's backward step; `None` of an output that the loss does not depend on.
    pub fn take(&self) -> [Option<FloatTensor<B>>; N] {
        let mut gathered = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        std::mem::replace(&mut *gathered, [const { None }; N])
    }

    /// The output of number `which` of `operation`.
    pub fn of<C: CheckpointStrategy>(
        &self,
        operation: &FloatTensor<Autodiff<B, C>>,
        which: usize,
        values: FloatTensor<B>,
    ) -> FloatTensor<Autodiff<B, C>> {
        let (_, node) = operation.clone().into_parts();
        match OutputBackward
            .prepare::<C>([node])
            .compute_bound()
            .stateful()
        {
            OpsKind::Tracked(prep) => prep.finish((self.clone(), which), values),
            OpsKind::UnTracked(prep) => prep.finish(values),
        }
    }
}

/// Puts the gradient of an output aside.
#[derive(Debug)]
struct OutputBackward<const N: usize>;

impl<B: Backend, const N: usize> Backward<B, 1> for OutputBackward<N> {
    /// Where to, and which output it is.
    type State = (Outputs<B, N>, usize);

    fn backward(self, ops: Ops<Self::State, 1>, grads: &mut Gradients, _: &mut Checkpointer) {
        let gradient = grads.consume::<B>(&ops.node);
        let (Outputs(gathered), which) = ops.state;
        let mut gathered = gathered.lock().unwrap_or_else(PoisonError::into_inner);
        let is_first = gathered.iter().all(Option::is_none);
        gathered[which] = Some(gradient.clone());
        let [operation] = ops.parents;
        // The operation's node has its turn if something is registered for it. What that is does not matter.
        if let Some(node) = operation.filter(|_| is_first) {
            grads.register::<B>(node.id, gradient);
        }
    }
}
