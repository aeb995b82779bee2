//! The deformation field: features over space and time, and a multi-head decoder.

mod config;
mod decoder;
mod heads;
mod packing;

use burn::module::Module;
use burn::tensor::{Device, Tensor};
use dash_kernels::deform::Columns;
use rand::Rng;

use crate::encoders::{Representation, SpaceTimeEncoder, TimeEmbedding};
use crate::gaussians::to_host;
use crate::{ModelError, SpaceBox};
pub use config::DeformationConfig;
pub(crate) use decoder::Decoder;
use heads::{APPEARANCE, CHANNELS, MEAN, QUAT, SCALE};
pub use heads::{Head, Heads};

/// World units per unit of the position head, as a share of the diagonal (see `motion.rs`).
const OUTPUT_SCALE: f32 = 0.1;

/// Colour coefficients per unit of the head for opacities and colours. From black to white are 3.5 of them, and a run sees each time
/// a few times only.
const COLOR_SCALE: f32 = 5.0;

/// What the field adds to canonical Gaussians at one time; `None` for a head that the field does not have.
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
    /// To the others `[N, K - 1, 3]`.
    pub sh_rest: Option<Tensor<3>>,
}

/// Those of [`Offsets`] that change colours and opacities.
pub(crate) struct Appearance {
    pub(crate) opacity_logits: Option<Tensor<1>>,
    pub(crate) sh_dc: Option<Tensor<3>>,
    pub(crate) sh_rest: Option<Tensor<3>>,
}

/// A deformation field: features over space and time, a shared decoder, and one head each for positions, rotations and
/// scales.
///
/// # Source
/// DASH Eqs. 7-10.
///
/// # Example
/// ```
/// use burn::tensor::{Device, Tensor};
/// use dash_model::{DeformationConfig, DeformationField, HashEncoderConfig, SpaceBox};
/// use rand::SeedableRng;
///
/// let grid = HashEncoderConfig::new(4, 10, [4, 4, 4, 2], [32, 32, 32, 8]);
/// let mut config = DeformationConfig::new(grid, 16);
/// config.heads.appearance = true;
/// let device = Device::flex();
/// let mut rng = rand_pcg::Pcg64::seed_from_u64(1);
/// let field = DeformationField::new(&config, SpaceBox::fixed(1.0), &mut rng, &device)?;
/// let means = Tensor::<2>::from_data([[0.1, 0.2, 0.3], [-0.5, 0.0, 0.5]], &device);
/// let offsets = field.decode(field.features(means, None, 0.5)?)?;
/// assert_eq!(offsets.means.dims(), [2, 3]);
/// assert_eq!(offsets.quats.expect("a head").dims(), [2, 4]);
/// assert_eq!(offsets.opacity_logits.expect("a head").dims(), [2]);
/// # Ok::<(), dash_model::ModelError>(())
/// ```
#[derive(Module, Debug)]
pub struct DeformationField {
    encoder: SpaceTimeEncoder,
    decoder: Decoder,
    /// Of the fine features of time, where `decoder` sees the coarse ones only; their offsets are added.
    fine: Option<Decoder>,
    #[module(skip)]
    space: SpaceBox,
    #[module(skip)]
    config: DeformationConfig,
}

impl DeformationField {
    /// A field over `space` and the whole clip that deforms nothing yet.
    ///
    /// # Errors
    /// When the configuration is out of range, or a table is too large for the device.
    pub fn new(
        config: &DeformationConfig,
        space: SpaceBox,
        rng: &mut impl Rng,
        device: &Device,
    ) -> Result<Self, ModelError> {
        let encoder = SpaceTimeEncoder::new(config, rng, device)?;
        let mut widths = vec![config.n_decoder_inputs()];
        widths.extend(std::iter::repeat_n(config.hidden, config.layers));
        let mut decoder = || Decoder::new(&widths, &config.heads, rng, device);
        Ok(Self {
            encoder,
            decoder: decoder()?,
            fine: (config.n_decoders() > 1).then(decoder).transpose()?,
            space,
            config: config.clone(),
        })
    }

