//! Encoders of space and time: the representations of four papers behind one interface.

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
///
/// # Example
/// ```
/// use burn::tensor::{Device, Tensor};
/// use dash_model::{
///     DeformationConfig, DeformationField, HashEncoderConfig, Representation, SpaceBox,
/// };
/// use rand::SeedableRng;
///
/// let mut rng = rand_pcg::Pcg64::seed_from_u64(1);
/// let device = Device::flex();
/// let space = SpaceBox::fixed(1.0);
/// // Four-dimensional points: x, y, z, t.
/// let points = space.points_at(Tensor::zeros([5, 3], &device), 0.5)?;
/// let grid = HashEncoderConfig::new(2, 8, [4, 4, 4, 2], [8, 8, 8, 4]);
/// for representation in [
///     Representation::Hash,
///     Representation::HexPlane,
///     Representation::Grid4d,
///     Representation::Embedding,
/// ] {
///     let mut config = DeformationConfig::new(grid.clone(), 8);
///     config.representation = representation;
///     let field = DeformationField::new(&config, space, &mut rng, &device)?;
///     // Only `Representation::Embedding` takes an embedding per Gaussian.
///     let width = config.embedding_width();
///     let embeddings = (width > 0).then(|| Tensor::zeros([5, width], &device));
///     let features = field.encoder().forward(points.clone(), embeddings)?;
///     assert_eq!(field.decode(features)?.means.dims(), [5, 3]);
/// }
/// # Ok::<(), dash_model::ModelError>(())
/// ```
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
    /// An embedding per Gaussian and features of time (E-D3DGS).
    Embedding,
}

/// An encoder of space and time, one variant for each [`Representation`].
#[derive(Module, Debug)]
pub enum SpaceTimeEncoder {
    /// One 4D grid.
    Hash(HashEncoder),
    /// Six planes.
    HexPlanes(HexPlanes),
    /// Four 3D grids.
    Grid4d(Grid4d),
    /// Features of time, beside the embeddings of the Gaussians.
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
            Representation::Grid4d => Self::Grid4d(Grid4d::new(config, rng, device)?),
            Representation::Embedding => Self::Embedding(TimeEmbedding::new(grid, rng, device)?),
        })
    }

    /// Values in the parameters of an encoder of this configuration, saturating.
    pub(crate) fn n_values(config: &DeformationConfig) -> Result<u128, ModelError> {
        match config.representation {
            Representation::Hash => config.encoder.n_values(),
            Representation::HexPlane => HexPlanes::n_values(&config.encoder),
            Representation::Grid4d => Grid4d::n_values(config),
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

    /// Multiplications per point, without those for the interpolation weights; saturating.
    pub(crate) fn multiplications(config: &DeformationConfig) -> usize {
        let grid = &config.encoder;
        let per_feature = match config.representation {
            // Corners of a cell.
            Representation::Hash => 1 << 4,
            // Four corners on each plane, and their product.
            Representation::HexPlane => 6 * 4 + 5,
            // Eight corners in each grid, and its layer.
            Representation::Grid4d => {
                let with_time = of_levels(config.temporal()).saturating_mul(3);
                let features = of_levels(grid).saturating_add(with_time);
                return features.saturating_mul(config.hidden.saturating_add(8));
            }
            // Two vertices in each of two tables.
            Representation::Embedding => 2 * 2 * TimeEmbedding::FEATURES_OF_TIME,
        };
        of_levels(grid).saturating_mul(per_feature)
    }

    /// Features of points in the 4D unit cube.
    ///
    /// # Shapes
    /// `points [N, 4]` (x, y, z, t) in [0, 1], `embeddings [N, E]` where [`DeformationConfig::embedding_width`] is not 0
    /// `-> [N, features]`
    ///
    /// # Errors
    /// When a shape does not fit, or embeddings are missing.
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
                    ModelError::argument("embeddings", "a row for each Gaussian", "none")
                })?;
                encoder.forward(points, embeddings)
            }
        }
    }
}

/// Features per point of a grid's levels, without pruned ones; saturating.
fn of_levels(grid: &HashEncoderConfig) -> usize {
    let n_levels = grid.n_levels.saturating_sub(grid.pruned_levels.len());
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
