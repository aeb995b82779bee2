//! What a forward pass leaves.

use burn::tensor::Tensor;

/// What a forward pass leaves for loss terms, the backward pass and statistics.
pub struct Forward {
    /// The whole loss.
    pub loss: Tensor<1>,
    /// Mean squared error of the picture.
    pub mse: Tensor<1>,
    /// The picture `[H, W, 5]`: RGB, alpha, depth; black where pixels don't count.
    pub image: Tensor<3>,
    /// The captured picture `[H, W, 3]`; black where pixels don't count.
    pub target: Tensor<3>,
    /// The captured picture `[H, W, 3]` on the host, where it was needed there.
    pub target_on_host: Option<Vec<f32>>,
    /// Packed splats `[N, C]` of the static set, without their graph.
    pub static_splats: Tensor<2>,
    /// The same of the dynamic set, if there is one.
    pub dynamic_splats: Option<Tensor<2>>,
    /// Has the gradient of the splats of both sets, static ones first, after the backward pass.
    pub leaf: Tensor<2>,
    /// How far the method moves each static Gaussian over the clip `[N]`, world units.
    pub motion: Option<Tensor<1>>,
}
