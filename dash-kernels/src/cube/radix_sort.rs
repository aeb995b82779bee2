//! Stable radix sort of `u32` keys with a `u32` value each, least significant digit first.
//!
//! A unit owns `PER_UNIT` neighbouring pairs; a cube of `UNITS` units owns one block of them. Per
//! digit three steps: every cube counts the digits of its block, the counts are turned into places
//! by a prefix sum over (digit, block), every cube moves its block's pairs to their places. Where
//! there are few blocks, every cube sums the counts that it needs itself: reading them takes less
//! than another launch. Within
//! a cube each unit counts its own pairs in a column of shared memory, so that no atomics are
//! needed and the order of equal digits is kept whatever the width of a subgroup.
//! Shared memory: a count per unit and digit and one per digit, 8.3 KiB. Deterministic.

use cubecl::prelude::*;

use super::scan::exclusive_scan;
use super::{Buffer, calculate_cubes};

/// Units of a cube.
const UNITS: usize = 64;
/// Neighbouring pairs that a unit sorts.
const PER_UNIT: usize = 16;
const BLOCK: usize = UNITS * PER_UNIT;
/// Bits sorted at a time.
const DIGIT_BITS: u32 = 5;
const N_DIGITS: usize = 1 << DIGIT_BITS;
/// Distance of a digit's counts in shared memory: one more than there are units, so that units
/// that walk along different digits meet different banks.
const STRIDE: usize = UNITS + 1;
/// Blocks whose counts every cube sums itself.
const FEW_BLOCKS: usize = 128;

/// How many pairs there are, as far as only the device knows.
pub(crate) struct DeviceCount<'a> {
    /// Where it is kept.
    pub buffer: &'a Buffer,
    /// At which place.
    pub at: usize,
}

/// Sorts the first pairs, as many as `count` says but no more than there are, by the lowest
/// `key_bits` bits of their keys; what comes after them is undefined.
pub(crate) fn sort_pairs(
    client: &Client,
    keys: Buffer,
    values: Buffer,
    count: &DeviceCount,
    key_bits: u32,
) -> (Buffer, Buffer) {
    let n = keys.len();
    let count_at = count.at as u32;
    let count = count.buffer;
    let n_blocks = n.div_ceil(BLOCK).max(1);
    let dim = CubeDim::new_1d(UNITS as u32);
    let cubes = calculate_cubes(client, n_blocks);
    let few = n_blocks <= FEW_BLOCKS;
    let (mut keys, mut values) = (keys, values);
    for shift in (0..key_bits).step_by(DIGIT_BITS as usize) {
        let counts = Buffer::uninitialised(client, N_DIGITS * n_blocks);
        count_digits::launch(
            client,
            cubes.clone(),
            dim,
            keys.arg(),
            count.arg(),
            counts.arg(),
            count_at,
            n as u32,
            n_blocks as u32,
            shift,
            few,
        );
        let places = if few {
            counts
        } else {
            exclusive_scan(client, &counts)
        };
        let sorted_keys = Buffer::uninitialised(client, n);
        let sorted_values = Buffer::uninitialised(client, n);
        move_pairs::launch(
            client,
            cubes.clone(),
            dim,
            keys.arg(),
            values.arg(),
            count.arg(),
            places.arg(),
            sorted_keys.arg(),
            sorted_values.arg(),
            count_at,
            n as u32,
            n_blocks as u32,
            shift,
            few,
        );
        (keys, values) = (sorted_keys, sorted_values);
    }
    (keys, values)
}

#[cube]
fn digit(key: u32, shift: u32) -> usize {
    ((key >> shift) & comptime!(N_DIGITS as u32 - 1)) as usize
}

/// The pairs of this unit, from and to.
#[cube]
fn own_pairs(count: &[u32], count_at: u32, n: u32) -> (usize, usize) {
    let n = u32::min(count[count_at as usize], n);
    let first = (CUBE_POS * BLOCK + UNIT_POS as usize * PER_UNIT) as u32;
    let end = u32::min(first + comptime!(PER_UNIT as u32), n);
    (first as usize, end as usize)
}

