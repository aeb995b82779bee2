//! The field over space and time with its multi-head decoder.

mod decoder;
mod heads;

use burn::module::Module;
use burn::tensor::{Device, Tensor};
use rand::Rng;
use serde::{Deserialize, Serialize};

use crate::encoders::{Representation, SpaceTimeEncoder, TimeEmbedding};
use crate::gaussians::to_host;
use crate::{HashEncoderConfig, ModelError, SpaceBox};
pub(crate) use decoder::Decoder;
use heads::{APPEARANCE, MEAN, QUAT, SCALE};
pub use heads::{Head, Heads};

/// World units per unit of the position head, as a share of the diagonal (see `motion.rs`).
const OUTPUT_SCALE: f32 = 0.1;

/// Sizes of a [`DeformationField`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DeformationConfig {
    /// How features over space and time are stored.
    #[serde(default)]
    pub representation: Representation,
    /// Units of every hidden layer of the decoder.
    pub hidden: usize,
    /// Hidden layers between the encoding and the heads.
    pub layers: usize,
    /// The four-dimensional grid (x, y, z, t). [`Representation::Hash`] holds it as it is;
    /// [`Representation::HexPlane`] and [`Representation::Grid4d`] the grids over some of its axes at the same
    /// resolutions; [`Representation::Embedding`] its time axis at the base and the finest resolution, and as
    /// many features for each Gaussian as all levels have.
    pub encoder: HashEncoderConfig,
    /// What the decoder has heads for beside positions.
    #[serde(default)]
    pub heads: Heads,
}

impl DeformationConfig {
    /// Features that every Gaussian has to have of its own, see [`Gaussians::embeddings`].
    ///
    /// [`Gaussians::embeddings`]: crate::Gaussians::embeddings
    pub fn embedding_width(&self) -> usize {
        match self.representation {
            Representation::Embedding => TimeEmbedding::embedding_width(&self.encoder),
            _ => 0,
        }
    }

    /// Checks the grid.
    ///
    /// # Errors
    /// When it is out of range or not four-dimensional.
    pub fn validate(&self) -> Result<(), ModelError> {
        let grid = &self.encoder;
        if grid.base_resolution.len() != 4 || grid.finest_resolution.len() != 4 {
            return Err(ModelError::Config(format!(
                "expected 4 resolutions (x, y, z, t) in encoder.base_resolution and in \
                 encoder.finest_resolution, found {} and {}",
                grid.base_resolution.len(),
                grid.finest_resolution.len()
            )));
        }
        grid.layout()?;
        if self.representation != Representation::Hash && !grid.left_out_levels.is_empty() {
            return Err(ModelError::Config(
                "levels can be left out (encoder.left_out_levels) of the representation `hash` only"
                    .into(),
            ));
        }
        self.n_values().map(drop)
    }

    /// Multiplications for one Gaussian at one time, those that find corners' weights aside; saturating.
    pub fn multiplications(&self) -> usize {
        let features = SpaceTimeEncoder::n_output_features_of(self);
        let (hidden, layers) = (self.hidden, self.layers.saturating_sub(1));
        let trunk = layers.saturating_mul(hidden).saturating_add(features);
        let heads: usize = self.heads.present().map(|(_, width)| width).sum();
        trunk
            .saturating_add(heads)
            .saturating_mul(hidden)
            .saturating_add(SpaceTimeEncoder::multiplications(self))
    }

    /// How many values the parameters of a field of these sizes hold, saturating.
    ///
    /// # Errors
    /// When the grid's configuration is out of range.
    pub(crate) fn n_values(&self) -> Result<u128, ModelError> {
        let linear = |from: u128, to: u128| from.saturating_mul(to).saturating_add(to);
        let (hidden, layers) = (self.hidden as u128, self.layers as u128);
        let features = SpaceTimeEncoder::n_output_features_of(self) as u128;
        let trunk = linear(features, hidden)
            .saturating_add(linear(hidden, hidden).saturating_mul(layers.saturating_sub(1)));
        let heads = self.heads.present().fold(0u128, |sum, (_, width)| {
            sum.saturating_add(linear(hidden, width as u128))
        });
        Ok(SpaceTimeEncoder::n_values(self)?
            .saturating_add(trunk)
            .saturating_add(heads))
    }
}

/// What the field adds to canonical Gaussians at one time; `None` where it has no head for it.
#[derive(Debug, Clone)]
pub struct Offsets {
    /// To the means `[N, 3]`, world units.
    pub means: Tensor<2>,
    /// To the quaternions `[N, 4]`.
    pub quats: Option<Tensor<2>>,
    /// To the (log) scales `[N, 3]`.
    pub scales: Option<Tensor<2>>,
    /// To the opacity logits `[N]`.
    pub opacity_logits: Option<Tensor<1>>,
    /// To the constant colour coefficients `[N, 1, 3]`.
    pub sh_dc: Option<Tensor<3>>,
}

