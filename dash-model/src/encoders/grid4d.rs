//! One 3D hash grid over space and three over two axes of space and time.

use burn::module::Module;
use burn::tensor::activation::{relu, sigmoid};
use burn::tensor::{Device, Tensor};
use rand::Rng;

use super::{columns, pick};
use crate::mlp::Mlp;
use crate::parameters::parameter;
use crate::{DeformationConfig, HashEncoder, HashEncoderConfig, ModelError};

const SPACE: [usize; 3] = [0, 1, 2];
const WITH_TIME: [[usize; 3]; 3] = [[0, 1, 3], [1, 2, 3], [0, 2, 3]];

/// Features over space and time from four 3D grids: the spatial features weight the temporal ones.
///
/// # Source
/// Xu et al. 2024 (Grid4D), directional attention. Its biases start as they do there, uniform in +-1 / sqrt(fan-in).
///
/// # Example
/// ```
/// use burn::tensor::{Device, Tensor};
/// use dash_model::{DeformationConfig, DeformationField, HashEncoderConfig, Representation, SpaceBox};
/// use rand::SeedableRng;
///
/// let grid = HashEncoderConfig::new(4, 10, [4, 4, 4, 2], [32, 32, 32, 8]);
/// let mut config = DeformationConfig::new(grid, 16);
/// config.representation = Representation::Grid4d;
/// config.temporal = Some(config.encoder.clone());
/// let (device, mut rng) = (Device::flex(), rand_pcg::Pcg64::seed_from_u64(1));
/// let field = DeformationField::new(&config, SpaceBox::fixed(1.0), &mut rng, &device)?;
/// let means = Tensor::<2>::from_data([[0.1, 0.2, 0.3], [-0.5, 0.0, 0.5]], &device);
/// let features = field.features(means, None, 0.5)?;
/// assert_eq!(field.decode(features)?.means.dims(), [2, 3]);
/// # Ok::<(), dash_model::ModelError>(())
/// ```
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

    /// Grids of a configuration, features as wide as its hidden layers.
    pub(super) fn new(
        config: &DeformationConfig,
        rng: &mut impl Rng,
        device: &Device,
    ) -> Result<Self, ModelError> {
        let (grid, hidden) = (&config.encoder, config.hidden);
        let spatial = Self::grid_over(grid, SPACE).init(rng, device)?;
        let over = |axes| Self::grid_over(config.temporal(), axes);
        let temporal = WITH_TIME.map(|axes| over(axes).init(rng, device));
        let temporal: Vec<HashEncoder> = temporal.into_iter().collect::<Result<_, _>>()?;
        let (width, with_time) = (
            spatial.n_output_features(),
            temporal.iter().map(HashEncoder::n_output_features).sum(),
        );
        let mut attention = Mlp::new(&[width, hidden], rng, device);
        // Features start at zero, nearly: without biases nothing would be weighted, and no grid would learn.
        let bound = (width as f32).sqrt().recip();
        let biases: Vec<f32> = (0..hidden)
            .map(|_| rng.random_range(-bound..bound))
            .collect();
        attention.layers[0].bias = Some(parameter(biases, [hidden], device));
        Ok(Self {
            spatial,
            temporal,
            attention,
            decoder: Mlp::new(&[with_time, hidden], rng, device),
        })
    }

    pub(super) fn n_values(config: &DeformationConfig) -> Result<u128, ModelError> {
        let (grid, temporal) = (&config.encoder, config.temporal());
        let mut sum = Self::grid_over(grid, SPACE).n_values()?;
        for axes in WITH_TIME {
            sum = sum.saturating_add(Self::grid_over(temporal, axes).n_values()?);
        }
        let width = |grid: &HashEncoderConfig| {
            (grid.n_levels as u128).saturating_mul(grid.n_features_per_level as u128)
        };
        let layer = |input: u128| (input + 1).saturating_mul(config.hidden as u128);
        Ok(sum
            .saturating_add(layer(width(grid)))
            .saturating_add(layer(width(temporal) * WITH_TIME.len() as u128)))
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
        Ok(weights * relu(self.decoder.forward(Tensor::cat(temporal, 1))?))
    }
}
