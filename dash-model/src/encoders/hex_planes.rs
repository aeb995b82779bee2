//! Six feature planes, one per pair of axes.

use burn::module::Module;
use burn::tensor::{Device, Tensor};
use rand::Rng;

use super::{columns, pick};
use crate::{HashEncoder, HashEncoderConfig, ModelError};

/// Pairs of axes: three of space, three of space and time.
const PAIRS: [[usize; 2]; 6] = [[0, 1], [0, 2], [1, 2], [0, 3], [1, 3], [2, 3]];
const TIME: usize = 3;
/// Planes are dense: no two vertices share an entry.
const DENSE: u32 = 31;
/// Start of the features of planes over space.
const OF_SPACE: std::ops::Range<f32> = 0.1..0.5;
/// Start of the features of planes with time: a factor of 1 makes the product independent of time.
const OF_TIME: std::ops::Range<f32> = 0.999..1.001;

/// Features over space and time as the product of six planes, at several resolutions.
///
/// # Source
/// Fridovich-Keil et al. 2023 (K-Planes); Wu et al. 2024 (4DGaussians).
///
/// # Example
/// ```
/// use burn::tensor::{Device, Tensor};
/// use dash_model::{DeformationConfig, DeformationField, HashEncoderConfig, Representation, SpaceBox};
/// use rand::SeedableRng;
///
/// let grid = HashEncoderConfig::new(4, 10, [4, 4, 4, 2], [32, 32, 32, 8]);
/// let mut config = DeformationConfig::new(grid, 16);
/// config.representation = Representation::HexPlane;
/// let (device, mut rng) = (Device::flex(), rand_pcg::Pcg64::seed_from_u64(1));
/// let field = DeformationField::new(&config, SpaceBox::fixed(1.0), &mut rng, &device)?;
/// let means = Tensor::<2>::from_data([[0.1, 0.2, 0.3], [-0.5, 0.0, 0.5]], &device);
/// let features = field.features(means, None, 0.5)?;
/// assert_eq!(field.decode(features)?.means.dims(), [2, 3]);
/// # Ok::<(), dash_model::ModelError>(())
/// ```
#[derive(Module, Debug)]
pub struct HexPlanes {
    /// The planes xy, xz, yz, xt, yt, zt.
    pub planes: Vec<HashEncoder>,
}

impl HexPlanes {
    fn plane(grid: &HashEncoderConfig, pair: [usize; 2]) -> HashEncoderConfig {
        HashEncoderConfig {
            log2_hashmap_size: DENSE,
            base_resolution: pick(&grid.base_resolution, pair),
            finest_resolution: pick(&grid.finest_resolution, pair),
            ..grid.clone()
        }
    }

    /// Planes of the resolutions of a four-dimensional `grid`.
    pub(super) fn new(
        grid: &HashEncoderConfig,
        rng: &mut impl Rng,
        device: &Device,
    ) -> Result<Self, ModelError> {
        let planes = PAIRS.map(|pair| {
            let start = if pair[1] == TIME { OF_TIME } else { OF_SPACE };
            Self::plane(grid, pair).init_between(start, rng, device)
        });
        Ok(Self {
            planes: planes.into_iter().collect::<Result<_, _>>()?,
        })
    }

    pub(super) fn n_values(grid: &HashEncoderConfig) -> Result<u128, ModelError> {
        PAIRS.iter().try_fold(0u128, |sum, &pair| {
            Ok(sum.saturating_add(Self::plane(grid, pair).n_values()?))
        })
    }

    /// # Shapes
    /// `points [N, 4] -> [N, L * F]`
    pub(super) fn forward(&self, points: Tensor<2>) -> Result<Tensor<2>, ModelError> {
        let mut product: Option<Tensor<2>> = None;
        for (plane, &pair) in self.planes.iter().zip(&PAIRS) {
            let features = plane.forward(columns(&points, pair))?;
            product = Some(match product {
                Some(others) => others * features,
                None => features,
            });
        }
        Ok(product.expect("six planes"))
    }
}
