//! Stable radix sort of `u32` keys with a `u32` value each, least significant digit first.
//!
//! A unit owns `PER_UNIT` neighbouring pairs, a cube of `UNITS` units one block of them. Each digit takes three launches:
//! every cube counts the digits of its block, prefix sums of each digit's counts are taken over the blocks, every cube
//! moves its block's pairs to their places. With few blocks every cube takes these prefix sums itself: reading the
//! counts takes less than another launch. Within a cube each unit counts its own pairs in a column of shared memory. So
//! no atomics are needed, and the order of equal digits is kept whatever the width of a subgroup.
//! Shared memory: a count per unit and digit, three in a word, and a place per digit, 12.3 KiB. Deterministic.

use cubecl::prelude::*;

use super::{Buffer, calculate_cubes};

/// Units of a cube.
const UNITS: usize = 32;
/// Neighbouring pairs that a unit sorts.
const PER_UNIT: usize = 32;
const BLOCK: usize = UNITS * PER_UNIT;
/// Bits sorted at a time.
const DIGIT_BITS: u32 = 8;
const N_DIGITS: usize = 1 << DIGIT_BITS;
/// Counts in a word. Ten bits each do: before a pair of a block there are at most 1,023 others. Where a count becomes 1,024
/// and changes its neighbour, all pairs of the block have that digit, and nobody looks at the neighbour.
const COUNTS: usize = 3;
const COUNT_BITS: u32 = 10;
const COUNT_MASK: u32 = (1 << COUNT_BITS) - 1;
/// Words that hold a unit's counts: each holds those of three digits, a third of all digits apart.
const N_WORDS: usize = N_DIGITS.div_ceil(COUNTS);
/// Digits whose places a unit computes.
const DIGITS_PER_UNIT: usize = N_DIGITS / UNITS;
/// Distance of a word's columns in shared memory: one more than there are units, so that units
/// that walk along different words meet different banks.
const STRIDE: usize = UNITS + 1;
/// Up to this many blocks every cube sums the counts itself.
const FEW_BLOCKS: usize = 128;

/// A number of pairs that only the device knows.
pub(crate) struct DeviceCount<'a> {
    /// The buffer that holds it.
    pub buffer: &'a Buffer,
    /// Its index in the buffer.
    pub at: usize,
}

