//! Level sizes of a multiresolution hash grid: integers computed once, on the host.
//!
//! No kernel computes them again: `exp2`, `powf` and `powi` disagree in the last bit, and a level whose size differed
//! between two kernels would read rows of another level.

use std::sync::Arc;

use crate::KernelError;

/// The largest number of input dimensions.
pub const MAX_DIMS: usize = 4;

/// Primes of the spatial hash, one per axis.
///
/// # Source
/// DASH Eq. 8.
pub const HASH_PRIMES: [u32; MAX_DIMS] = [1, 2_654_435_761, 805_459_861, 3_674_653_429];

/// Features per level that have a kernel.
pub const SUPPORTED_FEATURES: [usize; 4] = [1, 2, 4, 8];

/// Far above any use; keeps a damaged configuration from asking for a list of all memory.
const MAX_LEVELS: usize = 64;
const MAX_LOG2_HASHMAP_SIZE: u32 = 31;
const MAX_RESOLUTION: u32 = 1 << 24;
/// `N_min b^l` is rounded to the nearest integer when it is this close, relatively: `exp` and `ln` err by a few 1e-16 of
/// their argument, real resolutions are further apart.
const INTEGER_TOLERANCE: f64 = 1e-9;

/// How corner weights depend on the position `w` within a cell.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum Interpolation {
    /// `w`: D-linear.
    #[default]
    Linear,
    /// `3 w^2 - 2 w^3`: zero slope at the vertices.
    Smoothstep,
}

/// How a level's resolution becomes a scale and a number of vertices.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum LevelSizing {
    /// DASH Eq. 7: `N_l = floor(N_min b^l)` cells, `N_l + 1` vertices.
    #[default]
    Paper,
    /// As the released code: scale `N_min b^l - 1` (real), `ceil(scale) + 1` vertices.
    ///
    /// An axis has at least two vertices here, so that a cell always has both its ends.
    Reference,
}

/// Settings of a hash grid.
#[derive(Debug, Clone, PartialEq)]
pub struct HashGridConfig {
    /// Number of levels `L`.
    pub n_levels: usize,
    /// Features per level `F`: 1, 2, 4 or 8.
    pub n_features_per_level: usize,
    /// A level holds at most `2^log2_hashmap_size` entries; at most 31.
    pub log2_hashmap_size: u32,
    /// Resolution of the coarsest level, per axis; its length is `D`, 2 to 4.
    pub base_resolution: Vec<u32>,
    /// Resolution of the finest level, per axis; not below the base.
    pub finest_resolution: Vec<u32>,
    /// Corner weights.
    pub interpolation: Interpolation,
    /// Level sizes.
    pub sizing: LevelSizing,
}

/// One level of a grid. Axes from `D` on hold scale 0 and resolution 1.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HashGridLevel {
    /// A position in [0, 1] times this is a position in cells.
    pub scale: [f64; MAX_DIMS],
    /// Vertices per axis.
    pub resolution: [u64; MAX_DIMS],
    /// First row of the level in the table.
    pub offset: u64,
    /// Rows of the level in the table.
    pub size: u64,
    /// Whether every vertex has a row of its own (first axis fastest); hashed otherwise.
    pub dense: bool,
}

impl HashGridLevel {
    /// Row, counted from the level's first, of the vertex with the given coordinates.
    ///
    /// # Source
    /// DASH Eq. 8 for hashed levels.
    pub fn row(&self, vertex: &[u64]) -> u64 {
        if self.dense {
            let mut stride = 1;
            let mut row = 0;
            for (x, resolution) in vertex.iter().zip(self.resolution) {
                row += x * stride;
                stride *= resolution;
            }
            row
        } else {
            let hash = vertex
                .iter()
                .zip(HASH_PRIMES)
                .fold(0, |hash, (&x, prime)| hash ^ (x as u32).wrapping_mul(prime));
            u64::from(hash) % self.size
        }
    }
}

