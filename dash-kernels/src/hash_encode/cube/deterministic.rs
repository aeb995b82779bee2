//! The gradient to the table in a fixed order: level by level, the corners of all points are
//! sorted by their row, and each row adds up its own.
//!
//! A unit owns one corner of a point's cell (`list_corners`), then one place in the sorted list
//! (`sum_rows`): where a row's corners start, it adds them up. No shared memory, no atomics.

use burn_cubecl::tensor::CubeTensor;
use cubecl::prelude::*;

use crate::cube::radix_sort::{DeviceCount, sort_pairs};
use crate::cube::{Buffer, arg, units, zeros};

use super::super::HashGridLayout;
use super::levels::{corner_row, corner_weight, is_inside, locate};
use super::{Grid, bounded, grid};

/// Corners added up in a round of the loop over a row's: Mesa's software driver ends loops after
/// 65,535 rounds.
const PER_ROUND: usize = 16;

/// The gradient `[T, F]`.
pub(super) fn table_vjp(
    positions: &CubeTensor,
    table: &CubeTensor,
    v_out: &CubeTensor,
    levels: &Buffer,
    layout: &HashGridLayout,
) -> CubeTensor {
    let n = positions.meta.shape()[0];
    let v_table = zeros(table, [layout.n_entries(), layout.n_features_per_level()]);
    let client = &positions.client;
    let n_corners = n << layout.dims();
    let everything = Buffer::from_words(client, &[n_corners as u32]);
    for (l, level) in layout.levels().iter().enumerate() {
        let new = || Buffer::uninitialised(client, n_corners);
        let (rows, corners, weights) = (new(), new(), new());
        let (count, dim) = units(client, n);
        // Points outside come last.
        let outside = level.size as u32;
        let launched = || LevelLaunch::new(l as u32, level.offset as u32, outside);
        list_corners::launch(
            client,
            count,
            dim,
            arg(positions),
            levels.arg(),
            rows.arg(),
            corners.arg(),
            weights.arg(),
            n as u32,
            launched(),
            grid(layout),
        );
        let count = DeviceCount {
            buffer: &everything,
            at: 0,
        };
        let (rows, corners) = sort_pairs(client, rows, corners, &count, bits_of(outside));
        let (count, dim) = units(client, n_corners);
        sum_rows::launch(
            client,
            count,
            dim,
            rows.arg(),
            corners.arg(),
            weights.arg(),
            arg(v_out),
            arg(&v_table),
            n_corners as u32,
            launched(),
            grid(layout),
        );
    }
    v_table
}

/// The numbers of a level as launched.
#[derive(CubeType, CubeLaunch, Clone, Copy)]
struct Level {
    index: u32,
    /// First row of the level in the table.
    offset: u32,
    /// Stands for the row of a point outside.
    outside: u32,
}

/// Bits that hold every number up to `largest`.
fn bits_of(largest: u32) -> u32 {
    u32::BITS - largest.leading_zeros()
}

#[cube(launch)]
fn list_corners(
    positions: &[f32],   // [N, D]
    levels: &[u32],      // [L, N_WORDS]
    rows: &mut [u32],    // [N, 2^D]
    corners: &mut [u32], // [N, 2^D]
    weights: &mut [f32], // [N, 2^D]
    n: u32,
    level: Level,
    #[comptime] grid: Grid,
) {
    let point = ABSOLUTE_POS;
    if point >= n as usize {
        terminate!();
    }
    let first = point * comptime!(1usize << grid.dims);
    let inside = is_inside(positions, point, grid.dims);
    #[unroll]
    for corner in 0..comptime!(1usize << grid.dims) {
        rows[first + corner] = level.outside;
        corners[first + corner] = (first + corner) as u32;
    }
    if inside {
        let cell = locate(
            positions,
            point,
            levels,
            level.index as usize,
            grid.dims,
            grid.smooth,
        );
        #[unroll]
        for corner in 0..comptime!(1usize << grid.dims) {
            let row = corner_row(&cell, corner, grid.dims) as u32;
            rows[first + corner] = row - cell.offset;
            weights[first + corner] = corner_weight(&cell, corner, grid.dims);
        }
    }
}

#[cube(launch)]
fn sum_rows(
    rows: &[u32],        // [N * 2^D]
    corners: &[u32],     // [N * 2^D]
    weights: &[f32],     // [N, 2^D]
    v_out: &[f32],       // [N, L * F]
    v_table: &mut [f32], // [T, F]
    n_corners: u32,
    level: Level,
    #[comptime] grid: Grid,
) {
    let place = ABSOLUTE_POS;
    if place >= n_corners as usize {
        terminate!();
    }
    let row = rows[place];
    let mut starts = place == 0;
    if place > 0 {
        starts = rows[place - 1] != row;
    }
    if starts && row != level.outside {
        let mut sums = Array::<f32>::new(grid.features);
        #[unroll]
        for f in 0..grid.features {
            sums[f] = 0.0f32;
        }
        let mut next = place;
        let mut same = true;
        while same {
            #[unroll]
            for _ in 0..PER_ROUND {
                if same {
                    let corner = corners[next] as usize;
                    let point = corner / comptime!(1usize << grid.dims);
                    let at = (point * grid.levels + level.index as usize) * grid.features;
                    #[unroll]
                    for f in 0..grid.features {
                        sums[f] += weights[corner] * bounded(v_out[at + f]);
                    }
                    next += 1;
                    same = false;
                    if next < n_corners as usize {
                        same = rows[next] == row;
                    }
                }
            }
        }
        #[unroll]
        for f in 0..grid.features {
            v_table[(level.offset + row) as usize * grid.features + f] = sums[f];
        }
    }
}