    /// The features `G_4D(P, t)`.
    ///
    /// # Shapes
    /// `means [N, 3]` in world units, `embeddings [N, E]` with `E` of [`DeformationConfig::embedding_width`] unless that is 0
    /// `-> [N, features]`
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
    /// `points [N, 4]` (x, y, z, t) in [0, 1], `embeddings [N, E]` as for [`DeformationField::features`] `-> [N, features]`
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
    /// `[N, features]` -> see [`Offsets`]
    ///
    /// # Errors
    /// When the features have another width, or there are more than the device holds.
    pub fn decode(&self, features: Tensor<2>) -> Result<Offsets, ModelError> {
        let decoded = self.decoded(features)?;
        let columns = self.columns();
        let take = |first: usize, width: usize| decoded.clone().narrow(1, first, width);
        let Appearance {
            opacity_logits,
            sh_dc,
            sh_rest,
        } = self.appearance(&decoded);
        Ok(Offsets {
            means: take(0, MEAN) * columns.mean_factor,
            quats: columns.quats.map(|first| take(first, QUAT)),
            scales: columns.scales.map(|first| take(first, SCALE)),
            opacity_logits,
            sh_dc,
            sh_rest,
        })
    }

    /// The output of the heads, side by side: see [`DeformationField::columns`].
    ///
    /// # Shapes
    /// `[N, features] -> [N, columns]`
    ///
    /// # Errors
    /// When the features have another width, or there are more than the device holds.
    pub(crate) fn decoded(&self, features: Tensor<2>) -> Result<Tensor<2>, ModelError> {
        let Some(fine) = &self.fine else {
            return self.decoder.forward(features);
        };
        let n_features = features.dims()[1];
        let expected = SpaceTimeEncoder::n_output_features_of(&self.config);
        if n_features != expected {
            let (expected, found) = (format!("width {expected}"), n_features.to_string());
            return Err(ModelError::argument("features", expected, found));
        }
        let [own, of_time] = TimeEmbedding::widths(&self.config.encoder);
        let take = |first: usize, width: usize| features.clone().narrow(1, first, width);
        let of_fine = vec![take(0, own), take(own + of_time, of_time)];
        let coarse = self.decoder.forward(take(0, own + of_time))?;
        Ok(coarse + fine.forward(Tensor::cat(of_fine, 1))?)
    }

    /// Where the offsets of means, rotations and scales are among the columns of [`DeformationField::decoded`].
    pub(crate) fn columns(&self) -> Columns {
        let heads = &self.config.heads;
        let behind_quats = if heads.rotation { MEAN + QUAT } else { MEAN };
        Columns {
            mean_factor: OUTPUT_SCALE * self.space.diagonal(),
            quats: heads.rotation.then_some(MEAN),
            scales: heads.scale.then_some(behind_quats),
        }
    }

    /// What changes colours and opacities among the columns of [`DeformationField::decoded`]: the last ones.
    pub(crate) fn appearance(&self, decoded: &Tensor<2>) -> Appearance {
        let heads = &self.config.heads;
        let [n, width] = decoded.dims();
        let take = |first: usize, width: usize| decoded.clone().narrow(1, first, width);
        let of_rest = heads.sh_rest * CHANNELS;
        let first = width - of_rest - if heads.appearance { APPEARANCE } else { 0 };
        let sh_rest = (of_rest > 0).then(|| take(width - of_rest, of_rest));
        Appearance {
            opacity_logits: heads.appearance.then(|| take(first, 1).reshape([n])),
            sh_dc: heads.appearance.then(|| {
                (take(first + 1, CHANNELS) * self.color_scale()).reshape([n, 1, CHANNELS])
            }),
            sh_rest: sh_rest.map(|columns| columns.reshape([n, heads.sh_rest, CHANNELS])),
        }
    }

