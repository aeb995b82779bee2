//! The multiresolution hash encoding as a Burn module.

mod config;
mod unread;

use burn::module::{Module, Param};
use burn::tensor::Tensor;
use dash_kernels::hash_encode::{HashGridLayout, hash_encode};

pub use config::HashEncoderConfig;

use crate::ModelError;
use crate::gaussians::to_host;
use crate::parameters::parameter;

/// Values of a table that every GPU can bind: WebGPU guarantees 128 MiB. The limit is the same on all devices, so that a file
/// loads on any of them.
const MAX_TABLE_VALUES: usize = (128 << 20) / size_of::<f32>();

/// A trainable multiresolution hash grid over the unit cube of 2 to 4 dimensions.
///
/// # Source
/// DASH Eqs. 3 (3D) and 7-9 (4D); Müller et al. 2022.
///
/// # Example
/// ```
/// use burn::tensor::{Device, Tensor};
/// use dash_model::HashEncoderConfig;
/// use rand::SeedableRng;
///
/// // Four levels of at most 2^10 entries, from 4 to 64 cells along both axes.
/// let config = HashEncoderConfig::new(4, 10, [4, 4], [64, 64]);
/// let device = Device::flex().autodiff();
/// let encoder = config.init(&mut rand_pcg::Pcg64::seed_from_u64(1), &device)?;
/// let points = Tensor::<2>::from_data([[0.1, 0.9], [0.5, 0.5], [0.7, 0.2]], &device);
/// let features = encoder.forward(points)?;
/// assert_eq!(features.dims(), [3, 8]);
/// let gradients = features.sum().backward();
/// assert!(encoder.table.val().grad(&gradients).is_some());
/// # Ok::<(), dash_model::ModelError>(())
/// ```
#[derive(Module, Debug)]
pub struct HashEncoder {
    /// Features `[T, F]` of all levels, or of the first ones that fit into 128 MiB.
    pub table: Param<Tensor<2>>,
    /// Features of the other levels. Consecutive levels share a tensor of at most 128 MiB.
    pub further_tables: Vec<Param<Tensor<2>>>,
    #[module(skip)]
    layout: HashGridLayout,
    /// The levels in each table.
    #[module(skip)]
    table_layouts: Vec<HashGridLayout>,
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
        let mut features = Vec::with_capacity(self.table_layouts.len());
        for (table, layout) in self.tables().zip(&self.table_layouts) {
            features.push(hash_encode(positions.clone(), table.val(), layout)?);
        }
        Ok(match features.len() {
            1 => features.remove(0),
            _ => Tensor::cat(features, 1),
        })
    }

    /// The encoder without some of its levels.
    ///
    /// # Errors
    /// When there is no such level, or none would remain.
    pub fn without(&self, pruned: &[usize]) -> Result<Self, ModelError> {
        let layout = self.layout.without(pruned)?;
        let device = self.table.device();
        let width = layout.n_features_per_level();
        let mut tables_of_levels = Vec::new();
        for (table, layout) in self.tables().zip(&self.table_layouts) {
            let values = to_host(table.val());
            for level in layout.levels() {
                let rows = level.offset as usize..(level.offset + level.size) as usize;
                tables_of_levels.push(values[rows.start * width..rows.end * width].to_vec());
            }
        }
        let mut kept = (0..tables_of_levels.len()).filter(|level| !pruned.contains(level));
        let table_layouts = layout.chunks(MAX_TABLE_VALUES);
        let mut tables = table_layouts.iter().map(|layout| {
            let levels = kept.by_ref().take(layout.n_levels());
            let values: Vec<f32> = levels.flat_map(|l| tables_of_levels[l].clone()).collect();
            parameter(values, [layout.n_entries(), width], &device)
        });
        let table = tables.next().expect("a layout has at least one level");
        let further_tables = tables.collect();
        Ok(Self {
            table,
            further_tables,
            layout,
            table_layouts,
        })
    }

    /// Whether a model's parameter is a feature table, by its path: of a hash encoder or a
    /// [`TimeEmbedding`](crate::TimeEmbedding).
    pub fn is_table(parameter: &str) -> bool {
        let mut names = parameter.rsplit('.');
        let (last, before) = (names.next(), names.next());
        last == Some("table") || matches!(before, Some("further_tables" | "times"))
    }

    /// All tables, coarse to fine.
    pub fn tables(&self) -> impl Iterator<Item = &Param<Tensor<2>>> {
        std::iter::once(&self.table).chain(&self.further_tables)
    }

    /// The levels and their sizes.
    pub fn layout(&self) -> &HashGridLayout {
        &self.layout
    }

    /// Features per point, `L * F`.
    pub fn n_output_features(&self) -> usize {
        self.layout.n_levels() * self.layout.n_features_per_level()
    }
}

#[cfg(test)]
mod tests;
