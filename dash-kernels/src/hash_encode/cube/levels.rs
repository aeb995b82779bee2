//! Cells, rows and weights, one point on one level at a time.

use cubecl::prelude::*;

use crate::cube::{Buffer, is_finite};

use super::super::HashGridLayout;
use super::super::layout::{HASH_PRIMES, HashGridLevel, MAX_DIMS};

/// Words that describe a level to the kernels.
const N_WORDS: usize = 3 + 5 * MAX_DIMS;
const OFFSET: usize = 0;
const ROW_MASK: usize = 1;
const DENSE: usize = 2;
/// Per axis: stride of a dense level, prime of a hashed one.
const MULTIPLIER: usize = 3;
/// Per axis: the last cell.
const LAST_CELL: usize = MULTIPLIER + MAX_DIMS;
/// Per axis: the scale in three parts of which the first two have at most 12 significant bits.
const SCALE_HIGH: usize = LAST_CELL + MAX_DIMS;
const SCALE_MIDDLE: usize = SCALE_HIGH + MAX_DIMS;
const SCALE_LOW: usize = SCALE_MIDDLE + MAX_DIMS;

/// Keeps the first 12 significant bits of an `f32`: the product of two such is exact.
const HIGH_BITS: u32 = 0xffff_f000;

/// The levels as the kernels read them.
pub(super) fn level_words(client: &Client, layout: &HashGridLayout) -> Buffer {
    let words: Vec<u32> = layout.levels().iter().flat_map(words_of_level).collect();
    Buffer::from_words(client, &words)
}

fn words_of_level(level: &HashGridLevel) -> [u32; N_WORDS] {
    let mut words = [0; N_WORDS];
    // The layout holds fewer than 2^32 rows, so offsets, masks and dense strides fit.
    words[OFFSET] = level.offset as u32;
    words[ROW_MASK] = if level.dense {
        u32::MAX
    } else {
        (level.size - 1) as u32
    };
    words[DENSE] = u32::from(level.dense);
    let mut stride = 1u64;
    for axis in 0..MAX_DIMS {
        words[MULTIPLIER + axis] = if level.dense {
            stride as u32
        } else {
            HASH_PRIMES[axis]
        };
        stride = stride.wrapping_mul(level.resolution[axis]);
        words[LAST_CELL + axis] = level.resolution[axis].saturating_sub(2) as u32;
        let scale = level.scale[axis];
        let high = high_part(scale as f32);
        let middle = high_part((scale - f64::from(high)) as f32);
        let low = (scale - f64::from(high) - f64::from(middle)) as f32;
        words[SCALE_HIGH + axis] = high.to_bits();
        words[SCALE_MIDDLE + axis] = middle.to_bits();
        words[SCALE_LOW + axis] = low.to_bits();
    }
    words
}

fn high_part(value: f32) -> f32 {
    f32::from_bits(value.to_bits() & HIGH_BITS)
}

/// The cell of a level that holds a point.
#[derive(CubeType)]
pub(super) struct Cell {
    pub offset: u32,
    row_mask: u32,
    dense: bool,
    /// Row contribution of the lower vertex, per axis.
    lower: Array<u32>, // [D]
    /// What the upper vertex adds to it, per axis.
    multiplier: Array<u32>, // [D]
    /// Weight of the upper vertex, per axis.
    upper_weight: Array<f32>, // [D]
    /// Its derivative by the position, per axis.
    slope: Array<f32>, // [D]
}

/// Whether all coordinates lie in [0, 1]. NaN does not, by its bits: a device may take it that there is none.
#[cube]
pub(super) fn is_inside(
    positions: &[f32], // [N, D]
    point: usize,
    #[comptime] dims: usize,
) -> bool {
    let mut inside = true;
    #[unroll]
    for axis in 0..dims {
        let x = positions[point * dims + axis];
        inside = inside && is_finite(x) && f32::clamp(x, 0.0f32, 1.0f32) == x;
    }
    inside
}