    /// Of 4DGaussians and E-D3DGS, 1.
    fn color_scale(&self) -> f32 {
        match self.config.representation {
            Representation::Hash | Representation::Grid4d => COLOR_SCALE,
            Representation::HexPlane | Representation::Embedding => 1.0,
        }
    }

    /// The field without one of its heads.
    pub fn without_head(&self, head: Head) -> Self {
        let mut heads = self.config.heads;
        match head {
            Head::Rotation => heads.rotation = false,
            Head::Scale => heads.scale = false,
            Head::Appearance => heads.appearance = false,
        }
        self.with_heads(heads)
    }

    /// The field for Gaussians without higher colour coefficients.
    pub fn without_sh_rest(&self) -> Self {
        self.with_heads(Heads {
            sh_rest: 0,
            ..self.config.heads
        })
    }

    /// The field with these of its heads only.
    fn with_heads(&self, heads: Heads) -> Self {
        let mut field = self.clone();
        field.config.heads = heads;
        field.decoder = self.decoder.with_heads(&heads);
        field.fine = self.fine.as_ref().map(|fine| fine.with_heads(&heads));
        field
    }

    /// The field without some levels of its hash grid. Their average contribution goes into the decoder's first bias.
    ///
    /// `pruned` indexes the levels that the field has now.
    ///
    /// # Shapes
    /// `typical [features]`: the mean of [`DeformationField::features`] over the points and times of interest.
    ///
    /// # Errors
    /// [`ModelError::Argument`] when the field has no hash grid or `typical` has another length,
    /// [`ModelError::Kernel`] when there is no such level or none would remain.
    pub fn without_levels(&self, pruned: &[usize], typical: &[f32]) -> Result<Self, ModelError> {
        let SpaceTimeEncoder::Hash(encoder) = &self.encoder else {
            return Err(ModelError::argument(
                "pruned",
                "levels of a hash grid",
                format!("a field of {:?}", self.config.representation),
            ));
        };
        let width = encoder.layout().n_features_per_level();
        let n_features = encoder.n_output_features();
        if typical.len() != n_features {
            return Err(ModelError::argument(
                "typical",
                format!("the means of {n_features} features"),
                typical.len().to_string(),
            ));
        }
        let reduced = encoder.without(pruned)?;
        let kept: Vec<bool> = (0..n_features)
            .map(|feature| !pruned.contains(&(feature / width)))
            .collect();
        let mut field = self.clone();
        field.decoder = self
            .decoder
            .with_features(&kept, typical, &self.config.heads)?;
        field.encoder = SpaceTimeEncoder::Hash(reduced);
        // The configuration indexes the levels before any pruning.
        let config = &mut field.config.encoder;
        let present: Vec<usize> = (0..config.n_levels)
            .filter(|level| !config.pruned_levels.contains(level))
            .collect();
        config
            .pruned_levels
            .extend(pruned.iter().map(|&level| present[level]));
        config.pruned_levels.sort_unstable();
        Ok(field)
    }

    /// The field with zeros in the entries of its hash grid that `means` read at no time, and the numbers of entries read
    /// and of all entries. `None` for a field without a hash grid. See [`HashEncoder::without_unread`].
    ///
    /// # Shapes
    /// `means [N, 3]`, world units.
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

    /// The sizes of the field.
    pub fn config(&self) -> &DeformationConfig {
        &self.config
    }

    /// Hidden layers and heads: the prefix of their names in files, and the parameter that holds them.
    pub(crate) fn decoders(&self) -> impl Iterator<Item = (&'static str, &'static str, &Decoder)> {
        let fine = self
            .fine
            .as_ref()
            .map(|fine| ("fine.", "fine.parameters", fine));
        std::iter::once(("", "decoder.parameters", &self.decoder)).chain(fine)
    }

    /// The features over space and time.
    pub fn encoder(&self) -> &SpaceTimeEncoder {
        &self.encoder
    }
}
