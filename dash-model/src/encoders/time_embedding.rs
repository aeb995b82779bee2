//! Features of time, beside an embedding per Gaussian.

use burn::module::{Module, Param};
use burn::tensor::activation::relu;
use burn::tensor::{Device, Tensor, TensorData};
use dash_kernels::mlp::{MlpLayout, mlp};
use rand::Rng;

use crate::parameters::parameter;
use crate::{HashEncoderConfig, ModelError};

const TIME: usize = 3;
/// Half-width of the uniform distribution that features start from.
const INITIAL: f32 = 0.1;
/// Most vertices along time.
const MAX_RESOLUTION: u32 = 1 << 16;

/// Piecewise linear features of time, coarse and fine.
///
/// # Source
/// Bae et al. 2024 (E-D3DGS): an embedding per Gaussian, temporal embeddings of two resolutions, each with a decoder of its
/// own. There the coarse one is interpolated from the fine one.
///
/// # Example
/// ```
/// use burn::tensor::{Device, Tensor};
/// use dash_model::{DeformationConfig, DeformationField, HashEncoderConfig, Representation, SpaceBox};
/// use rand::SeedableRng;
///
/// let grid = HashEncoderConfig::new(4, 10, [4, 4, 4, 2], [32, 32, 32, 8]);
/// let mut config = DeformationConfig::new(grid, 16);
/// config.representation = Representation::Embedding;
/// let (device, mut rng) = (Device::flex(), rand_pcg::Pcg64::seed_from_u64(1));
/// let field = DeformationField::new(&config, SpaceBox::fixed(1.0), &mut rng, &device)?;
/// let means = Tensor::<2>::from_data([[0.1, 0.2, 0.3], [-0.5, 0.0, 0.5]], &device);
/// let own = Tensor::zeros([2, config.embedding_width()], &device);
/// let features = field.features(means, Some(own), 0.5)?;
/// assert_eq!(field.decode(features)?.means.dims(), [2, 3]);
/// # Ok::<(), dash_model::ModelError>(())
/// ```
#[derive(Module, Debug)]
pub struct TimeEmbedding {
    /// Features at the vertices of the coarse grid `[R, W]`, then of the fine one.
    pub times: Vec<Param<Tensor<2>>>,
}

impl TimeEmbedding {
    /// Features of time in each table, for each of a Gaussian's own. Source: E-D3DGS, 256 of 32.
    pub(super) const FEATURES_OF_TIME: usize = 8;

    /// Features of a Gaussian's own, and in each table.
    pub(crate) fn widths(grid: &HashEncoderConfig) -> [usize; 2] {
        [Self::embedding_width(grid), Self::width(grid)]
    }

    /// Features in each table.
    fn width(grid: &HashEncoderConfig) -> usize {
        Self::embedding_width(grid).saturating_mul(Self::FEATURES_OF_TIME)
    }

    /// Shapes of the tables at the base and the finest resolution.
    fn shapes(grid: &HashEncoderConfig) -> Result<[[usize; 2]; 2], ModelError> {
        let width = Self::width(grid);
        let resolutions = [grid.base_resolution[TIME], grid.finest_resolution[TIME]];
        let keys = ["encoder.base_resolution", "encoder.finest_resolution"];
        for (key, cells) in keys.into_iter().zip(resolutions) {
            if !(1..=MAX_RESOLUTION).contains(&cells) {
                let expected = format!("1 to {MAX_RESOLUTION} along time");
                return Err(ModelError::config(key, expected, cells.to_string()));
            }
        }
        Ok(resolutions.map(|cells| [cells as usize + 1, width]))
    }

    /// Width of the embedding of each Gaussian.
    pub(crate) fn embedding_width(grid: &HashEncoderConfig) -> usize {
        grid.n_levels.saturating_mul(grid.n_features_per_level)
    }

    pub(super) fn new(
        grid: &HashEncoderConfig,
        rng: &mut impl Rng,
        device: &Device,
    ) -> Result<Self, ModelError> {
        let times = Self::shapes(grid)?.map(|shape| {
            let values: Vec<f32> = (0..shape[0] * shape[1])
                .map(|_| rng.random_range(-INITIAL..INITIAL))
                .collect();
            parameter(values, shape, device)
        });
        Ok(Self {
            times: times.into(),
        })
    }

    pub(super) fn n_values(grid: &HashEncoderConfig) -> Result<u128, ModelError> {
        Ok(Self::shapes(grid)?
            .iter()
            .map(|shape| shape[0] as u128 * shape[1] as u128)
            .sum())
    }

    /// # Shapes
    /// `points [N, 4]`, `embeddings [N, E] -> [N, E + 2 W]`
    pub(super) fn forward(
        &self,
        points: Tensor<2>,
        embeddings: Tensor<2>,
    ) -> Result<Tensor<2>, ModelError> {
        let time = points.narrow(1, TIME, 1);
        let mut features = vec![embeddings];
        for table in &self.times {
            // Not `matmul`: tensor cores round its operands to ten bits.
            let [n, width] = table.dims();
            let no_bias = Tensor::zeros([width], &time.device());
            let table = Tensor::cat(vec![table.val().flatten(0, 1), no_bias], 0);
            let layout = MlpLayout::new(&[n, width])?;
            features.push(mlp(hats(time.clone(), n), table, &layout)?);
        }
        Ok(Tensor::cat(features, 1))
    }

    pub(super) fn n_output_features_of(grid: &HashEncoderConfig) -> usize {
        let embedding = Self::embedding_width(grid);
        embedding.saturating_add(Self::width(grid).saturating_mul(2))
    }
}

/// Linear interpolation weights `[N, n]` of times `[N, 1]` at `n` vertices spread over [0, 1].
fn hats(time: Tensor<2>, n: usize) -> Tensor<2> {
    let device = time.device();
    let vertices: Vec<f32> = (0..n).map(|k| k as f32).collect();
    let vertices = Tensor::<2>::from_data(TensorData::new(vertices, [1, n]), &device);
    let away = (time.clamp(0.0, 1.0) * (n - 1) as f32 - vertices).abs();
    relu(-away + 1.0)
}
