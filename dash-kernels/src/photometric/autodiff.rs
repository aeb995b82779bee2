//! Backward node of [`photometric`](super::photometric).

use burn::backend::autodiff::checkpoint::{base::Checkpointer, strategy::CheckpointStrategy};
use burn::backend::autodiff::grads::Gradients;
use burn::backend::autodiff::ops::{Backward, Ops, OpsKind};
use burn::backend::tensor::FloatTensor;
use burn::backend::{Autodiff, AutodiffBackend};
use burn::tensor::Shape;

use super::{PhotometricLoss, PhotometricVjp};

#[derive(Debug)]
struct PhotometricBackward;

impl<B: PhotometricVjp> Backward<B, 1> for PhotometricBackward {
    /// The gradient of the loss.
    type State = FloatTensor<B>;

    fn backward(self, ops: Ops<Self::State, 1>, grads: &mut Gradients, _: &mut Checkpointer) {
        let v_loss = grads.consume::<B>(&ops.node);
        let [image] = ops.parents;
        if let Some(node) = image {
            let v_loss = B::float_reshape(v_loss, Shape::new([1, 1, 1]));
            grads.register::<B>(node.id, B::float_mul(ops.state, v_loss));
        }
    }
}

impl<B: PhotometricVjp, C: CheckpointStrategy> PhotometricLoss for Autodiff<B, C> {
    fn photometric(
        image: FloatTensor<Self>,
        target: FloatTensor<Self>,
        dssim: f32,
    ) -> (FloatTensor<Self>, FloatTensor<Self>) {
        let ((image, node), (target, _)) = (image.into_parts(), target.into_parts());
        match PhotometricBackward
            .prepare::<C>([node])
            .compute_bound()
            .stateful()
        {
            OpsKind::Tracked(prep) => {
                let ([loss, mse], gradient) = B::photometric_and_gradient(image, target, dssim);
                (prep.finish(gradient, loss), Self::from_inner(mse))
            }
            OpsKind::UnTracked(prep) => {
                let (loss, mse) = B::photometric(image, target, dssim);
                (prep.finish(loss), Self::from_inner(mse))
            }
        }
    }
}
