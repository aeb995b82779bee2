//! Backward node of [`mlp`](super::mlp()).

use burn::backend::Autodiff;
use burn::backend::autodiff::checkpoint::{base::Checkpointer, strategy::CheckpointStrategy};
use burn::backend::autodiff::grads::Gradients;
use burn::backend::autodiff::ops::{Backward, Ops, OpsKind};
use burn::backend::tensor::FloatTensor;

use super::{MlpLayout, Perceptron, PerceptronVjp};

#[derive(Debug)]
struct PerceptronBackward;

impl<B: PerceptronVjp> Backward<B, 2> for PerceptronBackward {
    type State = (FloatTensor<B>, FloatTensor<B>, MlpLayout);

    fn backward(self, ops: Ops<Self::State, 2>, grads: &mut Gradients, _: &mut Checkpointer) {
        let v_out = grads.consume::<B>(&ops.node);
        let (input, parameters, layout) = ops.state;
        let needed = ops.parents.each_ref().map(Option::is_some);
        let gradients = B::mlp_vjp(input, parameters, v_out, &layout, needed);
        for (parent, gradient) in ops.parents.into_iter().zip(gradients) {
            if let (Some(node), Some(gradient)) = (parent, gradient) {
                grads.register::<B>(node.id, gradient);
            }
        }
    }
}

impl<B: PerceptronVjp, C: CheckpointStrategy> Perceptron for Autodiff<B, C> {
    fn mlp(
        input: FloatTensor<Self>,
        parameters: FloatTensor<Self>,
        layout: MlpLayout,
    ) -> FloatTensor<Self> {
        let (input, input_node) = input.into_parts();
        let (parameters, parameters_node) = parameters.into_parts();
        match PerceptronBackward
            .prepare::<C>([input_node, parameters_node])
            .compute_bound()
            .stateful()
        {
            OpsKind::Tracked(prep) => {
                let out = B::mlp(input.clone(), parameters.clone(), layout.clone());
                prep.finish((input, parameters, layout), out)
            }
            OpsKind::UnTracked(prep) => prep.finish(B::mlp(input, parameters, layout)),
        }
    }
}
