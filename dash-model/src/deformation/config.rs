//! Sizes of a deformation field.

use serde::{Deserialize, Serialize};

use super::Heads;
use super::heads::MAX_SH_REST;
use crate::encoders::{Representation, SpaceTimeEncoder, TimeEmbedding};
use crate::{HashEncoderConfig, ModelError};

/// Sizes of a [`DeformationField`](crate::DeformationField).
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
    /// The four-dimensional grid (x, y, z, t). [`Representation::Hash`] is this grid.
    /// [`Representation::HexPlane`] and [`Representation::Grid4d`] use grids over some of its axes at the same
    /// resolutions. [`Representation::Embedding`] uses its time axis at the base and the finest resolution, and gives
    /// every Gaussian as many features as all levels have.
    pub encoder: HashEncoderConfig,
    /// The four-dimensional grid whose axes the grids with time of [`Representation::Grid4d`] are over; absent: `encoder`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub temporal: Option<HashEncoderConfig>,
    /// Heads of the decoder beside the one for positions.
    #[serde(default)]
    pub heads: Heads,
}

impl DeformationConfig {
    /// A hash grid and one hidden layer, with the heads of DASH.
    pub fn new(encoder: HashEncoderConfig, hidden: usize) -> Self {
        Self {
            representation: Representation::Hash,
            hidden,
            layers: 1,
            encoder,
            temporal: None,
            heads: Heads::default(),
        }
    }

    /// Width of the embedding that every Gaussian must have, see [`Gaussians::embeddings`]; 0 where none is used.
    ///
    /// [`Gaussians::embeddings`]: crate::Gaussians::embeddings
    pub fn embedding_width(&self) -> usize {
        match self.representation {
            Representation::Embedding => TimeEmbedding::embedding_width(&self.encoder),
            _ => 0,
        }
    }

    /// Checks the sizes.
    ///
    /// # Errors
    /// [`ModelError::Config`] or [`ModelError::Kernel`] when one is out of range.
    pub fn validate(&self) -> Result<(), ModelError> {
        for (key, size) in [("hidden", self.hidden), ("layers", self.layers)] {
            if size == 0 {
                return Err(ModelError::config(key, "at least 1", "0"));
            }
        }
        if self.heads.sh_rest > MAX_SH_REST {
            let found = self.heads.sh_rest.to_string();
            return Err(ModelError::config("heads.sh_rest", "at most 15", found));
        }
        if self.temporal.is_some() && self.representation != Representation::Grid4d {
            return Err(ModelError::config(
                "temporal",
                "none, except in the representation `grid4d`",
                format!("one in `{:?}`", self.representation),
            ));
        }
        let of_encoder = [
            "encoder.base_resolution",
            "encoder.finest_resolution",
            "encoder.pruned_levels",
        ];
        let of_temporal = [
            "temporal.base_resolution",
            "temporal.finest_resolution",
            "temporal.pruned_levels",
        ];
        let temporal = self.temporal.as_ref().map(|grid| (of_temporal, grid));
        let grids = std::iter::once((of_encoder, &self.encoder)).chain(temporal);
        for ([base_key, finest_key, pruned_key], grid) in grids {
            for (key, resolution) in [
                (base_key, &grid.base_resolution),
                (finest_key, &grid.finest_resolution),
            ] {
                if resolution.len() != 4 {
                    let found = resolution.len().to_string();
                    return Err(ModelError::config(key, "4 values (x, y, z, t)", found));
                }
            }
            grid.layout()?;
            if self.representation != Representation::Hash && !grid.pruned_levels.is_empty() {
                return Err(ModelError::config(
                    pruned_key,
                    "none, except in the representation `hash`",
                    format!("{:?}", grid.pruned_levels),
                ));
            }
        }
        self.n_values().map(drop)
    }

    /// The grid whose axes grids with time are over.
    pub(crate) fn temporal(&self) -> &HashEncoderConfig {
        self.temporal.as_ref().unwrap_or(&self.encoder)
    }

    /// Decoders whose offsets are added: one for each resolution of time in [`Representation::Embedding`], else one.
    pub(crate) fn n_decoders(&self) -> usize {
        match self.representation {
            Representation::Embedding => 2,
            _ => 1,
        }
    }

    /// Features that a decoder sees.
    pub(crate) fn n_decoder_inputs(&self) -> usize {
        match self.representation {
            Representation::Embedding => {
                let [own, of_time] = TimeEmbedding::widths(&self.encoder);
                own.saturating_add(of_time)
            }
            _ => SpaceTimeEncoder::n_output_features_of(self),
        }
    }

    /// Multiplications for one Gaussian at one time, without those for the interpolation weights; saturating.
    pub fn multiplications(&self) -> usize {
        let features = self.n_decoder_inputs();
        let (hidden, layers) = (self.hidden, self.layers.saturating_sub(1));
        let trunk = layers.saturating_mul(hidden).saturating_add(features);
        let heads: usize = self.heads.present().map(|(_, width)| width).sum();
        trunk
            .saturating_add(heads)
            .saturating_mul(hidden)
            .saturating_mul(self.n_decoders())
            .saturating_add(SpaceTimeEncoder::multiplications(self))
    }

    /// Values in the parameters of a field of these sizes, saturating.
    ///
    /// # Errors
    /// When the grid's configuration is out of range.
    pub(crate) fn n_values(&self) -> Result<u128, ModelError> {
        let linear = |from: u128, to: u128| from.saturating_mul(to).saturating_add(to);
        let (hidden, layers) = (self.hidden as u128, self.layers as u128);
        let features = self.n_decoder_inputs() as u128;
        let trunk = linear(features, hidden)
            .saturating_add(linear(hidden, hidden).saturating_mul(layers.saturating_sub(1)));
        let heads = self.heads.present().fold(0u128, |sum, (_, width)| {
            sum.saturating_add(linear(hidden, width as u128))
        });
        let decoders = trunk
            .saturating_add(heads)
            .saturating_mul(self.n_decoders() as u128);
        Ok(SpaceTimeEncoder::n_values(self)?.saturating_add(decoders))
    }
}