/// Cell of a coordinate and the place in it. The product with the scale is formed from parts that
/// multiply exactly, so that a fine level keeps its fraction.
#[cube]
fn cell_of(x: f32, high: f32, middle: f32, low: f32, last: u32) -> (u32, f32) {
    let x_high = f32::reinterpret(u32::reinterpret(x) & HIGH_BITS);
    let x_low = x - x_high;
    let product = x_high * high;
    let rest = x_low * high + x_high * middle + (x_low * middle + x * low);
    let mut cell = (product + rest).floor();
    let mut place = (product - cell) + rest;
    // Rounding of the sum may have passed a border.
    if place < 0.0f32 {
        cell -= 1.0f32;
        place += 1.0f32;
    }
    if place >= 1.0f32 {
        cell += 1.0f32;
        place -= 1.0f32;
    }
    // The far border belongs to the last cell.
    let last_cell = f32::cast_from(last);
    if cell > last_cell {
        place += cell - last_cell;
        cell = last_cell;
    }
    if cell < 0.0f32 {
        place += cell;
        cell = 0.0f32;
    }
    (u32::cast_from(cell), place)
}

#[cube]
pub(super) fn locate(
    positions: &[f32], // [N, D]
    point: usize,
    levels: &[u32], // [L, N_WORDS]
    level: usize,
    #[comptime] dims: usize,
    #[comptime] smooth: bool,
) -> Cell {
    let words = level * N_WORDS;
    let mut lower = Array::<u32>::new(dims);
    let mut multiplier = Array::<u32>::new(dims);
    let mut upper_weight = Array::<f32>::new(dims);
    let mut slope = Array::<f32>::new(dims);
    #[unroll]
    for axis in 0..dims {
        let high = f32::reinterpret(levels[words + comptime!(SCALE_HIGH + axis)]);
        let middle = f32::reinterpret(levels[words + comptime!(SCALE_MIDDLE + axis)]);
        let low = f32::reinterpret(levels[words + comptime!(SCALE_LOW + axis)]);
        let last = levels[words + comptime!(LAST_CELL + axis)];
        let (cell, w) = cell_of(positions[point * dims + axis], high, middle, low, last);
        multiplier[axis] = levels[words + comptime!(MULTIPLIER + axis)];
        lower[axis] = cell * multiplier[axis];
        let scale = high + (middle + low);
        if comptime!(smooth) {
            upper_weight[axis] = w * w * (3.0f32 - 2.0f32 * w);
            slope[axis] = 6.0f32 * w * (1.0f32 - w) * scale;
        } else {
            upper_weight[axis] = w;
            slope[axis] = scale;
        }
    }
    Cell {
        offset: levels[words + OFFSET],
        row_mask: levels[words + ROW_MASK],
        dense: levels[words + DENSE] != 0u32,
        lower,
        multiplier,
        upper_weight,
        slope,
    }
}

/// Row of a corner in the whole table; bit `d` of its number is its side on axis `d`.
#[cube]
pub(super) fn corner_row(cell: &Cell, #[comptime] corner: usize, #[comptime] dims: usize) -> usize {
    let mut sum = 0u32;
    let mut hash = 0u32;
    #[unroll]
    for axis in 0..dims {
        let mut part = cell.lower[axis];
        if comptime!((corner >> axis) & 1 == 1) {
            part += cell.multiplier[axis];
        }
        sum += part;
        hash ^= part;
    }
    let row = select(cell.dense, sum, hash);
    (cell.offset + (row & cell.row_mask)) as usize
}

#[cube]
pub(super) fn corner_weight(
    cell: &Cell,
    #[comptime] corner: usize,
    #[comptime] dims: usize,
) -> f32 {
    let mut weight = 1.0f32;
    #[unroll]
    for axis in 0..dims {
        if comptime!((corner >> axis) & 1 == 1) {
            weight *= cell.upper_weight[axis];
        } else {
            weight *= 1.0f32 - cell.upper_weight[axis];
        }
    }
    weight
}

/// Derivative of the corner's weight by a coordinate of the position.
#[cube]
pub(super) fn corner_slope(
    cell: &Cell,
    #[comptime] corner: usize,
    #[comptime] axis: usize,
    #[comptime] dims: usize,
) -> f32 {
    let mut slope = cell.slope[axis];
    if comptime!((corner >> axis) & 1 == 0) {
        slope = -slope;
    }
    #[unroll]
    for other in 0..dims {
        if comptime!(other != axis) {
            if comptime!((corner >> other) & 1 == 1) {
                slope *= cell.upper_weight[other];
            } else {
                slope *= 1.0f32 - cell.upper_weight[other];
            }
        }
    }
    slope
}
