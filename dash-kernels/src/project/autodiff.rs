//! Backward node of [`project`](super::project).

use burn::backend::Autodiff;
use burn::backend::autodiff::checkpoint::{base::Checkpointer, strategy::CheckpointStrategy};
use burn::backend::autodiff::grads::Gradients;
use burn::backend::autodiff::ops::{Backward, Ops, OpsKind};
use burn::backend::tensor::FloatTensor;

use super::{GaussianTensors, Project, ProjectVjp, View};

#[derive(Debug)]
struct ProjectBackward;

impl<B: ProjectVjp> Backward<B, 6> for ProjectBackward {
    type State = (GaussianTensors<B>, View<f32>, FloatTensor<B>);

    fn backward(self, ops: Ops<Self::State, 6>, grads: &mut Gradients, _: &mut Checkpointer) {
        let v_splats = grads.consume::<B>(&ops.node);
        let (gaussians, view, splats) = ops.state;
        let with_sh_coeffs = ops.parents[4..].iter().any(Option::is_some);
        let gradients = B::project_vjp(gaussians, view, splats, v_splats, with_sh_coeffs);
        for (parent, gradient) in ops.parents.into_iter().zip(gradients) {
            if let (Some(node), Some(gradient)) = (parent, gradient) {
                grads.register::<B>(node.id, gradient);
            }
        }
    }
}

impl<B: ProjectVjp, C: CheckpointStrategy> Project for Autodiff<B, C> {
    fn project(
        means: FloatTensor<Self>,
        quats: FloatTensor<Self>,
        scales: FloatTensor<Self>,
        opacities: FloatTensor<Self>,
        sh_dc: FloatTensor<Self>,
        sh_rest: FloatTensor<Self>,
        view: View<f32>,
    ) -> FloatTensor<Self> {
        let (means, means_node) = means.into_parts();
        let (quats, quats_node) = quats.into_parts();
        let (scales, scales_node) = scales.into_parts();
        let (opacities, opacities_node) = opacities.into_parts();
        let (sh_dc, sh_dc_node) = sh_dc.into_parts();
        let (sh_rest, sh_rest_node) = sh_rest.into_parts();
        let nodes = [
            means_node,
            quats_node,
            scales_node,
            opacities_node,
            sh_dc_node,
            sh_rest_node,
        ];
        match ProjectBackward
            .prepare::<C>(nodes)
            .compute_bound()
            .stateful()
        {
            OpsKind::Tracked(prep) => {
                let gaussians = GaussianTensors::<B> {
                    means,
                    quats,
                    scales,
                    opacities,
                    sh_dc,
                    sh_rest,
                };
                let g = gaussians.clone();
                let splats = B::project(
                    g.means,
                    g.quats,
                    g.scales,
                    g.opacities,
                    g.sh_dc,
                    g.sh_rest,
                    view,
                );
                prep.finish((gaussians, view, splats.clone()), splats)
            }
            OpsKind::UnTracked(prep) => prep.finish(B::project(
                means, quats, scales, opacities, sh_dc, sh_rest, view,
            )),
        }
    }
}