/// A validated [`HashGridConfig`] with its level sizes; cheap to clone.
#[derive(Debug, Clone, PartialEq)]
pub struct HashGridLayout {
    levels: Arc<[HashGridLevel]>,
    dims: usize,
    features: usize,
    interpolation: Interpolation,
}

impl HashGridLayout {
    /// The layout of `config`.
    ///
    /// # Errors
    /// [`KernelError::Config`] when a value is out of range or the table would hold more than
    /// `u32::MAX` rows.
    pub fn new(config: &HashGridConfig) -> Result<Self, KernelError> {
        validate(config).map_err(|what| KernelError::Config {
            op: "hash_encode",
            what,
        })?;
        let mut levels = Vec::with_capacity(config.n_levels);
        let mut offset = 0;
        for level in 0..config.n_levels {
            let level = size_level(config, level, offset);
            offset += level.size;
            levels.push(level);
        }
        if offset > u64::from(u32::MAX) {
            return Err(KernelError::Config {
                op: "hash_encode",
                what: format!(
                    "the table would hold {offset} entries, more than {}; lower \
                     `log2_hashmap_size` or `n_levels`",
                    u32::MAX
                ),
            });
        }
        Ok(Self {
            levels: levels.into(),
            dims: config.base_resolution.len(),
            features: config.n_features_per_level,
            interpolation: config.interpolation,
        })
    }

    /// Chunks of consecutive levels whose tables hold at most `max_values` each, for devices that can't bind the whole
    /// table. A larger level is a chunk of its own. Features and rows of the chunks, joined, are those of the grid.
    pub fn chunks(&self, max_values: usize) -> Vec<Self> {
        let mut chunks: Vec<Vec<HashGridLevel>> = Vec::new();
        let mut rows = 0;
        for level in self.levels.iter() {
            let fits = (rows + level.size) as u128 * self.features as u128 <= max_values as u128;
            match chunks.last_mut() {
                Some(chunk) if fits => chunk.push(HashGridLevel {
                    offset: rows,
                    ..*level
                }),
                _ => {
                    rows = 0;
                    chunks.push(vec![HashGridLevel {
                        offset: 0,
                        ..*level
                    }]);
                }
            }
            rows += level.size;
        }
        chunks
            .into_iter()
            .map(|levels| Self {
                levels: levels.into(),
                ..self.clone()
            })
            .collect()
    }

    /// The grid without some of its levels; the other levels keep their order.
    ///
    /// # Errors
    /// [`KernelError::Config`] when there is no such level, or none would be left.
    pub fn without(&self, left_out: &[usize]) -> Result<Self, KernelError> {
        let n_levels = self.levels.len();
        let refuse = |what: String| KernelError::Config {
            op: "hash_encode",
            what,
        };
        if let Some(level) = left_out.iter().find(|&&level| level >= n_levels) {
            return Err(refuse(format!(
                "level {level} is left out of a grid of {n_levels} levels"
            )));
        }
        let mut rows = 0;
        let levels: Arc<[HashGridLevel]> = (0..n_levels)
            .filter(|level| !left_out.contains(level))
            .map(|level| {
                let level = self.levels[level];
                let offset = rows;
                rows += level.size;
                HashGridLevel { offset, ..level }
            })
            .collect();
        if levels.is_empty() {
            return Err(refuse(format!("all {n_levels} levels are left out")));
        }
        Ok(Self {
            levels,
            ..self.clone()
        })
    }

    /// The levels, coarse to fine.
    pub fn levels(&self) -> &[HashGridLevel] {
        &self.levels
    }

    /// Input dimensions `D`.
    pub fn dims(&self) -> usize {
        self.dims
    }

    /// Levels `L`.
    pub fn n_levels(&self) -> usize {
        self.levels.len()
    }

    /// Features per level `F`.
    pub fn n_features_per_level(&self) -> usize {
        self.features
    }

