//! The multiresolution hash encoding as a Burn module.

mod unread;

use burn::module::{Module, Param};
use burn::tensor::{Device, Tensor};
use dash_kernels::hash_encode::{
    HashGridConfig, HashGridLayout, Interpolation, LevelSizing, hash_encode,
};
use dash_kernels::limits::check_values;
use rand::Rng;
use serde::{Deserialize, Serialize};

use crate::ModelError;
use crate::gaussians::to_host;
use crate::parameters::parameter;

/// Half-width of the uniform distribution that tables start from (instant-ngp).
const INITIAL_FEATURE: f32 = 1e-4;

/// Values of a table that every GPU binds: WebGPU promises 128 MiB. The same everywhere, so that files
/// fit every device.
const MAX_TABLE_VALUES: usize = (128 << 20) / size_of::<f32>();

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
    /// Levels that are left out, rising, the coarsest being 0; those that remain are as they were.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub left_out_levels: Vec<usize>,
}

impl HashEncoderConfig {
    /// The kernel's form of this configuration, all levels.
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

    /// The levels and their sizes.
    ///
    /// # Errors
    /// When the configuration is out of range.
    pub fn layout(&self) -> Result<HashGridLayout, ModelError> {
        if !self.left_out_levels.is_sorted_by(|a, b| a < b) {
            return Err(ModelError::Config(format!(
                "expected rising levels in `left_out_levels`, found {:?}",
                self.left_out_levels
            )));
        }
        Ok(HashGridLayout::new(&self.grid())?.without(&self.left_out_levels)?)
    }

    /// How many values the tables hold, saturating.
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
        let parts = layout.chunks(MAX_TABLE_VALUES);
        let mut init = |part: &HashGridLayout| {
            let shape = [part.n_entries(), part.n_features_per_level()];
            let remedy = "lower the encoder's `log2_hashmap_size`";
            check_values("a level's hash table", shape[0] * shape[1], remedy, device)?;
            let values: Vec<f32> = (0..shape[0] * shape[1])
                .map(|_| rng.random_range(range.clone()))
                .collect();
            Ok::<_, ModelError>(parameter(values, shape, device))
        };
        // A layout has at least one level.
        let table = init(&parts[0])?;
        let further_tables = parts[1..].iter().map(init).collect::<Result<_, _>>()?;
        Ok(HashEncoder {
            table,
            further_tables,
            layout,
            parts,
        })
    }
}

