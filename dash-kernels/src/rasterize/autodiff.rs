//! Backward node of [`rasterize`](super::rasterize).

use burn::backend::Autodiff;
use burn::backend::autodiff::checkpoint::{base::Checkpointer, strategy::CheckpointStrategy};
use burn::backend::autodiff::grads::Gradients;
use burn::backend::autodiff::ops::{Backward, Ops, OpsKind};
use burn::backend::tensor::FloatTensor;

use super::{Rasterize, RasterizeOptions, RasterizeVjp};

#[derive(Debug)]
struct RasterizeBackward;

impl<B: RasterizeVjp> Backward<B, 1> for RasterizeBackward {
    type State = B::Saved;

    fn backward(self, ops: Ops<Self::State, 1>, grads: &mut Gradients, _: &mut Checkpointer) {
        let v_image = grads.consume::<B>(&ops.node);
        let [splats] = ops.parents;
        if let Some(node) = splats {
            grads.register::<B>(node.id, B::rasterize_vjp(ops.state, v_image));
        }
    }
}

impl<B: RasterizeVjp, C: CheckpointStrategy> Rasterize for Autodiff<B, C> {
    fn rasterize(splats: FloatTensor<Self>, options: RasterizeOptions) -> FloatTensor<Self> {
        let (splats, node) = splats.into_parts();
        match RasterizeBackward
            .prepare::<C>([node])
            .compute_bound()
            .stateful()
        {
            OpsKind::Tracked(prep) => {
                let (image, saved) = B::rasterize_saving(splats, options);
                prep.finish(saved, image)
            }
            OpsKind::UnTracked(prep) => prep.finish(B::rasterize(splats, options)),
        }
    }
}