/// Counts the digits of this unit's pairs in its column.
#[cube]
fn count_own(keys: &[u32], counts: &mut Shared<[u32]>, first: usize, end: usize, shift: u32) {
    let unit = UNIT_POS as usize;
    for d in 0..N_DIGITS {
        counts[d * STRIDE + unit] = 0;
    }
    for i in first..end {
        counts[digit(keys[i], shift) * STRIDE + unit] += 1;
    }
}

#[cube(launch)]
fn count_digits(
    keys: &[u32],
    count: &[u32],
    digit_counts: &mut [u32],
    count_at: u32,
    n: u32,
    n_blocks: u32,
    shift: u32,
    #[comptime] few: bool,
) {
    let mut counts = Shared::<[u32]>::new_slice(comptime!(N_DIGITS * STRIDE));
    let (first, end) = own_pairs(count, count_at, n);
    count_own(keys, &mut counts, first, end, shift);
    // A digit's counts are summed by one unit after all have counted.
    sync_cube();
    let d = UNIT_POS as usize;
    if d < N_DIGITS && CUBE_POS < n_blocks as usize {
        let mut sum = 0u32;
        for unit in 0..UNITS {
            sum += counts[d * STRIDE + unit];
        }
        // Beside those of other digits where cubes read them all, else of other blocks.
        let at = if comptime!(few) {
            CUBE_POS * N_DIGITS + d
        } else {
            d * n_blocks as usize + CUBE_POS
        };
        digit_counts[at] = sum;
    }
}

/// How many pairs of a digit there are in the blocks before this one, and in all.
#[cube]
fn sum_blocks(digit_counts: &[u32], d: usize, n_blocks: usize) -> (u32, u32) {
    let mut before = 0u32;
    let mut all = 0u32;
    for block in 0..n_blocks {
        let own = digit_counts[block * N_DIGITS + d];
        all += own;
        before += select(block < CUBE_POS, own, 0u32);
    }
    (before, all)
}

#[cube(launch)]
fn move_pairs(
    keys: &[u32],
    values: &[u32],
    count: &[u32],
    // Of each digit and block; with few blocks, what `count_digits` counted.
    places: &[u32],
    sorted_keys: &mut [u32],
    sorted_values: &mut [u32],
    count_at: u32,
    n: u32,
    n_blocks: u32,
    shift: u32,
    #[comptime] few: bool,
) {
    let mut counts = Shared::<[u32]>::new_slice(comptime!(N_DIGITS * STRIDE));
    let mut totals = Shared::<[u32]>::new_slice(N_DIGITS);
    let (first, end) = own_pairs(count, count_at, n);
    count_own(keys, &mut counts, first, end, shift);
    let d = UNIT_POS as usize;
    let mut place = 0u32;
    if d < N_DIGITS {
        if comptime!(few) {
            let (before, all) = sum_blocks(places, d, n_blocks as usize);
            place = before;
            totals[d] = all;
        } else if CUBE_POS < n_blocks as usize {
            place = places[d * n_blocks as usize + CUBE_POS];
        }
    }
    // A digit's counts are turned into places by one unit after all have counted.
    sync_cube();
    if d < N_DIGITS && CUBE_POS < n_blocks as usize {
        if comptime!(few) {
            for smaller in 0..d {
                place += totals[smaller];
            }
        }
        for unit in 0..UNITS {
            let own = counts[d * STRIDE + unit];
            counts[d * STRIDE + unit] = place;
            place += own;
        }
    }
    // All places are known before any pair moves.
    sync_cube();
    let unit = UNIT_POS as usize;
    for i in first..end {
        let key = keys[i];
        let at = digit(key, shift) * STRIDE + unit;
        let place = counts[at] as usize;
        counts[at] = place as u32 + 1;
        sorted_keys[place] = key;
        sorted_values[place] = values[i];
    }
}