/// Sorts the first `count` pairs, but no more than the buffers hold, by the lowest `key_bits` bits of their keys. The
/// remaining pairs are undefined.
pub(crate) fn sort_pairs(
    client: &Client,
    keys: Buffer,
    values: Buffer,
    count: &DeviceCount,
    key_bits: u32,
) -> (Buffer, Buffer) {
    let n = keys.len();
    let n_blocks = n.div_ceil(BLOCK).max(1);
    let dim = CubeDim::new_1d(UNITS as u32);
    let cubes = calculate_cubes(client, n_blocks);
    let few = n_blocks <= FEW_BLOCKS;
    let (mut keys, mut values) = (keys, values);
    for shift in (0..key_bits).step_by(DIGIT_BITS as usize) {
        let pass = || PassLaunch::new(count.at as u32, n as u32, n_blocks as u32, shift);
        // The last row holds totals.
        let counts = Buffer::uninitialised(client, N_DIGITS * (n_blocks + 1));
        count_digits::launch(
            client,
            cubes.clone(),
            dim,
            keys.arg(),
            count.buffer.arg(),
            counts.arg(),
            pass(),
        );
        if !few {
            scan_digit_counts::launch(
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
            count.buffer.arg(),
            counts.arg(),
            sorted_keys.arg(),
            sorted_values.arg(),
            pass(),
            few,
        );
        (keys, values) = (sorted_keys, sorted_values);
    }
    (keys, values)
}

/// The numbers of the pass over one digit.
#[derive(CubeType, CubeLaunch, Clone, Copy)]
struct Pass {
    /// Place of the number of pairs in its buffer.
    count_at: u32,
    /// Most pairs.
    n: u32,
    n_blocks: u32,
    /// Bits below the digit.
    shift: u32,
}

/// The word of a key's digit, and the shift of its count in that word.
#[cube]
fn place_of_count(key: u32, shift: u32) -> (usize, u32) {
    let digit = (key >> shift) & comptime!(N_DIGITS as u32 - 1);
    let third = comptime!(N_WORDS as u32);
    ((digit % third) as usize, digit / third * COUNT_BITS)
}

/// The pairs of this unit, from and to.
#[cube]
fn own_pairs(
    count: &[u32], // [count_at + 1 or more]
    pass: &Pass,
) -> (usize, usize) {
    let n = u32::min(count[pass.count_at as usize], pass.n);
    let first = (CUBE_POS * BLOCK + UNIT_POS as usize * PER_UNIT) as u32;
    let end = u32::min(first + comptime!(PER_UNIT as u32), n);
    (first as usize, end as usize)
}

/// Counts the digits of this unit's pairs in its column.
#[cube]
fn count_own(
    keys: &[u32],               // [n]
    counts: &mut Shared<[u32]>, // [N_WORDS, STRIDE]
    first: usize,
    end: usize,
    shift: u32,
) {
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

/// Counts the digits of each block.
#[cube(launch)]
fn count_digits(
    keys: &[u32],             // [n]
    count: &[u32],            // [count_at + 1 or more]
    digit_counts: &mut [u32], // [n_blocks + 1, N_DIGITS]
    pass: Pass,
) {
    let mut counts = Shared::<[u32]>::new_slice(comptime!(N_WORDS * STRIDE));
    let (first, end) = own_pairs(count, &pass);
    count_own(keys, &mut counts, first, end, pass.shift);
    // A word's counts are summed by one unit after all have counted.
    sync_cube();
    if CUBE_POS < pass.n_blocks as usize {
        let mut word = UNIT_POS as usize;
        while word < N_WORDS {
            let mut sums = Array::<u32>::new(COUNTS);
            #[unroll]
            for k in 0..COUNTS {
                sums[k] = 0u32;
            }
            for unit in 0..UNITS {
                let own = counts[word * STRIDE + unit];
                #[unroll]
                for k in 0..COUNTS {
                    sums[k] += (own >> comptime!(k as u32 * COUNT_BITS)) & COUNT_MASK;
                }
            }
            #[unroll]
            for k in 0..COUNTS {
                let digit = word + comptime!(k * N_WORDS);
                if digit < N_DIGITS {
                    digit_counts[CUBE_POS * N_DIGITS + digit] = sums[k];
                }
            }
            word += UNITS;
        }
    }
}

/// Replaces the counts of each digit by their exclusive prefix sums over the blocks, and appends the total. A cube owns
/// a digit.
#[cube(launch)]
fn scan_digit_counts(
    digit_counts: &mut [u32], // [n_blocks + 1, N_DIGITS]
    n_blocks: u32,
) {
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

/// For each digit of this unit, its number of pairs in the preceding blocks, and in all blocks.
#[derive(CubeType)]
struct DigitSums {
    before: Array<u32>, // [DIGITS_PER_UNIT]
    all: Array<u32>,    // [DIGITS_PER_UNIT]
}

/// The sums of this unit's digits: read, or with few blocks summed here.
#[cube]
fn digit_sums(
    digit_counts: &[u32], // [n_blocks + 1, N_DIGITS]
    first_digit: usize,
    n_blocks: usize,
    #[comptime] few: bool,
) -> DigitSums {
    let mut sums = DigitSums {
        before: Array::<u32>::new(DIGITS_PER_UNIT),
        all: Array::<u32>::new(DIGITS_PER_UNIT),
    };
    #[unroll]
    for k in 0..DIGITS_PER_UNIT {
        sums.before[k] = 0u32;
        sums.all[k] = 0u32;
        if comptime!(!few) && CUBE_POS < n_blocks {
            sums.before[k] = digit_counts[CUBE_POS * N_DIGITS + first_digit + k];
            sums.all[k] = digit_counts[n_blocks * N_DIGITS + first_digit + k];
        }
    }
    if comptime!(few) {
        for block in 0..n_blocks {
            #[unroll]
            for k in 0..DIGITS_PER_UNIT {
                let own = digit_counts[block * N_DIGITS + first_digit + k];
                sums.all[k] += own;
                sums.before[k] += select(block < CUBE_POS, own, 0u32);
            }
        }
    }
    sums
}

/// Replaces the units' counts `[N_WORDS, STRIDE]` by their exclusive prefix sums.
#[cube]
fn scan_units(counts: &mut Shared<[u32]>) {
    let mut word = UNIT_POS as usize;
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
}

/// Moves the pairs of each block to their places. `digit_counts` holds prefix sums; with few blocks, counts.
#[cube(launch)]
fn move_pairs(
    keys: &[u32],              // [n]
    values: &[u32],            // [n]
    count: &[u32],             // [count_at + 1 or more]
    digit_counts: &[u32],      // [n_blocks + 1, N_DIGITS]
    sorted_keys: &mut [u32],   // [n]
    sorted_values: &mut [u32], // [n]
    pass: Pass,
    #[comptime] few: bool,
) {
    let mut counts = Shared::<[u32]>::new_slice(comptime!(N_WORDS * STRIDE));
    let mut places = Shared::<[u32]>::new_slice(N_DIGITS);
    let mut unit_sums = Shared::<[u32]>::new_slice(UNITS);
    let unit = UNIT_POS as usize;
    let first_digit = unit * DIGITS_PER_UNIT;
    let (first, end) = own_pairs(count, &pass);
    count_own(keys, &mut counts, first, end, pass.shift);
    let sums = digit_sums(digit_counts, first_digit, pass.n_blocks as usize, few);
    let mut sum = 0u32;
    #[unroll]
    for k in 0..DIGITS_PER_UNIT {
        sum += sums.all[k];
    }
    unit_sums[unit] = sum;
    // Sums and counts of all units are complete.
    sync_cube();
    let mut place = 0u32;
    for other in 0..unit {
        place += unit_sums[other];
    }
    #[unroll]
    for k in 0..DIGITS_PER_UNIT {
        places[first_digit + k] = place + sums.before[k];
        place += sums.all[k];
    }
    scan_units(&mut counts);
    // All places are known before any pair moves.
    sync_cube();
    for i in first..end {
        let key = keys[i];
        let (word, bits) = place_of_count(key, pass.shift);
        let at = word * STRIDE + unit;
        let own = counts[at];
        counts[at] = own + (1u32 << bits);
        let digit = word + comptime!(N_WORDS) * (bits / COUNT_BITS) as usize;
        let place = (places[digit] + ((own >> bits) & COUNT_MASK)) as usize;
        sorted_keys[place] = key;
        sorted_values[place] = values[i];
    }
}