    /// Features of an encoded point, `L * F`.
    pub fn n_features(&self) -> usize {
        self.levels.len() * self.features
    }

    /// Rows `T` of the table, all levels together.
    pub fn n_entries(&self) -> usize {
        self.levels
            .last()
            .map_or(0, |level| (level.offset + level.size) as usize)
    }

    /// Corner weights.
    pub fn interpolation(&self) -> Interpolation {
        self.interpolation
    }
}

fn validate(config: &HashGridConfig) -> Result<(), String> {
    let (base, finest) = (&config.base_resolution, &config.finest_resolution);
    if !(2..=MAX_DIMS).contains(&base.len()) {
        return Err(format!(
            "`base_resolution` has {} axes, expected 2 to {MAX_DIMS}",
            base.len()
        ));
    }
    if finest.len() != base.len() {
        return Err(format!(
            "`finest_resolution` has {} axes, `base_resolution` {}; give both one value per axis",
            finest.len(),
            base.len()
        ));
    }
    for (axis, (&low, &high)) in base.iter().zip(finest).enumerate() {
        if low == 0 || high < low || high > MAX_RESOLUTION {
            return Err(format!(
                "axis {axis} goes from resolution {low} to {high}, expected \
                 1 <= base <= finest <= {MAX_RESOLUTION}"
            ));
        }
    }
    if !(1..=MAX_LEVELS).contains(&config.n_levels) {
        return Err(format!(
            "`n_levels` is {}, expected 1 to {MAX_LEVELS}",
            config.n_levels
        ));
    }
    if !SUPPORTED_FEATURES.contains(&config.n_features_per_level) {
        return Err(format!(
            "`n_features_per_level` is {}, expected one of {SUPPORTED_FEATURES:?}",
            config.n_features_per_level
        ));
    }
    if config.log2_hashmap_size > MAX_LOG2_HASHMAP_SIZE {
        return Err(format!(
            "`log2_hashmap_size` is {}, expected at most {MAX_LOG2_HASHMAP_SIZE}",
            config.log2_hashmap_size
        ));
    }
    Ok(())
}

fn size_level(config: &HashGridConfig, level: usize, offset: u64) -> HashGridLevel {
    let mut scale = [0.0; MAX_DIMS];
    let mut resolution = [1; MAX_DIMS];
    let axes = config.base_resolution.iter().zip(&config.finest_resolution);
    for (axis, (&base, &finest)) in axes.enumerate() {
        let cells = level_resolution(base, finest, level, config.n_levels);
        (scale[axis], resolution[axis]) = match config.sizing {
            LevelSizing::Paper => (cells.floor(), cells.floor() as u64 + 1),
            LevelSizing::Reference => {
                let scale = cells - 1.0;
                (scale, (scale.ceil() as u64 + 1).max(2))
            }
        };
    }
    // Four axes of at most 2^24 + 1 vertices stay below 2^128.
    let vertices: u128 = resolution.iter().map(|&r| u128::from(r)).product();
    let capacity = 1u64 << config.log2_hashmap_size;
    let dense = vertices <= u128::from(capacity);
    HashGridLevel {
        scale,
        resolution,
        offset,
        size: if dense { vertices as u64 } else { capacity },
        dense,
    }
}

/// `N_min b^l` of DASH Eq. 7 (with the exponent that is missing in print); a single level has the
/// base resolution.
fn level_resolution(base: u32, finest: u32, level: usize, n_levels: usize) -> f64 {
    if level == 0 {
        return f64::from(base);
    }
    if level + 1 == n_levels {
        return f64::from(finest);
    }
    let fraction = level as f64 / (n_levels - 1) as f64;
    let value = f64::from(base) * (fraction * (f64::from(finest) / f64::from(base)).ln()).exp();
    let nearest = value.round();
    if (value - nearest).abs() <= INTEGER_TOLERANCE * nearest {
        nearest
    } else {
        value
    }
}
