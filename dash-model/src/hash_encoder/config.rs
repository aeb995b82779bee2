//! Sizes of a hash encoder, and its start.

use burn::tensor::Device;
use dash_kernels::hash_encode::{HashGridConfig, HashGridLayout, Interpolation, LevelSizing};
use dash_kernels::limits::check_values;
use rand::Rng;
use serde::{Deserialize, Serialize};

use super::{HashEncoder, MAX_TABLE_VALUES};
use crate::ModelError;
use crate::parameters::parameter;

/// Half-width of the uniform distribution that tables start from (instant-ngp).
const INITIAL_FEATURE: f32 = 1e-4;

/// Sizes of a [`HashEncoder`].
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
    /// Levels without a table, in rising order; the coarsest is 0. The other levels do not change.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub pruned_levels: Vec<usize>,
}

impl HashEncoderConfig {
    /// Levels of two features from `base_resolution` to `finest_resolution`, interpolated linearly and sized as in the
    /// paper. `D` is 2 to 4.
    pub fn new<const D: usize>(
        n_levels: usize,
        log2_hashmap_size: u32,
        base_resolution: [u32; D],
        finest_resolution: [u32; D],
    ) -> Self {
        Self {
            n_levels,
            n_features_per_level: 2,
            log2_hashmap_size,
            base_resolution: base_resolution.to_vec(),
            finest_resolution: finest_resolution.to_vec(),
            smoothstep: false,
            reference_sizing: false,
            pruned_levels: Vec::new(),
        }
    }

    /// The kernel's form of this configuration, pruned levels included.
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

    /// The levels and their sizes, without pruned ones.
    ///
    /// # Errors
    /// When the configuration is out of range.
    pub fn layout(&self) -> Result<HashGridLayout, ModelError> {
        if !self.pruned_levels.is_sorted_by(|a, b| a < b) {
            return Err(ModelError::config(
                "encoder.pruned_levels",
                "levels in rising order",
                format!("{:?}", self.pruned_levels),
            ));
        }
        Ok(HashGridLayout::new(&self.grid())?.without(&self.pruned_levels)?)
    }

    /// Values in all tables, saturating.
    pub(crate) fn n_values(&self) -> Result<u128, ModelError> {
        let grid = self.layout()?;
        let n_entries: u128 = grid.levels().iter().map(|l| u128::from(l.size)).sum();
        Ok(n_entries.saturating_mul(grid.n_features_per_level() as u128))
    }

    /// An encoder whose features start uniform in +-1e-4.
    ///
    /// # Errors
    /// When the configuration is out of range, or the table too large for the device.
    pub fn init(&self, rng: &mut impl Rng, device: &Device) -> Result<HashEncoder, ModelError> {
        self.init_between(-INITIAL_FEATURE..INITIAL_FEATURE, rng, device)
    }

    /// An encoder whose features start uniform in a range.
    ///
    /// # Errors
    /// As [`HashEncoderConfig::init`].
    pub fn init_between(
        &self,
        range: std::ops::Range<f32>,
        rng: &mut impl Rng,
        device: &Device,
    ) -> Result<HashEncoder, ModelError> {
        let layout = self.layout()?;
        let table_layouts = layout.chunks(MAX_TABLE_VALUES);
        let mut init = |layout: &HashGridLayout| {
            let shape = [layout.n_entries(), layout.n_features_per_level()];
            let remedy = "lower the encoder's `log2_hashmap_size`";
            check_values("a level's hash table", shape[0] * shape[1], remedy, device)?;
            let values: Vec<f32> = (0..shape[0] * shape[1])
                .map(|_| rng.random_range(range.clone()))
                .collect();
            Ok::<_, ModelError>(parameter(values, shape, device))
        };
        // A layout has at least one level.
        let table = init(&table_layouts[0])?;
        let further_tables = table_layouts[1..].iter().map(init);
        let further_tables = further_tables.collect::<Result<_, _>>()?;
        Ok(HashEncoder {
            table,
            further_tables,
            layout,
            table_layouts,
        })
    }
}
