//! The hash encoding on CubeCL devices.
//!
//! Forward and gradient to the table: a unit owns one point on one level, neighbouring units the
//! same level, whose table stays in the cache. Gradient to the positions: a unit owns
//! one point. No shared memory. The gradient to the table is added up atomically, in any order, or
//! by [`deterministic`] in a fixed one.

mod deterministic;
mod levels;
#[cfg(test)]
mod tests;

use burn_cubecl::CubeBackend;
use burn_cubecl::tensor::CubeTensor;
use cubecl::prelude::*;

use crate::cube::atomic::{ExchangeAdd, FloatAdd, NativeAdd, has_native_add};
use crate::cube::{Buffer, arg, contiguous, finite_or_zero, uninitialised, units, zeros};
use crate::determinism::is_deterministic;

use super::{HashEncode, HashEncodeVjp, HashGridLayout, Interpolation, LARGEST_COTANGENT};
use levels::{corner_row, corner_slope, corner_weight, is_inside, level_words, locate};

impl HashEncode for CubeBackend {
    fn hash_encode(positions: CubeTensor, table: CubeTensor, layout: HashGridLayout) -> CubeTensor {
        let (positions, table) = (contiguous(positions), contiguous(table));
        let n = positions.meta.shape()[0];
        let out = uninitialised(&positions, [n, layout.n_features()]);
        let client = &positions.client;
        let (count, dim) = units(client, n * layout.n_levels());
        encode::launch(
            client,
            count,
            dim,
            arg(&positions),
            arg(&table),
            level_words(client, &layout).arg(),
            arg(&out),
            n as u32,
            grid(&layout),
        );
        out
    }
}

impl HashEncodeVjp for CubeBackend {
    fn hash_encode_vjp(
        positions: CubeTensor,
        table: CubeTensor,
        v_out: CubeTensor,
        layout: &HashGridLayout,
        [needs_positions, needs_table]: [bool; 2],
    ) -> [Option<CubeTensor>; 2] {
        let [positions, table, v_out] = [positions, table, v_out].map(contiguous);
        let levels = level_words(&positions.client, layout);
        let v_positions =
            needs_positions.then(|| positions_vjp(&positions, &table, &v_out, &levels, layout));
        let v_table = needs_table.then(|| {
            if is_deterministic() {
                deterministic::table_vjp(&positions, &table, &v_out, &levels, layout)
            } else if has_native_add(&positions.client) {
                table_vjp::<NativeAdd>(&positions, &table, &v_out, &levels, layout)
            } else {
                table_vjp::<ExchangeAdd>(&positions, &table, &v_out, &levels, layout)
            }
        });
        [v_positions, v_table]
    }
}

fn positions_vjp(
    positions: &CubeTensor,
    table: &CubeTensor,
    v_out: &CubeTensor,
    levels: &Buffer,
    layout: &HashGridLayout,
) -> CubeTensor {
    let n = positions.meta.shape()[0];
    let v_positions = uninitialised(positions, [n, layout.dims()]);
    let client = &positions.client;
    let (count, dim) = units(client, n);
    positions_vjp_kernel::launch(
        client,
        count,
        dim,
        arg(positions),
        arg(table),
        levels.arg(),
        arg(v_out),
        arg(&v_positions),
        n as u32,
        grid(layout),
    );
    v_positions
}

fn table_vjp<A: FloatAdd>(
    positions: &CubeTensor,
    table: &CubeTensor,
    v_out: &CubeTensor,
    levels: &Buffer,
    layout: &HashGridLayout,
) -> CubeTensor {
    let n = positions.meta.shape()[0];
    let v_table = zeros(table, [layout.n_entries(), layout.n_features_per_level()]);
    let client = &positions.client;
    let (count, dim) = units(client, n * layout.n_levels());
    table_vjp_kernel::launch::<A>(
        client,
        count,
        dim,
        arg(positions),
        levels.arg(),
        arg(v_out),
        arg(&v_table),
        n as u32,
        grid(layout),
    );
    v_table
}

/// Constants that a kernel is compiled for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
struct Grid {
    dims: usize,
    levels: usize,
    features: usize,
    smooth: bool,
}

