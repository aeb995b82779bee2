//! Stable radix sort of `u32` keys with a `u32` value each, least significant digit first.
//!
//! A unit owns `PER_UNIT` neighbouring pairs; a cube of `UNITS` units owns one block of them. Per
//! digit three steps: every cube counts the digits of its block, the counts of each digit are summed up over the blocks
//! before, every cube moves its block's pairs to their places. Where there are few blocks, every cube sums the counts
//! that it needs itself: reading them takes less than another launch. Within a cube each unit counts its own pairs in a
//! column of shared memory, so that no atomics are needed and the order of equal digits is kept whatever the width of a
//! subgroup.
//! Shared memory: a count per unit and digit, two in a word, and a place per digit, 9 KiB. Deterministic.

use cubecl::prelude::*;

use super::{Buffer, calculate_cubes};

/// Units of a cube.
const UNITS: usize = 32;
/// Neighbouring pairs that a unit sorts.
const PER_UNIT: usize = 32;
/// Counts within a block fit into 16 bits.
const BLOCK: usize = UNITS * PER_UNIT;
/// Bits sorted at a time.
const DIGIT_BITS: u32 = 7;
const N_DIGITS: usize = 1 << DIGIT_BITS;
/// Words that hold a unit's counts: those of a digit of the lower half and of one of the upper half.
const N_WORDS: usize = N_DIGITS / 2;
/// Digits whose places a unit works out.
const DIGITS_PER_UNIT: usize = N_DIGITS / UNITS;
/// Distance of a word's columns in shared memory: one more than there are units, so that units
/// that walk along different words meet different banks.
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
        // Behind those of the blocks a row of totals.
        let counts = Buffer::uninitialised(client, N_DIGITS * (n_blocks + 1));
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
        );
        if !few {
            sum_before::launch(
                client,
                calculate_cubes(client, N_DIGITS),
                dim,
                counts.arg(),
                n_blocks as u32,
            );
        }
        let sorted_keys = Buffer::uninitialised(client, n);
        let sorted_values = Buffer::uninitialised(client, n);
        move_pairs::launch(
            client,
            cubes.clone(),
            dim,
            keys.arg(),
            values.arg(),
            count.arg(),
            counts.arg(),
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

/// The word of a key's digit, and by how many bits its count is shifted in there.
#[cube]
fn place_of_count(key: u32, shift: u32) -> (usize, u32) {
    let digit = (key >> shift) & comptime!(N_DIGITS as u32 - 1);
    let half = comptime!(N_WORDS as u32);
    ((digit % half) as usize, digit / half * 16u32)
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
    for word in 0..N_WORDS {
        counts[word * STRIDE + unit] = 0u32;
    }
    let mut i = first;
    while i < end {
        let (word, bits) = place_of_count(keys[i], shift);
        counts[word * STRIDE + unit] += 1u32 << bits;
        i += 1;
    }
}

/// Counts of each block and digit `[n_blocks, N_DIGITS]`.
#[cube(launch)]
fn count_digits(
    keys: &[u32],
    count: &[u32],
    digit_counts: &mut [u32],
    count_at: u32,
    n: u32,
    n_blocks: u32,
    shift: u32,
) {
    let mut counts = Shared::<[u32]>::new_slice(comptime!(N_WORDS * STRIDE));
    let (first, end) = own_pairs(count, count_at, n);
    count_own(keys, &mut counts, first, end, shift);
    // A word's counts are summed by one unit after all have counted.
    sync_cube();
    if CUBE_POS < n_blocks as usize {
        let mut word = UNIT_POS as usize;
        while word < N_WORDS {
            let mut sum = 0u32;
            for unit in 0..UNITS {
                sum += counts[word * STRIDE + unit];
            }
            let at = CUBE_POS * N_DIGITS + word;
            digit_counts[at] = sum & 0xffffu32;
            digit_counts[at + N_WORDS] = sum >> 16u32;
            word += UNITS;
        }
    }
}

/// Puts in place of each block's count of a digit the sum of those of the blocks before; the sum of all goes behind them.
/// A cube owns a digit.
#[cube(launch)]
fn sum_before(digit_counts: &mut [u32], n_blocks: u32) {
    let mut sums = Shared::<[u32]>::new_slice(UNITS);
    let unit = UNIT_POS as usize;
    let n_blocks = n_blocks as usize;
    let run = n_blocks.div_ceil(UNITS);
    let first = usize::min(unit * run, n_blocks);
    let mut end = usize::min(first + run, n_blocks);
    if CUBE_POS >= N_DIGITS {
        end = first;
    }
    let mut sum = 0u32;
    for block in first..end {
        sum += digit_counts[block * N_DIGITS + CUBE_POS];
    }
    sums[unit] = sum;
    sync_cube();
    let mut before = 0u32;
    for other in 0..unit {
        before += sums[other];
    }
    for block in first..end {
        let at = block * N_DIGITS + CUBE_POS;
        let own = digit_counts[at];
        digit_counts[at] = before;
        before += own;
    }
    if CUBE_POS < N_DIGITS && unit == UNITS - 1 {
        digit_counts[n_blocks * N_DIGITS + CUBE_POS] = before;
    }
}

#[cube(launch)]
fn move_pairs(
    keys: &[u32],
    values: &[u32],
    count: &[u32],
    // Of each block and digit: sums of the blocks before, and of all; with few blocks, what `count_digits` counted.
    digit_counts: &[u32],
    sorted_keys: &mut [u32],
    sorted_values: &mut [u32],
    count_at: u32,
    n: u32,
    n_blocks: u32,
    shift: u32,
    #[comptime] few: bool,
) {
    let mut counts = Shared::<[u32]>::new_slice(comptime!(N_WORDS * STRIDE));
    let mut places = Shared::<[u32]>::new_slice(N_DIGITS);
    let mut sums = Shared::<[u32]>::new_slice(UNITS);
    let unit = UNIT_POS as usize;
    let n_blocks = n_blocks as usize;
    let (first, end) = own_pairs(count, count_at, n);
    count_own(keys, &mut counts, first, end, shift);

    // Of each digit of this unit, the pairs in blocks before this one, and all.
    let mut before = Array::<u32>::new(DIGITS_PER_UNIT);
    let mut all = Array::<u32>::new(DIGITS_PER_UNIT);
    let first_digit = unit * DIGITS_PER_UNIT;
    #[unroll]
    for k in 0..DIGITS_PER_UNIT {
        before[k] = 0u32;
        all[k] = 0u32;
        if comptime!(!few) && CUBE_POS < n_blocks {
            before[k] = digit_counts[CUBE_POS * N_DIGITS + first_digit + k];
            all[k] = digit_counts[n_blocks * N_DIGITS + first_digit + k];
        }
    }
    if comptime!(few) {
        for block in 0..n_blocks {
            #[unroll]
            for k in 0..DIGITS_PER_UNIT {
                let own = digit_counts[block * N_DIGITS + first_digit + k];
                all[k] += own;
                before[k] += select(block < CUBE_POS, own, 0u32);
            }
        }
    }
    let mut sum = 0u32;
    #[unroll]
    for k in 0..DIGITS_PER_UNIT {
        sum += all[k];
    }
    sums[unit] = sum;
    // Sums and counts of all units are complete.
    sync_cube();
    let mut place = 0u32;
    for other in 0..unit {
        place += sums[other];
    }
    #[unroll]
    for k in 0..DIGITS_PER_UNIT {
        places[first_digit + k] = place + before[k];
        place += all[k];
    }
    // Counts become those of the units before.
    let mut word = unit;
    while word < N_WORDS {
        let mut sum = 0u32;
        for other in 0..UNITS {
            let at = word * STRIDE + other;
            let own = counts[at];
            counts[at] = sum;
            sum += own;
        }
        word += UNITS;
    }
    // All places are known before any pair moves.
    sync_cube();
    for i in first..end {
        let key = keys[i];
        let (word, bits) = place_of_count(key, shift);
        let at = word * STRIDE + unit;
        let own = counts[at];
        counts[at] = own + (1u32 << bits);
        let digit = word + comptime!(N_WORDS) * (bits / 16u32) as usize;
        let place = (places[digit] + ((own >> bits) & 0xffffu32)) as usize;
        sorted_keys[place] = key;
        sorted_values[place] = values[i];
    }
}
