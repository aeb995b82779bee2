//! Exclusive prefix sums of `u32` values; sums that outgrow `u32` stay at its largest number.
//!
//! A unit owns `PER_UNIT` neighbouring values, a cube of `UNITS` units one block of them. A short input is summed by a
//! single cube whose units own longer runs. A longer one takes two launches: sums of the blocks, and prefix sums within
//! the blocks. In the second every cube adds up the sums of the preceding blocks; where these are many, a launch between
//! the two takes their prefix sums.
//! Shared memory: one value per unit. No atomics; integer sums are the same in any order.

use cubecl::prelude::*;

use super::{Buffer, calculate_cubes};

/// Units of a cube.
const UNITS: usize = 64;
/// Neighbouring values that a unit sums.
const PER_UNIT: usize = 16;
const BLOCK: usize = UNITS * PER_UNIT;
/// Up to this many values a single cube does all the work.
const SINGLE_CUBE_MAX: usize = 8 * BLOCK;
/// Up to this many blocks every cube adds up the sums itself.
const FEW_BLOCKS: usize = 1024;

/// The sum of the values preceding each, and of all values: `[n] -> [n + 1]`.
pub(crate) fn exclusive_scan(client: &Client, values: &Buffer) -> Buffer {
    let n = values.len();
    let sums = Buffer::uninitialised(client, n + 1);
    let dim = CubeDim::new_1d(UNITS as u32);
    let n_blocks = n.div_ceil(BLOCK);
    if n <= SINGLE_CUBE_MAX {
        let one = CubeCount::Static(1, 1, 1);
        scan_one_cube::launch(client, one, dim, values.arg(), sums.arg(), n as u32);
        return sums;
    }
    let cubes = calculate_cubes(client, n_blocks);
    let block_sums = Buffer::uninitialised(client, n_blocks);
    sum_blocks::launch(
        client,
        cubes.clone(),
        dim,
        values.arg(),
        block_sums.arg(),
        n as u32,
    );
    let few = n_blocks <= FEW_BLOCKS;
    let blocks = match few {
        true => block_sums,
        false => exclusive_scan(client, &block_sums),
    };
    scan_blocks::launch(
        client,
        cubes,
        dim,
        values.arg(),
        blocks.arg(),
        sums.arg(),
        n as u32,
        n_blocks as u32,
        few,
    );
    sums
}

/// The sum, or the largest number there is where that is less.
#[cube]
fn saturating_add(a: u32, b: u32) -> u32 {
    let sum = a + b;
    select(sum < a, 0xffff_ffffu32, sum)
}

/// The sum over the preceding units, and over all units. Every unit of the cube has to call it.
#[cube]
fn cube_exclusive_sum(own: u32, #[comptime] units: usize) -> (u32, u32) {
    let mut sums = Shared::<[u32]>::new_slice(units);
    let unit = UNIT_POS as usize;
    sums[unit] = own;
    // The sums of the units up to each, by doubling.
    let mut inclusive = own;
    let mut reach = 1usize;
    while reach < units {
        sync_cube();
        let mut before = 0u32;
        if unit >= reach {
            before = sums[unit - reach];
        }
        // All units have read before any writes.
        sync_cube();
        inclusive = saturating_add(inclusive, before);
        sums[unit] = inclusive;
        reach *= 2;
    }
    sync_cube();
    let mut before = 0u32;
    if unit > 0 {
        before = sums[unit - 1];
    }
    (before, sums[units - 1])
}

#[cube(launch)]
fn sum_blocks(
    values: &[u32],         // [n]
    block_sums: &mut [u32], // [n_blocks]
    n: u32,
) {
    let first = CUBE_POS * BLOCK + UNIT_POS as usize * PER_UNIT;
    let own = sum_run(values, first, PER_UNIT, n as usize);
    let (_, all) = cube_exclusive_sum(own, UNITS);
    if UNIT_POS == 0 && CUBE_POS * BLOCK < n as usize {
        block_sums[CUBE_POS] = all;
    }
}

/// `blocks` holds prefix sums of the blocks' sums; with few blocks, these sums.
#[cube(launch)]
fn scan_blocks(
    values: &[u32],   // [n]
    blocks: &[u32],   // [n_blocks + 1], with few blocks [n_blocks]
    sums: &mut [u32], // [n + 1]
    n: u32,
    n_blocks: u32,
    #[comptime] few: bool,
) {
    let first = CUBE_POS * BLOCK + UNIT_POS as usize * PER_UNIT;
    let own = sum_run(values, first, PER_UNIT, n as usize);
    let (before, _) = cube_exclusive_sum(own, UNITS);
    let block = usize::min(CUBE_POS, n_blocks as usize - 1);
    let start = if comptime!(few) {
        let mut own = 0u32;
        let mut other = UNIT_POS as usize;
        while other < block {
            own = saturating_add(own, blocks[other]);
            other += UNITS;
        }
        let (_, all) = cube_exclusive_sum(own, UNITS);
        all
    } else {
        blocks[block]
    };
    if first < n as usize {
        scan_run(
            values,
            sums,
            first,
            PER_UNIT,
            n as usize,
            saturating_add(start, before),
        );
    }
}

#[cube(launch)]
fn scan_one_cube(
    values: &[u32],   // [n]
    sums: &mut [u32], // [n + 1]
    n: u32,
) {
    let run = (n as usize).div_ceil(UNITS);
    let first = UNIT_POS as usize * run;
    let own = sum_run(values, first, run, n as usize);
    let (before, all) = cube_exclusive_sum(own, UNITS);
    scan_run(values, sums, first, run, n as usize, before);
    if UNIT_POS == 0 {
        sums[n as usize] = all;
    }
}

#[cube]
fn sum_run(
    values: &[u32], // [n]
    first: usize,
    run: usize,
    n: usize,
) -> u32 {
    let mut sum = 0u32;
    let mut i = first;
    while i < first + run && i < n {
        sum = saturating_add(sum, values[i]);
        i += 1;
    }
    sum
}

/// Writes the prefix sums of a run, and after the last value the total.
#[cube]
fn scan_run(
    values: &[u32],   // [n]
    sums: &mut [u32], // [n + 1]
    first: usize,
    run: usize,
    n: usize,
    before: u32,
) {
    let mut sum = before;
    let mut i = first;
    while i < first + run && i < n {
        sums[i] = sum;
        sum = saturating_add(sum, values[i]);
        i += 1;
        if i == n {
            sums[n] = sum;
        }
    }
}
