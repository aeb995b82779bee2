//! Backward nodes of [`deform`](super::deform).
//!
//! A node of Burn's graph has one output, and this operation has three. So there is a node for the operation and one for each
//! output. Nodes of outputs put their gradients aside; the node of the operation, whose turn comes after all of
//! them, takes them together.

use std::sync::{Arc, Mutex, PoisonError};

use burn::backend::autodiff::checkpoint::{base::Checkpointer, strategy::CheckpointStrategy};
use burn::backend::autodiff::grads::Gradients;
use burn::backend::autodiff::ops::{Backward, Ops, OpsKind};
use burn::backend::tensor::FloatTensor;
use burn::backend::{Autodiff, AutodiffBackend, TensorMetadata};
use burn::tensor::Shape;

use super::{Deform, DeformVjp, Form, MEAN, QUAT, SCALE};
use crate::host::dims;

/// Gradients of means, quaternions and scales, as far as they have come.
type Gathered<B> = Arc<Mutex<[Option<FloatTensor<B>>; 3]>>;

/// Puts the gradient of an output aside.
#[derive(Debug)]
struct OutputBackward;

impl<B: DeformVjp> Backward<B, 1> for OutputBackward {
    /// Where to, and which output it is.
    type State = (Gathered<B>, usize);

    fn backward(self, ops: Ops<Self::State, 1>, grads: &mut Gradients, _: &mut Checkpointer) {
        let gradient = grads.consume::<B>(&ops.node);
        let (gathered, which) = ops.state;
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

#[derive(Debug)]
struct DeformBackward;

impl<B: DeformVjp> Backward<B, 5> for DeformBackward {
    /// The outputs' gradients, rows and columns of the offsets.
    type State = (Gathered<B>, [usize; 2], Form);

    fn backward(self, ops: Ops<Self::State, 5>, grads: &mut Gradients, _: &mut Checkpointer) {
        let any = grads.consume::<B>(&ops.node);
        let (gathered, [n, width], Form { columns, has_path }) = ops.state;
        let mut gathered = gathered.lock().unwrap_or_else(PoisonError::into_inner);
        let sizes = [MEAN, QUAT, SCALE].into_iter();
        let mut gradients = gathered.iter_mut().zip(sizes).map(|(gradient, size)| {
            let zeros = || B::float_zeros(Shape::new([n, size]), &any.device(), any.dtype().into());
            gradient.take().unwrap_or_else(zeros)
        });
        let mut next = || gradients.next().expect("three");
        let [v_means, v_quats, v_scales] = [(); 3].map(|()| next());
        let [means, quats, scales, path, offsets] = ops.parents;
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
        for (node, gradient) in [
            (quats.filter(|_| columns.quats.is_some()), v_quats),
            (scales.filter(|_| columns.scales.is_some()), v_scales),
            // What stands in for a path that is not there has no gradient.
            (path.filter(|_| has_path), v_means.clone()),
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
        path: FloatTensor<Self>,
        offsets: FloatTensor<Self>,
        form: Form,
    ) -> (FloatTensor<Self>, FloatTensor<Self>, FloatTensor<Self>) {
        let (means, of_means) = means.into_parts();
        let (quats, of_quats) = quats.into_parts();
        let (scales, of_scales) = scales.into_parts();
        let (path, of_path) = path.into_parts();
        let (offsets, of_offsets) = offsets.into_parts();
        let size = dims::<2>(&offsets);
        let nodes = [of_means, of_quats, of_scales, of_path, of_offsets];
        let outputs = B::deform(means, quats, scales, path, offsets, form);
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
        let gathered = Gathered::<B>::default();
        let (means, quats, scales) = outputs;
        let operation: FloatTensor<Self> =
            operation.finish((gathered.clone(), size, form), means.clone());
        let output = |which: usize, values: FloatTensor<B>| {
            let (_, node) = operation.clone().into_parts();
            let prepared = OutputBackward.prepare::<C>([node]);
            match prepared.compute_bound().stateful() {
                OpsKind::Tracked(prep) => prep.finish((gathered.clone(), which), values),
                OpsKind::UnTracked(prep) => prep.finish(values),
            }
        };
        (output(0, means), output(1, quats), output(2, scales))
    }
}
