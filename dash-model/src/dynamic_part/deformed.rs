//! Dynamic Gaussians at one time.

use burn::tensor::Tensor;
use dash_kernels::project::{Activation, ShCoeffs};

/// The dynamic Gaussians at one time, ready for projection.
#[derive(Debug, Clone)]
pub struct Deformed {
    /// `[N, 3]`, world units.
    pub means: Tensor<2>,
    /// `[N, 4]`.
    pub quats: Tensor<2>,
    /// `[N, 3]`, logarithms for [`Activation::Exp`].
    pub scales: Tensor<2>,
    /// `[N]`, logits for [`Activation::Exp`].
    pub opacities: Tensor<1>,
    /// Colour coefficients; they depend on time as far as the field has heads for them.
    pub sh_coeffs: ShCoeffs,
    /// The activation that projection applies to scales and opacities.
    pub activation: Activation,
}

impl Deformed {
    /// Linear interpolation to the same Gaussians at another time. The quaternions of both are offsets from the same
    /// canonical ones, so their signs agree. Higher colour coefficients are the same at both times unless `has_sh_rest`.
    pub(super) fn lerp(self, other: Self, weight: f32, has_sh_rest: bool) -> Self {
        fn lerp<const D: usize>(from: Tensor<D>, to: Tensor<D>, weight: f32) -> Tensor<D> {
            from * (1.0 - weight) + to * weight
        }
        Self {
            means: lerp(self.means, other.means, weight),
            quats: lerp(self.quats, other.quats, weight),
            scales: lerp(self.scales, other.scales, weight),
            opacities: lerp(self.opacities, other.opacities, weight),
            sh_coeffs: ShCoeffs {
                dc: lerp(self.sh_coeffs.dc, other.sh_coeffs.dc, weight),
                rest: match has_sh_rest {
                    true => lerp(self.sh_coeffs.rest, other.sh_coeffs.rest, weight),
                    false => self.sh_coeffs.rest,
                },
            },
            activation: self.activation,
        }
    }
}
