//! Features over space and time, each way of storing them behind one interface.

mod grid4d;
mod hex_planes;
mod time_embedding;

use burn::module::Module;
use burn::tensor::{Device, Tensor};
use rand::Rng;
use serde::{Deserialize, Serialize};

pub use grid4d::Grid4d;
pub use hex_planes::HexPlanes;
pub use time_embedding::TimeEmbedding;

use crate::{DeformationConfig, HashEncoder, HashEncoderConfig, ModelError};

/// How features over space and time are stored.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Representation {
    /// One 4D multiresolution hash grid (DASH).
    #[default]
    Hash,
    /// Six planes whose features are multiplied (4DGaussians).
    HexPlane,
    /// One 3D hash grid over space and three over two axes of space and time (Grid4D).
    Grid4d,
    /// A feature of every Gaussian's own beside one of the time (E-D3DGS).
    Embedding,
}

/// Features over space and time, as a [`Representation`] says.
#[derive(Module, Debug)]
pub enum SpaceTimeEncoder {
    /// One 4D grid.
    Hash(HashEncoder),
    /// Six planes.
    HexPlanes(HexPlanes),
    /// Four 3D grids.
    Grid4d(Grid4d),
    /// Time alone; the rest is the Gaussians' own.
    Embedding(TimeEmbedding),
}

impl SpaceTimeEncoder {
    /// The encoder of a configuration.
    ///
    /// # Errors
    /// When the configuration is out of range or not four-dimensional.
    pub(crate) fn new(
        config: &DeformationConfig,
        rng: &mut impl Rng,
        device: &Device,
    ) -> Result<Self, ModelError> {
        config.validate()?;
        let grid = &config.encoder;
        Ok(match config.representation {
            Representation::Hash => Self::Hash(grid.init(rng, device)?),
            Representation::HexPlane => Self::HexPlanes(HexPlanes::new(grid, rng, device)?),
            Representation::Grid4d => Self::Grid4d(Grid4d::new(grid, config.hidden, rng, device)?),
            Representation::Embedding => Self::Embedding(TimeEmbedding::new(grid, rng, device)?),
        })
    }

    /// How many values the parameters of this encoder hold, saturating.
    pub(crate) fn n_values(config: &DeformationConfig) -> Result<u128, ModelError> {
        match config.representation {
            Representation::Hash => config.encoder.n_values(),
            Representation::HexPlane => HexPlanes::n_values(&config.encoder),
            Representation::Grid4d => Grid4d::n_values(&config.encoder, config.hidden),
            Representation::Embedding => TimeEmbedding::n_values(&config.encoder),
        }
    }

    /// Features per point of an encoder of this configuration, saturating.
    pub(crate) fn n_output_features_of(config: &DeformationConfig) -> usize {
        let grid = &config.encoder;
        match config.representation {
            Representation::Hash | Representation::HexPlane => of_levels(grid),
            Representation::Grid4d => config.hidden,
            Representation::Embedding => TimeEmbedding::n_output_features_of(grid),
        }
    }

    /// Multiplications per point, those that find the weights of a cell's corners aside; saturating.
    pub(crate) fn multiplications(config: &DeformationConfig) -> usize {
        let grid = &config.encoder;
        let of_levels = of_levels(grid);
        let per_feature = match config.representation {
            // Corners of a cell.
            Representation::Hash => 1 << 4,
            // Four corners on each plane, and their product.
            Representation::HexPlane => 6 * 4 + 5,
            // Eight corners in each grid, and its layer.
            Representation::Grid4d => 4 * (8 + config.hidden),
            // Time finds two vertices in each of two tables, half as wide.
            Representation::Embedding => 2,
        };
        of_levels.saturating_mul(per_feature)
    }

    /// Features of points in the 4D unit cube.
    ///
    /// # Shapes
    /// `points [N, 4]` (x, y, z, t) in [0, 1], `embeddings [N, E]` where
    /// [`DeformationConfig::embedding_width`] is not 0 `-> [N, n_output_features]`
    ///
    /// # Errors
    /// When a shape does not fit, or the Gaussians have no embeddings where they should.
    pub fn forward(
        &self,
        points: Tensor<2>,
        embeddings: Option<Tensor<2>>,
    ) -> Result<Tensor<2>, ModelError> {
        match self {
            Self::Hash(encoder) => encoder.forward(points),
            Self::HexPlanes(encoder) => encoder.forward(points),
            Self::Grid4d(encoder) => encoder.forward(points),
            Self::Embedding(encoder) => {
                let embeddings = embeddings.ok_or_else(|| {
                    ModelError::Config(
                        "Gaussians without embeddings in a field that needs them".into(),
                    )
                })?;
                encoder.forward(points, embeddings)
            }
        }
    }
}

/// Features of all levels that a grid has, saturating.
fn of_levels(grid: &HashEncoderConfig) -> usize {
    let n_levels = grid.n_levels.saturating_sub(grid.left_out_levels.len());
    n_levels.saturating_mul(grid.n_features_per_level)
}

/// Some columns of points `[N, 4]`, in order.
fn columns<const D: usize>(points: &Tensor<2>, axes: [usize; D]) -> Tensor<2> {
    Tensor::cat(
        axes.iter()
            .map(|&axis| points.clone().narrow(1, axis, 1))
            .collect(),
        1,
    )
}

/// Chosen entries of a resolution per axis.
fn pick<const D: usize>(resolution: &[u32], axes: [usize; D]) -> Vec<u32> {
    axes.iter().map(|&axis| resolution[axis]).collect()
}

#[cfg(test)]
mod tests;