fn grid(layout: &HashGridLayout) -> Grid {
    Grid {
        dims: layout.dims(),
        levels: layout.n_levels(),
        features: layout.n_features_per_level(),
        smooth: layout.interpolation() == Interpolation::Smoothstep,
    }
}

/// A gradient of the output, clamped and finite.
#[cube]
fn bounded(v: f32) -> f32 {
    f32::clamp(finite_or_zero(v), -LARGEST_COTANGENT, LARGEST_COTANGENT)
}

#[cube(launch)]
fn encode(
    positions: &[f32], // [N, D]
    table: &[f32],     // [T, F]
    levels: &[u32],    // [L, N_WORDS]
    out: &mut [f32],   // [N, L * F]
    n: u32,
    #[comptime] grid: Grid,
) {
    let n = n as usize;
    if ABSOLUTE_POS >= n * grid.levels {
        terminate!();
    }
    let level = ABSOLUTE_POS / n;
    let point = ABSOLUTE_POS % n;
    let mut features = Array::<f32>::new(grid.features);
    #[unroll]
    for f in 0..grid.features {
        features[f] = 0.0f32;
    }
    if is_inside(positions, point, grid.dims) {
        let cell = locate(positions, point, levels, level, grid.dims, grid.smooth);
        #[unroll]
        for corner in 0..comptime!(1usize << grid.dims) {
            let row = corner_row(&cell, corner, grid.dims) * grid.features;
            let weight = corner_weight(&cell, corner, grid.dims);
            #[unroll]
            for f in 0..grid.features {
                features[f] += weight * table[row + f];
            }
        }
    }
    let at = (point * grid.levels + level) * grid.features;
    #[unroll]
    for f in 0..grid.features {
        out[at + f] = finite_or_zero(features[f]);
    }
}

#[cube(launch)]
fn positions_vjp_kernel(
    positions: &[f32],       // [N, D]
    table: &[f32],           // [T, F]
    levels: &[u32],          // [L, N_WORDS]
    v_out: &[f32],           // [N, L * F]
    v_positions: &mut [f32], // [N, D]
    n: u32,
    #[comptime] grid: Grid,
) {
    let point = ABSOLUTE_POS;
    if point >= n as usize {
        terminate!();
    }
    let mut v = Array::<f32>::new(grid.dims);
    #[unroll]
    for axis in 0..grid.dims {
        v[axis] = 0.0f32;
    }
    if is_inside(positions, point, grid.dims) {
        for level in 0..grid.levels {
            let cell = locate(positions, point, levels, level, grid.dims, grid.smooth);
            let at = (point * grid.levels + level) * grid.features;
            #[unroll]
            for corner in 0..comptime!(1usize << grid.dims) {
                let row = corner_row(&cell, corner, grid.dims) * grid.features;
                let mut v_weight = 0.0f32;
                #[unroll]
                for f in 0..grid.features {
                    v_weight += table[row + f] * bounded(v_out[at + f]);
                }
                #[unroll]
                for axis in 0..grid.dims {
                    v[axis] += v_weight * corner_slope(&cell, corner, axis, grid.dims);
                }
            }
        }
    }
    #[unroll]
    for axis in 0..grid.dims {
        v_positions[point * grid.dims + axis] = finite_or_zero(v[axis]);
    }
}

#[cube(launch)]
fn table_vjp_kernel<A: FloatAdd>(
    positions: &[f32],           // [N, D]
    levels: &[u32],              // [L, N_WORDS]
    v_out: &[f32],               // [N, L * F]
    v_table: &[Atomic<A::Word>], // [T, F]
    n: u32,
    #[comptime] grid: Grid,
) {
    let n = n as usize;
    if ABSOLUTE_POS >= n * grid.levels {
        terminate!();
    }
    let level = ABSOLUTE_POS / n;
    let point = ABSOLUTE_POS % n;
    if is_inside(positions, point, grid.dims) {
        let cell = locate(positions, point, levels, level, grid.dims, grid.smooth);
        let at = (point * grid.levels + level) * grid.features;
        #[unroll]
        for corner in 0..comptime!(1usize << grid.dims) {
            let row = corner_row(&cell, corner, grid.dims) * grid.features;
            let weight = corner_weight(&cell, corner, grid.dims);
            #[unroll]
            for f in 0..grid.features {
                A::add(&v_table[row + f], weight * bounded(v_out[at + f]));
            }
        }
    }
}
