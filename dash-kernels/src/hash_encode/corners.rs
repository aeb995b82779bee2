//! Rows and weights of the `2^D` corners around blocks of points, one lane per point.

#![expect(
    clippy::needless_range_loop,
    reason = "lane loops index several lane arrays side by side"
)]

use super::layout::{HASH_PRIMES, HashGridLevel, Interpolation};

/// Points handled together: one AVX-512 register of `f32`.
pub(super) const LANES: usize = 16;

/// One value per point of a block.
pub(super) type Lanes<T> = [T; LANES];

/// Positions of `LANES` points, coordinate by coordinate.
///
/// Points outside the unit box, NaN, and the lanes after the last point stand at the origin with
/// `inside` false.
#[derive(Clone, Copy)]
pub(super) struct PointBlock<const D: usize> {
    pub coordinates: [Lanes<f32>; D],
    pub inside: Lanes<bool>,
}

impl<const D: usize> PointBlock<D> {
    /// The block of up to `LANES` points in `positions [n, D]`.
    pub fn new(positions: &[f32]) -> Self {
        let mut block = Self {
            coordinates: [[0.0; LANES]; D],
            inside: [false; LANES],
        };
        for (lane, position) in positions.chunks_exact(D).enumerate() {
            if position.iter().all(|x| (0.0..=1.0).contains(x)) {
                block.inside[lane] = true;
                for (axis, &x) in position.iter().enumerate() {
                    block.coordinates[axis][lane] = x;
                }
            }
        }
        block
    }
}

/// A level's constants in the kernels' types.
#[derive(Clone, Copy)]
pub(super) struct LevelConstants<const D: usize> {
    scale: [f64; D],
    last_cell: [f64; D],
    /// Stride of a dense level, prime of a hashed one.
    multiplier: [u32; D],
    /// All ones for a dense level: its rows need no wrapping.
    row_mask: u32,
    dense: bool,
    smooth: bool,
}

impl<const D: usize> LevelConstants<D> {
    pub fn new(level: &HashGridLevel, interpolation: Interpolation) -> Self {
        let mut multiplier = [0; D];
        let mut stride = 1u64;
        for (axis, multiplier) in multiplier.iter_mut().enumerate() {
            // A dense level has fewer than 2^32 rows, so its strides fit.
            *multiplier = if level.dense {
                stride as u32
            } else {
                HASH_PRIMES[axis]
            };
            stride = stride.wrapping_mul(level.resolution[axis]);
        }
        Self {
            scale: std::array::from_fn(|axis| level.scale[axis]),
            last_cell: std::array::from_fn(|axis| (level.resolution[axis] - 2) as f64),
            multiplier,
            row_mask: if level.dense {
                u32::MAX
            } else {
                (level.size - 1) as u32
            },
            dense: level.dense,
            smooth: interpolation == Interpolation::Smoothstep,
        }
    }
}

/// The cells that hold the points of a block.
pub(super) struct Cells<const D: usize> {
    /// Row contribution of the lower vertex, per axis.
    lower_row: [Lanes<u32>; D],
    /// Row contribution of the upper vertex, per axis.
    upper_row: [Lanes<u32>; D],
    /// Weight of the upper vertex, per axis.
    pub upper_weight: [Lanes<f32>; D],
    /// Derivative of the upper vertex' weight by the position, per axis.
    pub slope: [Lanes<f32>; D],
}

impl<const D: usize> Cells<D> {
    /// Finds the cells; positions are scaled in f64 so that a fine level keeps its fraction.
    #[inline(always)]
    pub fn locate(block: &PointBlock<D>, level: &LevelConstants<D>) -> Self {
        let mut cells = Self {
            lower_row: [[0; LANES]; D],
            upper_row: [[0; LANES]; D],
            upper_weight: [[0.0; LANES]; D],
            slope: [[0.0; LANES]; D],
        };
        for axis in 0..D {
            let (scale, last) = (level.scale[axis], level.last_cell[axis]);
            let multiplier = level.multiplier[axis];
            for lane in 0..LANES {
                let in_cells = f64::from(block.coordinates[axis][lane]) * scale;
                let floor = in_cells.floor();
                let cell = if floor < last { floor } else { last };
                let w = (in_cells - cell) as f32;
                // SAFETY: `cell` lies in [0, 2^24]: coordinates lie in [0, 1], scales in [0, 2^24].
                let row = unsafe { cell.to_int_unchecked::<i32>() } as u32;
                let row = row.wrapping_mul(multiplier);
                cells.lower_row[axis][lane] = row;
                cells.upper_row[axis][lane] = row.wrapping_add(multiplier);
                let (weight, slope) = if level.smooth {
                    (w * w * (3.0 - 2.0 * w), 6.0 * w * (1.0 - w))
                } else {
                    (w, 1.0)
                };
                cells.upper_weight[axis][lane] = weight;
                cells.slope[axis][lane] = slope * scale as f32;
            }
        }
        cells
    }

    /// Rows of the corners within the level; bit `d` of a corner's number is its side on axis `d`.
    #[inline(always)]
    pub fn rows<const CORNERS: usize>(
        &self,
        level: &LevelConstants<D>,
        rows: &mut [Lanes<u32>; CORNERS],
    ) {
        // Doubles the number of corners axis by axis: the lower half is overwritten last.
        rows[0] = [0; LANES];
        for axis in 0..D {
            let half = 1 << axis;
            for corner in 0..half {
                for lane in 0..LANES {
                    let row = rows[corner][lane];
                    let (lower, upper) = (self.lower_row[axis][lane], self.upper_row[axis][lane]);
                    (rows[corner][lane], rows[corner + half][lane]) = if level.dense {
                        (row.wrapping_add(lower), row.wrapping_add(upper))
                    } else {
                        (row ^ lower, row ^ upper)
                    };
                }
            }
        }
        for row in rows.as_flattened_mut() {
            *row &= level.row_mask;
        }
    }

    /// Weights of the corners, numbered as in [`rows`](Self::rows).
    #[inline(always)]
    pub fn weights<const CORNERS: usize>(&self, weights: &mut [Lanes<f32>; CORNERS]) {
        weights[0] = [1.0; LANES];
        for axis in 0..D {
            let half = 1 << axis;
            for corner in 0..half {
                for lane in 0..LANES {
                    let weight = weights[corner][lane];
                    let upper = self.upper_weight[axis][lane];
                    weights[corner][lane] = weight * (1.0 - upper);
                    weights[corner + half][lane] = weight * upper;
                }
            }
        }
    }
}
