//! Backward node of [`deform`](super::deform).

use burn::backend::autodiff::checkpoint::{base::Checkpointer, strategy::CheckpointStrategy};
use burn::backend::autodiff::grads::Gradients;
use burn::backend::autodiff::ops::{Backward, Ops, OpsKind};
use burn::backend::tensor::FloatTensor;
use burn::backend::{Autodiff, AutodiffBackend, TensorMetadata};
use burn::tensor::Shape;

use super::{Deform, DeformVjp, Form, MEAN, QUAT, SCALE};
use crate::host::dims;
use crate::outputs::Outputs;

#[derive(Debug)]
struct DeformBackward;

impl<B: DeformVjp> Backward<B, 5> for DeformBackward {
    /// The outputs' gradients, rows and columns of the offsets.
    type State = (Outputs<B, 3>, [usize; 2], Form);

    fn backward(self, ops: Ops<Self::State, 5>, grads: &mut Gradients, _: &mut Checkpointer) {
        let any = grads.consume::<B>(&ops.node);
        let (gathered, [n, width], Form { columns, basis }) = ops.state;
        let or_zeros = |gradient: Option<FloatTensor<B>>, size: usize| {
            let zeros = || B::float_zeros(Shape::new([n, size]), &any.device(), any.dtype().into());
            gradient.unwrap_or_else(zeros)
        };
        let [v_means, v_quats, v_scales] = gathered.take();
        let v_means = or_zeros(v_means, MEAN);
        let v_quats = or_zeros(v_quats, QUAT);
        let v_scales = or_zeros(v_scales, SCALE);
        let [means, quats, scales, coefficients, offsets] = ops.parents;
        if let Some(node) = offsets {
            let v_offsets = B::deform_vjp(
                v_means.clone(),
                v_quats.clone(),
                v_scales.clone(),
                width,
                columns,
            );
            grads.register::<B>(node.id, v_offsets);
        }
        // What stands in for trajectories that are not there has no gradient.
        if let Some(node) = coefficients.filter(|_| !basis.is_empty()) {
            grads.register::<B>(node.id, B::displacement_vjp(v_means.clone(), basis));
        }
        for (node, gradient) in [
            (quats.filter(|_| columns.quats.is_some()), v_quats),
            (scales.filter(|_| columns.scales.is_some()), v_scales),
            (means, v_means),
        ] {
            if let Some(node) = node {
                grads.register::<B>(node.id, gradient);
            }
        }
    }
}

impl<B: DeformVjp, C: CheckpointStrategy> Deform for Autodiff<B, C> {
    fn deform(
        means: FloatTensor<Self>,
        quats: FloatTensor<Self>,
        scales: FloatTensor<Self>,
        coefficients: FloatTensor<Self>,
        offsets: FloatTensor<Self>,
        form: Form,
    ) -> (FloatTensor<Self>, FloatTensor<Self>, FloatTensor<Self>) {
        let (means, of_means) = means.into_parts();
        let (quats, of_quats) = quats.into_parts();
        let (scales, of_scales) = scales.into_parts();
        let (coefficients, of_coefficients) = coefficients.into_parts();
        let (offsets, of_offsets) = offsets.into_parts();
        let size = dims::<2>(&offsets);
        let nodes = [of_means, of_quats, of_scales, of_coefficients, of_offsets];
        let outputs = B::deform(means, quats, scales, coefficients, offsets, form.clone());
        let operation = match DeformBackward
            .prepare::<C>(nodes)
            .compute_bound()
            .stateful()
        {
            OpsKind::UnTracked(_) => {
                let (means, quats, scales) = outputs;
                return (
                    Self::from_inner(means),
                    Self::from_inner(quats),
                    Self::from_inner(scales),
                );
            }
            OpsKind::Tracked(prep) => prep,
        };
        let gathered = Outputs::<B, 3>::new();
        let (means, quats, scales) = outputs;
        let state = (gathered.clone(), size, form);
        let operation: FloatTensor<Self> = operation.finish(state, means.clone());
        (
            gathered.of::<C>(&operation, 0, means),
            gathered.of::<C>(&operation, 1, quats),
            gathered.of::<C>(&operation, 2, scales),
        )
    }
}