/// Deformation over space and time: features, a shared decoder, one head each for position, rotation and
/// scale.
///
/// # Source
/// DASH Eqs. 7-10.
#[derive(Module, Debug)]
pub struct DeformationField {
    encoder: SpaceTimeEncoder,
    decoder: Decoder,
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
        let encoder = SpaceTimeEncoder::new(config, rng, device)?;
        let mut widths = vec![SpaceTimeEncoder::n_output_features_of(config)];
        widths.extend(std::iter::repeat_n(hidden, config.layers));
        Ok(Self {
            encoder,
            decoder: Decoder::new(&widths, &config.heads, rng, device)?,
            space,
            config: config.clone(),
        })
    }

    /// The features `G_4D(P, t)`.
    ///
    /// # Shapes
    /// `means [N, 3]` in world units, `embeddings [N, E]` where the configuration asks for them ->
    /// `[N, features]`
    ///
    /// # Errors
    /// When a shape does not fit.
    pub fn features(
        &self,
        means: Tensor<2>,
        embeddings: Option<Tensor<2>>,
        time: f32,
    ) -> Result<Tensor<2>, ModelError> {
        self.features_at(self.space.points_at(means, time)?, embeddings)
    }

    /// The features at points of the 4D unit cube.
    ///
    /// # Shapes
    /// `points [N, 4]`, `embeddings [N, E]` where the configuration asks for them `-> [N, features]`
    ///
    /// # Errors
    /// When a shape does not fit.
    pub fn features_at(
        &self,
        points: Tensor<2>,
        embeddings: Option<Tensor<2>>,
    ) -> Result<Tensor<2>, ModelError> {
        self.encoder.forward(points, embeddings)
    }

    /// Decodes features into offsets.
    ///
    /// # Shapes
    /// `features [N, features]`
    ///
    /// # Errors
    /// When the features have another width, or there are more than the device holds.
    pub fn decode(&self, features: Tensor<2>) -> Result<Offsets, ModelError> {
        let n = features.dims()[0];
        let columns = self.decoder.forward(features)?;
        let mut first = 0;
        let mut take = |width: usize| {
            first += width;
            columns.clone().narrow(1, first - width, width)
        };
        let heads = &self.config.heads;
        let means = take(MEAN) * (OUTPUT_SCALE * self.space.diagonal());
        let quats = heads.rotation.then(|| take(QUAT));
        let scales = heads.scale.then(|| take(SCALE));
        let appearance = heads.appearance.then(|| take(APPEARANCE));
        Ok(Offsets {
            means,
            quats,
            scales,
            opacity_logits: appearance
                .as_ref()
                .map(|columns| columns.clone().narrow(1, 0, 1).reshape([n])),
            sh_dc: appearance.map(|columns| columns.narrow(1, 1, 3).reshape([n, 1, 3])),
        })
    }

    /// The field without a head.
    pub fn without_head(&self, head: Head) -> Self {
        let mut field = self.clone();
        let heads = &mut field.config.heads;
        match head {
            Head::Rotation => heads.rotation = false,
            Head::Scale => heads.scale = false,
        }
        field.decoder = self.decoder.with_heads(heads);
        field
    }

    /// The field without some levels of its hash grid, counted as they are now; what they hold on
    /// average goes into the decoder's first bias.
    ///
    /// # Shapes
    /// `typical`: the mean of [`DeformationField::features`] over what the field is asked for, a value
    /// for each.
    ///
    /// # Errors
    /// When the field has no hash grid or no such level, none would be left, or `typical` has another
    /// length.
    pub fn without_levels(&self, left_out: &[usize], typical: &[f32]) -> Result<Self, ModelError> {
        let SpaceTimeEncoder::Hash(encoder) = &self.encoder else {
            return Err(ModelError::Config(
                "a field without a hash grid has no levels to leave out".into(),
            ));
        };
        let width = encoder.layout().n_features_per_level();
        let n_features = encoder.n_output_features();
        if typical.len() != n_features {
            return Err(ModelError::Config(format!(
                "expected the means of {n_features} features, found {}",
                typical.len()
            )));
        }
        let reduced = encoder.without(left_out)?;
        let kept: Vec<bool> = (0..n_features)
            .map(|feature| !left_out.contains(&(feature / width)))
            .collect();
        let mut field = self.clone();
        field.decoder = self
            .decoder
            .with_features(&kept, typical, &self.config.heads)?;
        field.encoder = SpaceTimeEncoder::Hash(reduced);
        // The configuration counts all levels there ever were.
        let config = &mut field.config.encoder;
        let present: Vec<usize> = (0..config.n_levels)
            .filter(|level| !config.left_out_levels.contains(level))
            .collect();
        config
            .left_out_levels
            .extend(left_out.iter().map(|&level| present[level]));
        config.left_out_levels.sort_unstable();
        Ok(field)
    }

    /// The field with zeros in the entries of its hash grid that points at `means [N, 3]`, in world units, read
    /// at no time, and how many entries are read of how many, see [`HashEncoder::without_unread`]. `None` of a
    /// field without a hash grid.
    ///
    /// [`HashEncoder::without_unread`]: crate::HashEncoder::without_unread
    pub fn without_unread(&self, means: Tensor<2>) -> Option<(Self, [usize; 2])> {
        let SpaceTimeEncoder::Hash(encoder) = &self.encoder else {
            return None;
        };
        let places = to_host(self.space.normalize(means).detach());
        let (encoder, counts) = encoder.without_unread(&places);
        let mut field = self.clone();
        field.encoder = SpaceTimeEncoder::Hash(encoder);
        Some((field, counts))
    }

    /// The box of space that the field covers.
    pub fn space(&self) -> &SpaceBox {
        &self.space
    }

    /// The sizes it was made with.
    pub fn config(&self) -> &DeformationConfig {
        &self.config
    }

    /// Its hidden layers and heads.
    pub(crate) fn decoder(&self) -> &Decoder {
        &self.decoder
    }

    /// Its features.
    pub fn encoder(&self) -> &SpaceTimeEncoder {
        &self.encoder
    }
}
