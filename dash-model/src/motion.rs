//! The coarse motion field of the decomposition stage.

use burn::module::Module;
use burn::nn::Linear;
use burn::tensor::{Device, Tensor};
use rand::Rng;

use crate::mlp::{self, Mlp, linear};
use crate::{HashEncoder, HashEncoderConfig, ModelError, SpaceBox, TrajectoryBasis};

/// World units per unit of the head, as a share of the diagonal: one step of Adam changes every
/// weight by its rate, and a coarse unit would make it jump.
const OUTPUT_SCALE: f32 = 0.1;

/// Start of the motion head's weights: next to nothing moves at first, for the features start near zero, but what
/// they learn shows at once. From a head of nearly nothing the field takes a hundred steps to move anything, and a
/// small thing that has moved by more than its size until then is lost.
const INITIAL_HEAD: f32 = 0.02;

/// A field of motion over space: 3D hash encoding, tiny MLP, linear head.
///
/// # Source
/// DASH Eqs. 3-4: `f = phi_p(G_3D(p))`, `dp = phi_l(f)`. Unlike the paper the trajectory may
/// have several basis functions, see [`TrajectoryBasis`].
#[derive(Module, Debug)]
pub struct MotionField {
    encoder: HashEncoder,
    trunk: Mlp,
    head: Linear,
    #[module(skip)]
    basis: TrajectoryBasis,
    #[module(skip)]
    space: SpaceBox,
}

impl MotionField {
    /// A field over `space` in which nothing moves yet.
    ///
    /// # Errors
    /// When the grid's configuration is out of range or not three-dimensional.
    pub fn new(
        grid: &HashEncoderConfig,
        hidden: usize,
        basis: TrajectoryBasis,
        space: SpaceBox,
        rng: &mut impl Rng,
        device: &Device,
    ) -> Result<Self, ModelError> {
        let encoder = grid.init(rng, device)?;
        let trunk = Mlp::new(&[encoder.n_output_features(), hidden, hidden], rng, device);
        let head = linear(hidden, 3 * basis.len(), INITIAL_HEAD, rng, device);
        Ok(Self {
            encoder,
            trunk,
            head,
            basis,
            space,
        })
    }

    /// Trajectory coefficients of points.
    ///
    /// # Shapes
    /// `means [N, 3] -> [N, B * 3]`, world units.
    ///
    /// # Gradient
    /// To the field; the points are addresses only.
    ///
    /// # Errors
    /// When a shape does not fit.
    pub fn coefficients(&self, means: Tensor<2>) -> Result<Tensor<2>, ModelError> {
        let features = self.encoder.forward(self.space.normalize(means.detach()))?;
        let layers = self.trunk.layers.iter().chain([&self.head]);
        let out = mlp::forward(features, layers)?;
        Ok(out * (OUTPUT_SCALE * self.space.diagonal()))
    }

    /// The basis of the trajectories.
    pub fn basis(&self) -> TrajectoryBasis {
        self.basis
    }
}