/// A trainable multiresolution hash grid over the unit cube of 2 to 4 dimensions.
///
/// # Source
/// DASH Eqs. 3 (3D) and 7-9 (4D); Müller et al. 2022.
#[derive(Module, Debug)]
pub struct HashEncoder {
    /// Features of all levels `[T, F]`, unless they take more than 128 MiB: then those of the first levels,
    /// as far as they fit.
    pub table: Param<Tensor<2>>,
    /// Features of the other levels; consecutive ones share a tensor as far as they fit.
    pub further_tables: Vec<Param<Tensor<2>>>,
    #[module(skip)]
    layout: HashGridLayout,
    /// The levels of each table.
    #[module(skip)]
    parts: Vec<HashGridLayout>,
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
        let mut features = Vec::with_capacity(self.parts.len());
        for (table, part) in self.tables().zip(&self.parts) {
            features.push(hash_encode(positions.clone(), table.val(), part)?);
        }
        Ok(match features.len() {
            1 => features.remove(0),
            _ => Tensor::cat(features, 1),
        })
    }

    /// The encoder without some of the levels that it has.
    ///
    /// # Errors
    /// When there is no such level, or none would be left.
    pub fn without(&self, left_out: &[usize]) -> Result<Self, ModelError> {
        let layout = self.layout.without(left_out)?;
        let device = self.table.device();
        let width = layout.n_features_per_level();
        let mut tables_of_levels = Vec::new();
        for (table, part) in self.tables().zip(&self.parts) {
            let values = to_host(table.val());
            for level in part.levels() {
                let rows = level.offset as usize..(level.offset + level.size) as usize;
                tables_of_levels.push(values[rows.start * width..rows.end * width].to_vec());
            }
        }
        let mut kept = (0..tables_of_levels.len()).filter(|level| !left_out.contains(level));
        let parts = layout.chunks(MAX_TABLE_VALUES);
        let mut tables = parts.iter().map(|part| {
            let levels = kept.by_ref().take(part.n_levels());
            let values: Vec<f32> = levels.flat_map(|l| tables_of_levels[l].clone()).collect();
            parameter(values, [part.n_entries(), width], &device)
        });
        // A layout has at least one level.
        let table = tables.next().expect("a layout has at least one part");
        let further_tables = tables.collect();
        Ok(Self {
            table,
            further_tables,
            layout,
            parts,
        })
    }

    /// Whether a parameter of this name, among those of a whole model, is a table of features: this
    /// encoder's, or a [`TimeEmbedding`](crate::TimeEmbedding)'s.
    pub fn is_table(parameter: &str) -> bool {
        let mut names = parameter.rsplit('.');
        let (last, before) = (names.next(), names.next());
        last == Some("table") || matches!(before, Some("further_tables" | "times"))
    }

    /// All tables, coarse to fine.
    pub fn tables(&self) -> impl Iterator<Item = &Param<Tensor<2>>> {
        std::iter::once(&self.table).chain(&self.further_tables)
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

#[cfg(test)]
mod tests {
    use burn::tensor::TensorData;
    use dash_kernels::hash_encode::reference;
    use dash_kernels::testing::named_devices;
    use rand::SeedableRng;
    use rand_pcg::Pcg64;

    use super::*;
    use crate::parameters::named_parameters;

    /// All but ndarray, whose tensors have no limit of their own and which is slow with these sizes.
    fn devices() -> impl Iterator<Item = Device> {
        let devices = named_devices().into_iter();
        devices.filter_map(|(name, device)| (name != "ndarray").then_some(device))
    }

    /// 160 MiB of hashed levels, more than many devices bind at once.
    fn large() -> HashEncoderConfig {
        HashEncoderConfig {
            n_levels: 20,
            n_features_per_level: 2,
            log2_hashmap_size: 20,
            base_resolution: vec![1025, 1025],
            finest_resolution: vec![4096, 3000],
            smoothstep: false,
            reference_sizing: false,
            left_out_levels: Vec::new(),
        }
    }

    #[test]
    fn a_table_over_the_binding_limit_is_split_by_level() {
        const N: usize = 50;
        let mut rng = Pcg64::seed_from_u64(1);
        let positions: Vec<f32> = (0..2 * N).map(|_| rng.random_range(0.0..1.0)).collect();
        for device in devices() {
            let device = device.autodiff();
            let encoder = large()
                .init(&mut Pcg64::seed_from_u64(2), &device)
                .expect("a good configuration");
            let sizes: Vec<usize> = encoder.tables().map(|t| t.dims()[0]).collect();
            assert_eq!(sizes, [16 << 20, 4 << 20]);
            for name in named_parameters(&encoder).keys() {
                assert!(HashEncoder::is_table(name), "{name}");
            }

            let tensor =
                Tensor::<2>::from_data(TensorData::new(positions.clone(), [N, 2]), &device);
            let features = encoder.forward(tensor).expect("fits");
            let grads = features.clone().sum().backward();
            let table: Vec<f64> = encoder
                .tables()
                .flat_map(|t| to_host(t.val()))
                .map(f64::from)
                .collect();
            let wide: Vec<f64> = positions.iter().map(|&x| f64::from(x)).collect();
            let expected = reference::hash_encode(&wide, &table, encoder.layout());
            for (i, (got, expected)) in to_host(features).iter().zip(&expected).enumerate() {
                // Weights of a fine level are rounded to a few 1e-7 of the largest feature.
                let error = (f64::from(*got) - expected).abs();
                assert!(
                    error <= 1e-6 * 1e-4,
                    "feature {i}: {got}, expected {expected}"
                );
            }
            // Each point's weights on a level add up to 1, whichever table holds the level.
            for (table, levels) in encoder.tables().zip([16, 4]) {
                let gradient = to_host(table.val().grad(&grads).expect("a table is trained"));
                let sum: f64 = gradient.iter().map(|&v| f64::from(v)).sum();
                let expected = (N * 2 * levels) as f64;
                assert!((sum - expected).abs() < 1e-3, "{sum}, expected {expected}");
            }
        }
    }

    #[test]
    fn without_a_level_the_features_of_the_others_are_the_same() {
        let config = HashEncoderConfig {
            n_levels: 4,
            log2_hashmap_size: 6,
            base_resolution: vec![4, 3],
            finest_resolution: vec![20, 30],
            ..large()
        };
        let device = Device::flex();
        let init = |config: &HashEncoderConfig| config.init(&mut Pcg64::seed_from_u64(4), &device);
        let all = init(&config).expect("a good configuration");
        let points = Tensor::<2>::from_data([[0.1, 0.9], [0.33, 0.5], [1.0, 0.0]], &device);
        let features = |encoder: &HashEncoder| {
            let features = encoder.forward(points.clone()).expect("fits");
            to_host(features)
        };
        let fewer = all.without(&[0, 2]).expect("two levels stay");
        let expected: Vec<f32> = features(&all)
            .chunks_exact(8)
            .flat_map(|row| [row[2], row[3], row[6], row[7]])
            .collect();
        assert_eq!(features(&fewer), expected);
        // As it is when it is read from a file.
        let left_out_levels = vec![0, 2];
        let read = HashEncoderConfig {
            left_out_levels,
            ..config.clone()
        };
        let read = init(&read).expect("a good configuration");
        assert_eq!(read.layout(), fewer.layout());
        for left_out_levels in [vec![4], vec![0, 1, 2, 3], vec![2, 0], vec![1, 1]] {
            let config = HashEncoderConfig {
                left_out_levels,
                ..config.clone()
            };
            assert!(init(&config).is_err(), "{config:?}");
        }
    }

    #[test]
    fn tables_are_told_from_other_parameters() {
        for name in ["table", "field.encoder.table", "encoder.further_tables.12"] {
            assert!(HashEncoder::is_table(name), "{name}");
        }
        for name in [
            "field.trunk.layers.0.weight",
            "static.means",
            "encoder.further_tables",
            "stable",
        ] {
            assert!(!HashEncoder::is_table(name), "{name}");
        }
    }
}
