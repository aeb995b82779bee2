//! The coarse motion field of the first stage.

use burn::module::Module;
use burn::nn::Linear;
use burn::tensor::{Device, Tensor};
use rand::Rng;

use crate::mlp::{self, Mlp, linear};
use crate::{HashEncoder, HashEncoderConfig, ModelError, SpaceBox, TrajectoryBasis};

/// World units per unit of the head, as a share of the box's diagonal. Adam changes every weight by about the learning rate;
/// with the whole diagonal as unit, Gaussians would jump.
const OUTPUT_SCALE: f32 = 0.1;

/// Start of the motion head's weights. Features start near zero, so almost nothing moves at first, yet the head passes on what
/// they learn at once. With smaller weights the field starts too slowly to follow a small, fast object.
const INITIAL_HEAD: f32 = 0.02;

/// A field of motion over space: 3D hash encoding, small MLP, linear head.
///
/// # Source
/// DASH Eqs. 3-4: `f = phi_p(G_3D(p))`, `dp = phi_l(f)`. Unlike in the paper the trajectory may have several basis
/// functions, see [`TrajectoryBasis`].
///
/// # Example
/// ```
/// use burn::tensor::{Device, Tensor};
/// use dash_model::{HashEncoderConfig, MotionField, SpaceBox, TrajectoryBasis};
/// use rand::SeedableRng;
///
/// let device = Device::flex();
/// let mut rng = rand_pcg::Pcg64::seed_from_u64(1);
/// let grid = HashEncoderConfig::new(4, 10, [4; 3], [32; 3]);
/// let basis = TrajectoryBasis::polyline(4);
/// let field = MotionField::new(&grid, 16, basis, SpaceBox::fixed(1.0), &mut rng, &device)?;
/// let coefficients = field.coefficients(Tensor::zeros([5, 3], &device))?;
/// assert_eq!(coefficients.dims(), [5, 4 * 3]);
/// assert_eq!(basis.extent(coefficients)?.dims(), [5]);
/// # Ok::<(), dash_model::ModelError>(())
/// ```
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
    /// A field over `space` that starts almost at rest.
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
    /// To the field, not to the points.
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
