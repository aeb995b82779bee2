//! The 4D hash field with its multi-head decoder.

use burn::module::Module;
use burn::nn::Linear;
use burn::tensor::activation::relu;
use burn::tensor::{Device, Tensor};
use dash_kernels::hash_encode::HashGridLayout;
use rand::Rng;
use serde::{Deserialize, Serialize};

use crate::mlp::{Mlp, linear};
use crate::{HashEncoder, HashEncoderConfig, ModelError, SpaceBox};

/// World units per unit of the position head, as a share of the diagonal (see `motion.rs`).
const OUTPUT_SCALE: f32 = 0.1;

/// Start of the heads' weights: nothing is deformed at first.
const INITIAL_HEAD: f32 = 1e-3;

/// Sizes of a [`DeformationField`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DeformationConfig {
    /// The 4D encoder (x, y, z, t).
    pub encoder: HashEncoderConfig,
    /// Units of every hidden layer of the decoder.
    pub hidden: usize,
    /// Hidden layers between the encoding and the heads.
    pub layers: usize,
}

impl DeformationConfig {
    /// How many values the parameters of a field of these sizes hold, saturating.
    ///
    /// # Errors
    /// When the grid's configuration is out of range.
    pub(crate) fn n_values(&self) -> Result<u128, ModelError> {
        let grid = HashGridLayout::new(&self.encoder.grid())?;
        let n_entries: u128 = grid.levels().iter().map(|l| u128::from(l.size)).sum();
        let features = grid.n_features_per_level() as u128;
        let linear = |from: u128, to: u128| from.saturating_mul(to).saturating_add(to);
        let (hidden, layers) = (self.hidden as u128, self.layers as u128);
        let trunk = linear(features * grid.n_levels() as u128, hidden)
            .saturating_add(linear(hidden, hidden).saturating_mul(layers.saturating_sub(1)));
        let heads = linear(hidden, 3) + linear(hidden, 4) + linear(hidden, 3);
        Ok((n_entries * features)
            .saturating_add(trunk)
            .saturating_add(heads))
    }
}

/// What the field adds to canonical Gaussians at one time.
#[derive(Debug, Clone)]
pub struct Offsets {
    /// To the means `[N, 3]`, world units.
    pub means: Tensor<2>,
    /// To the quaternions `[N, 4]`.
    pub quats: Tensor<2>,
    /// To the (log) scales `[N, 3]`.
    pub scales: Tensor<2>,
}

/// Deformation over space and time: 4D hash encoding, shared decoder, one head each for position,
/// rotation and scale.
///
/// # Source
/// DASH Eqs. 7-10.
#[derive(Module, Debug)]
pub struct DeformationField {
    encoder: HashEncoder,
    decoder: Mlp,
    head_means: Linear,
    head_quats: Linear,
    head_scales: Linear,
    #[module(skip)]
    space: SpaceBox,
    #[module(skip)]
    config: DeformationConfig,
}

impl DeformationField {
    /// A field over `space` and the whole clip that deforms nothing yet.
    ///
    /// # Errors
    /// When the grid's configuration is out of range or not four-dimensional.
    pub fn new(
        config: &DeformationConfig,
        space: SpaceBox,
        rng: &mut impl Rng,
        device: &Device,
    ) -> Result<Self, ModelError> {
        let hidden = config.hidden;
        if hidden == 0 || config.layers == 0 {
            return Err(ModelError::Config(format!(
                "the decoder needs at least one hidden layer of one unit, found {} of {hidden}",
                config.layers
            )));
        }
        let encoder = config.encoder.init(rng, device)?;
        let mut widths = vec![encoder.n_output_features()];
        widths.extend(std::iter::repeat_n(hidden, config.layers));
        Ok(Self {
            encoder,
            decoder: Mlp::new(&widths, rng, device),
            head_means: linear(hidden, 3, INITIAL_HEAD, rng, device),
            head_quats: linear(hidden, 4, INITIAL_HEAD, rng, device),
            head_scales: linear(hidden, 3, INITIAL_HEAD, rng, device),
            space,
            config: config.clone(),
        })
    }

    /// The 4D features `G_4D(P, t)`.
    ///
    /// # Shapes
    /// `means [N, 3]` in world units -> `[N, L * F]`
    ///
    /// # Errors
    /// When a shape does not fit.
    pub fn features(&self, means: Tensor<2>, time: f32) -> Result<Tensor<2>, ModelError> {
        let n = means.dims()[0];
        let unit = self.space.normalize(means);
        let times = Tensor::full([n, 1], time, &unit.device());
        self.encoder.forward(Tensor::cat(vec![unit, times], 1))
    }

    /// The features at points of the 4D unit cube.
    ///
    /// # Shapes
    /// `points [N, 4] -> [N, L * F]`
    ///
    /// # Errors
    /// When a shape does not fit.
    pub fn features_at(&self, points: Tensor<2>) -> Result<Tensor<2>, ModelError> {
        self.encoder.forward(points)
    }

    /// Decodes features into offsets.
    ///
    /// # Shapes
    /// `features [N, L * F]`
    pub fn decode(&self, features: Tensor<2>) -> Offsets {
        let hidden = relu(self.decoder.forward(features));
        Offsets {
            means: self.head_means.forward(hidden.clone()) * (OUTPUT_SCALE * self.space.diagonal()),
            quats: self.head_quats.forward(hidden.clone()),
            scales: self.head_scales.forward(hidden),
        }
    }

    /// The box of space that the field covers.
    pub fn space(&self) -> &SpaceBox {
        &self.space
    }

    /// The sizes it was made with.
    pub fn config(&self) -> &DeformationConfig {
        &self.config
    }

    /// The 4D encoder.
    pub fn encoder(&self) -> &HashEncoder {
        &self.encoder
    }
}
