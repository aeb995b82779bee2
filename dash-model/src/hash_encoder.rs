//! The multiresolution hash encoding as a Burn module.

use burn::module::{Module, Param};
use burn::tensor::{Device, Tensor, TensorData};
use dash_kernels::hash_encode::{
    HashGridConfig, HashGridLayout, Interpolation, LevelSizing, hash_encode,
};
use dash_kernels::limits::check_values;
use rand::Rng;
use serde::{Deserialize, Serialize};

use crate::ModelError;

/// Half-width of the uniform distribution that tables start from (instant-ngp).
const INITIAL_FEATURE: f32 = 1e-4;

/// Sizes and forms of a [`HashEncoder`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct HashEncoderConfig {
    /// Resolution levels `L`.
    pub n_levels: usize,
    /// Features per level `F`.
    pub n_features_per_level: usize,
    /// Base-2 logarithm of the largest number of entries of a level.
    pub log2_hashmap_size: u32,
    /// Resolution of the first level, per axis; its length is `D`.
    pub base_resolution: Vec<u32>,
    /// Resolution of the last level, per axis.
    pub finest_resolution: Vec<u32>,
    /// Smoothstep weights (released code) instead of linear ones (paper).
    pub smoothstep: bool,
    /// Level sizes of the released code instead of the paper's Eq. 7.
    pub reference_sizing: bool,
}

impl HashEncoderConfig {
    /// The kernel's form of this configuration.
    pub fn grid(&self) -> HashGridConfig {
        HashGridConfig {
            n_levels: self.n_levels,
            n_features_per_level: self.n_features_per_level,
            log2_hashmap_size: self.log2_hashmap_size,
            base_resolution: self.base_resolution.clone(),
            finest_resolution: self.finest_resolution.clone(),
            interpolation: if self.smoothstep {
                Interpolation::Smoothstep
            } else {
                Interpolation::Linear
            },
            sizing: if self.reference_sizing {
                LevelSizing::Reference
            } else {
                LevelSizing::Paper
            },
        }
    }

    /// An encoder whose features start uniform in +-1e-4.
    ///
    /// # Errors
    /// When the configuration is out of range, or the table too large for the device.
    pub fn init(&self, rng: &mut impl Rng, device: &Device) -> Result<HashEncoder, ModelError> {
        let layout = HashGridLayout::new(&self.grid())?;
        let shape = [layout.n_entries(), layout.n_features_per_level()];
        let remedy = "lower the encoder's `log2_hashmap_size` or `n_levels`";
        check_values("the hash table", shape[0] * shape[1], remedy, device)?;
        let values: Vec<f32> = (0..shape[0] * shape[1])
            .map(|_| rng.random_range(-INITIAL_FEATURE..INITIAL_FEATURE))
            .collect();
        let table = Param::from_data(TensorData::new(values, shape), device);
        Ok(HashEncoder { table, layout })
    }
}

/// A trainable multiresolution hash grid over the unit cube of 2 to 4 dimensions.
///
/// # Source
/// DASH Eqs. 3 (3D) and 7-9 (4D); Müller et al. 2022.
#[derive(Module, Debug)]
pub struct HashEncoder {
    /// Features of all levels `[T, F]`.
    pub table: Param<Tensor<2>>,
    #[module(skip)]
    layout: HashGridLayout,
}

impl HashEncoder {
    /// Encodes points of the unit cube.
    ///
    /// # Shapes
    /// `positions [N, D]` in [0, 1] -> `[N, L * F]`; zero outside the cube.
    ///
    /// # Errors
    /// When `D` differs from the configuration.
    pub fn forward(&self, positions: Tensor<2>) -> Result<Tensor<2>, ModelError> {
        Ok(hash_encode(positions, self.table.val(), &self.layout)?)
    }

    /// The integers of the grid.
    pub fn layout(&self) -> &HashGridLayout {
        &self.layout
    }

    /// `L * F`.
    pub fn n_output_features(&self) -> usize {
        self.layout.n_levels() * self.layout.n_features_per_level()
    }
}
