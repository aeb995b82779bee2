//! One 3D hash grid over space and three over two axes of space and time.

use burn::module::Module;
use burn::tensor::activation::sigmoid;
use burn::tensor::{Device, Tensor};
use rand::Rng;

use super::{columns, pick};
use crate::mlp::Mlp;
use crate::{HashEncoder, HashEncoderConfig, ModelError};

const SPACE: [usize; 3] = [0, 1, 2];
const WITH_TIME: [[usize; 3]; 3] = [[0, 1, 3], [1, 2, 3], [0, 2, 3]];

/// Features over space and time from four 3D grids: the spatial features weight the temporal ones.
///
/// # Source
/// Xu et al. 2024 (Grid4D), directional attention.
#[derive(Module, Debug)]
pub struct Grid4d {
    /// Over x, y, z.
    pub spatial: HashEncoder,
    /// Over xyt, yzt and xzt.
    pub temporal: Vec<HashEncoder>,
    /// From spatial features to weights in [-1, 1].
    pub attention: Mlp,
    /// From temporal features to the features that are weighted.
    pub decoder: Mlp,
}

impl Grid4d {
    fn grid_over(grid: &HashEncoderConfig, axes: [usize; 3]) -> HashEncoderConfig {
        HashEncoderConfig {
            base_resolution: pick(&grid.base_resolution, axes),
            finest_resolution: pick(&grid.finest_resolution, axes),
            ..grid.clone()
        }
    }

    /// Grids of the resolutions of a four-dimensional `grid`, features `hidden` wide.
    pub(super) fn new(
        grid: &HashEncoderConfig,
        hidden: usize,
        rng: &mut impl Rng,
        device: &Device,
    ) -> Result<Self, ModelError> {
        let spatial = Self::grid_over(grid, SPACE).init(rng, device)?;
        let temporal = WITH_TIME.map(|axes| Self::grid_over(grid, axes).init(rng, device));
        let width = spatial.n_output_features();
        Ok(Self {
            spatial,
            temporal: temporal.into_iter().collect::<Result<_, _>>()?,
            attention: Mlp::new(&[width, hidden], rng, device),
            decoder: Mlp::new(&[WITH_TIME.len() * width, hidden], rng, device),
        })
    }

    pub(super) fn n_values(grid: &HashEncoderConfig, hidden: usize) -> Result<u128, ModelError> {
        let mut sum = Self::grid_over(grid, SPACE).n_values()?;
        for axes in WITH_TIME {
            sum = sum.saturating_add(Self::grid_over(grid, axes).n_values()?);
        }
        let width = grid.n_levels as u128 * grid.n_features_per_level as u128;
        let layer = |input: u128| (input + 1).saturating_mul(hidden as u128);
        Ok(sum
            .saturating_add(layer(width))
            .saturating_add(layer(width * WITH_TIME.len() as u128)))
    }

    /// # Shapes
    /// `points [N, 4] -> [N, hidden]`
    pub(super) fn forward(&self, points: Tensor<2>) -> Result<Tensor<2>, ModelError> {
        let spatial = self.spatial.forward(columns(&points, SPACE))?;
        let mut temporal = Vec::with_capacity(self.temporal.len());
        for (grid, &axes) in self.temporal.iter().zip(&WITH_TIME) {
            temporal.push(grid.forward(columns(&points, axes))?);
        }
        let weights = sigmoid(self.attention.forward(spatial)?) * 2.0 - 1.0;
        Ok(weights * self.decoder.forward(Tensor::cat(temporal, 1))?)
    }
}
