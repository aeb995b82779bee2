//! Backward node of [`ssim`](super::ssim).

use burn::backend::Autodiff;
use burn::backend::autodiff::checkpoint::{base::Checkpointer, strategy::CheckpointStrategy};
use burn::backend::autodiff::grads::Gradients;
use burn::backend::autodiff::ops::{Backward, Ops, OpsKind};
use burn::backend::tensor::FloatTensor;

use super::{Ssim, SsimVjp};

#[derive(Debug)]
struct SsimBackward;

impl<B: SsimVjp> Backward<B, 2> for SsimBackward {
    type State = (FloatTensor<B>, FloatTensor<B>);

    fn backward(self, ops: Ops<Self::State, 2>, grads: &mut Gradients, _: &mut Checkpointer) {
        let v_out = grads.consume::<B>(&ops.node);
        let (x, y) = ops.state;
        let needed = ops.parents.each_ref().map(Option::is_some);
        let gradients = B::ssim_vjp(x, y, v_out, needed);
        for (parent, gradient) in ops.parents.into_iter().zip(gradients) {
            if let (Some(node), Some(gradient)) = (parent, gradient) {
                grads.register::<B>(node.id, gradient);
            }
        }
    }
}

impl<B: SsimVjp, C: CheckpointStrategy> Ssim for Autodiff<B, C> {
    fn ssim(x: FloatTensor<Self>, y: FloatTensor<Self>) -> FloatTensor<Self> {
        let ((x, x_node), (y, y_node)) = (x.into_parts(), y.into_parts());
        match SsimBackward
            .prepare::<C>([x_node, y_node])
            .compute_bound()
            .stateful()
        {
            OpsKind::Tracked(prep) => {
                let out = B::ssim(x.clone(), y.clone());
                prep.finish((x, y), out)
            }
            OpsKind::UnTracked(prep) => prep.finish(B::ssim(x, y)),
        }
    }
}
