//! Sums over many values: up to [`MAX_CUBES`] cubes of [`UNITS`] units. The values of a unit are as far apart as there are
//! units; each cube adds up its units' sums in shared memory, and who needs the total adds up those of the cubes. No atomics;
//! deterministic.

use burn_cubecl::tensor::CubeTensor;
use cubecl::prelude::*;

use super::{arg, calculate_cubes, uninitialised, units};

/// Units of a cube that adds up, a power of two.
pub(crate) const UNITS: usize = 128;
/// Base-2 logarithm of [`UNITS`].
const HALVINGS: usize = 7;
/// Most cubes that add up.
const MAX_CUBES: usize = 64;

/// Cubes that add up `n` values, and their launch size.
pub(crate) fn cubes(client: &Client, n: usize) -> (usize, CubeCount, CubeDim) {
    let n_cubes = n.div_ceil(UNITS).clamp(1, MAX_CUBES);
    let count = calculate_cubes(client, n_cubes);
    (n_cubes, count, CubeDim::new_1d(UNITS as u32))
}

/// The sum `[1]` of what the cubes have added up.
pub(crate) fn total(sums: &CubeTensor, n_cubes: usize) -> CubeTensor {
    let total = uninitialised(sums, [1]);
    let (count, dim) = units(&sums.client, 1);
    total_kernel::launch(
        &sums.client,
        count,
        dim,
        arg(sums),
        arg(&total),
        n_cubes as u32,
    );
    total
}

#[cube(launch)]
fn total_kernel(
    sums: &[f32],      // [cubes]
    total: &mut [f32], // [1]
    n_cubes: u32,
) {
    if ABSOLUTE_POS == 0 {
        let mut sum = 0.0f32;
        for cube in 0..n_cubes {
            sum += sums[cube as usize];
        }
        total[0usize] = sum;
    }
}

/// Adds up runs of [`UNITS`] values, each into its first. Every unit of the cube has to call it.
#[cube]
pub(crate) fn add_up(
    values: &mut Shared<[f32]>, // [runs, UNITS]
    #[comptime] runs: usize,
) {
    let unit = UNIT_POS as usize;
    // What all units wrote is read.
    sync_cube();
    let mut half = comptime!(UNITS / 2).runtime();
    for _ in 0..HALVINGS {
        if unit < half {
            #[unroll]
            for run in 0..runs {
                let at = run * UNITS + unit;
                let other = values[at + half];
                values[at] += other;
            }
        }
        half /= 2;
        // The next half is read by other units.
        sync_cube();
    }
}
