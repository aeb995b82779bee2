//! The coarse motion field of the decomposition stage.

use burn::module::{Module, Param};
use burn::nn::Linear;
use burn::tensor::activation::relu;
use burn::tensor::{Device, Tensor, TensorData};
use rand::Rng;

use crate::mlp::{Mlp, linear};
use crate::{HashEncoder, HashEncoderConfig, ModelError, SpaceBox, TrajectoryBasis};

/// World units per unit of the head, as a share of the diagonal: one step of Adam changes every
/// weight by its rate, and a coarse unit would make it jump.
const OUTPUT_SCALE: f32 = 0.1;

/// Start of the motion head's weights: nothing moves at first.
const INITIAL_HEAD: f32 = 1e-3;

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
        let hidden = relu(self.trunk.forward(features));
        Ok(self.head.forward(hidden) * (OUTPUT_SCALE * self.space.diagonal()))
    }

    /// The same field, in which the polyline's span `to` moves as its span `from` does. What comes
    /// next then starts from where the motion so far leads.
    ///
    /// # Panics
    /// When there is no such span.
    pub fn with_span_copied(mut self, from: usize, to: usize) -> Self {
        let spans = self.basis.len();
        assert!(from < spans && to < spans, "spans {from}, {to} of {spans}");
        let device = self.head.weight.device();
        let copy = |values: TensorData| {
            let shape = values.shape().clone();
            let mut values = values
                .try_into_vec::<f32>()
                .unwrap_or_else(|error| panic!("the head is f32: {error:?}"));
            for row in values.chunks_exact_mut(3 * spans) {
                row.copy_within(3 * from..3 * from + 3, 3 * to);
            }
            TensorData::new(values, shape)
        };
        self.head = Linear {
            weight: Param::from_data(copy(self.head.weight.val().into_data()), &device),
            bias: (self.head.bias.as_ref())
                .map(|bias| Param::from_data(copy(bias.val().into_data()), &device)),
        };
        self
    }

    /// The basis of the trajectories.
    pub fn basis(&self) -> TrajectoryBasis {
        self.basis
    }
}
