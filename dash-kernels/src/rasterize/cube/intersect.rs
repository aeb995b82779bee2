//! Which tiles a splat overlaps, and the lists of splats by tile in drawing order.
//!
//! A unit owns one splat, or one intersection in `finish_lists`. No shared memory, no atomics;
//! integer results, the same on every run.

#[cfg(test)]
mod tests;

use burn_cubecl::tensor::CubeTensor;
use cubecl::prelude::*;

use crate::cube::radix_sort::{DeviceCount, sort_pairs};
use crate::cube::scan::exclusive_scan;
use crate::cube::{Buffer, arg, is_finite, units};
use crate::splats::{self, ALPHA_MIN, N_COLUMNS};

use super::super::RasterizeOptions;
use super::super::tiles::TILE;
use super::capacity;

/// Key of a splat that touches no tile: sorts behind every depth.
const BEHIND_ALL: u32 = u32::MAX;

/// Rounding of sigma, as a part of its terms' magnitudes: a tile is kept when rounding might.
const SIGMA_ROUNDING: f32 = 1e-6;
/// The same for the logarithm of the opacity.
const CUT_ROUNDING: f32 = 1e-4;

/// The lists of a frame.
///
/// `find_tiles` counts a splat's tiles and `expand` lists them. Compilers may round the same test differently in the
/// two, where sigma is at the cut-off to the last bit; so `expand` lists as many as were counted, whatever it finds.
#[derive(Debug, Clone)]
pub(super) struct Intersections {
    /// Rows of the splats in drawing order `[N]`.
    pub order: Buffer,
    /// Number of tiles by row `[N]`; zero where nothing is drawn.
    pub tile_counts: Buffer,
    /// Where a row's gradients start among `slots`, by row `[N]`.
    pub firsts: Buffer,
    /// Where the intersections of a place in `order` start, and their number at the end `[N + 1]`.
    pub starts: Buffer,
    /// Most intersections that the lists can hold.
    pub capacity: usize,
    /// Rows by tile, in drawing order `[capacity]`.
    pub rows: Buffer,
    /// For each of these where its gradient is kept: the slots of a row follow each other.
    pub slots: Buffer,
    /// Start and end of each tile's list `[n_tiles, 2]`.
    pub ranges: Buffer,
    /// Tiles per row and column of the image.
    pub tiles: [usize; 2],
}

impl Intersections {
    /// The lists of `splats [N, C]`, with room for as many intersections as earlier calls suggest
    /// unless `capacity` says otherwise.
    pub fn new(splats: &CubeTensor, options: &RasterizeOptions, capacity: Option<usize>) -> Self {
        let client = &splats.client;
        let n = splats.meta.shape()[0];
        let tiles = [options.width.div_ceil(TILE), options.height.div_ceil(TILE)];
        let n_tiles = tiles[0] * tiles[1];
        let new = |length| Buffer::uninitialised(client, length);
        let image =
            || ImageSizeLaunch::new(options.width as u32, options.height as u32, tiles[0] as u32);

        let (keys, ids, tile_counts) = (new(n), new(n), new(n));
        let (count, dim) = units(client, n);
        find_tiles::launch(
            client,
            count.clone(),
            dim,
            arg(splats),
            keys.arg(),
            ids.arg(),
            tile_counts.arg(),
            image(),
            n as u32,
        );
        let all = Buffer::from_words(client, &[n as u32]);
        let all = DeviceCount {
            buffer: &all,
            at: 0,
        };
        let (_, order) = sort_pairs(client, keys, ids, &all, u32::BITS);
        let ordered_counts = new(n);
        reorder::launch(
            client,
            count.clone(),
            dim,
            order.arg(),
            tile_counts.arg(),
            ordered_counts.arg(),
            n as u32,
        );
        let starts = exclusive_scan(client, &ordered_counts);
        let capacity = capacity.unwrap_or_else(|| capacity::next(client, &starts, n, tiles));

        let firsts = new(n);
        let (tile_keys, slots, slot_rows) = (new(capacity), new(capacity), new(capacity));
        expand::launch(
            client,
            count,
            dim,
            arg(splats),
            order.arg(),
            tile_counts.arg(),
            starts.arg(),
            firsts.arg(),
            tile_keys.arg(),
            slots.arg(),
            slot_rows.arg(),
            image(),
            n as u32,
            capacity as u32,
        );
        let total = DeviceCount {
            buffer: &starts,
            at: n,
        };
        let key_bits = (n_tiles as u32).next_power_of_two().trailing_zeros().max(1);
        let (tile_keys, slots) = sort_pairs(client, tile_keys, slots, &total, key_bits);
        let (rows, ranges) = (new(capacity), Buffer::zeros(client, 2 * n_tiles));
        let (count, dim) = units(client, capacity);
        finish_lists::launch(
            client,
            count,
            dim,
            tile_keys.arg(),
            slots.arg(),
            slot_rows.arg(),
            starts.arg(),
            rows.arg(),
            ranges.arg(),
            n as u32,
            capacity as u32,
        );
        Self {
            order,
            tile_counts,
            firsts,
            starts,
            capacity,
            rows,
            slots,
            ranges,
            tiles,
        }
    }
}

#[derive(CubeType, CubeLaunch, Clone, Copy)]
pub(super) struct ImageSize {
    width: u32,
    height: u32,
    tile_columns: u32,
}

/// A splat's place in the image, as far as tiles are concerned.
#[derive(CubeType, Clone, Copy)]
struct Footprint {
    x: f32,
    y: f32,
    a: f32,
    b: f32,
    c: f32,
    /// Sigma beyond which alpha is under its minimum.
    cut: f32,
    /// Tiles touched by the box: first and one past the last.
    tile_x0: u32,
    tile_x1: u32,
    tile_y0: u32,
    tile_y1: u32,
}

/// Pixels of `0..size` whose centres (at +0.5) lie within `radius` of `centre`.
#[cube]
fn pixel_range(centre: f32, radius: f32, size: u32) -> (u32, u32) {
    let size = f32::cast_from(size);
    let from = f32::clamp((centre - radius - 0.5f32).ceil(), 0.0f32, size);
    let to = f32::clamp((centre + radius - 0.5f32).floor() + 1.0f32, 0.0f32, size);
    (u32::cast_from(from), u32::cast_from(to))
}

/// The footprint of a row; without tiles when nothing of it is drawn.
#[cube]
fn footprint(splats: &[f32], row: usize, image: &ImageSize) -> Footprint {
    let at = row * N_COLUMNS;
    let mut finite = true;
    #[unroll]
    for column in 0..N_COLUMNS {
        finite = finite && is_finite(splats[at + column]);
    }
    let radius_x = splats[at + splats::RADIUS_X];
    let radius_y = splats[at + splats::RADIUS_Y];
    let opacity = splats[at + splats::OPACITY];
    let mut found = Footprint {
        x: splats[at + splats::MEAN_X],
        y: splats[at + splats::MEAN_Y],
        a: splats[at + splats::CONIC_A],
        b: splats[at + splats::CONIC_B],
        c: splats[at + splats::CONIC_C],
        cut: 0.0f32,
        tile_x0: 0u32,
        tile_x1: 0u32,
        tile_y0: 0u32,
        tile_y1: 0u32,
    };
    let alpha_min = comptime!(ALPHA_MIN as f32);
    if finite && radius_x > 0.0f32 && radius_y > 0.0f32 && opacity >= alpha_min {
        let (x0, x1) = pixel_range(found.x, radius_x, image.width);
        let (y0, y1) = pixel_range(found.y, radius_y, image.height);
        if x0 < x1 && y0 < y1 {
            let tile = comptime!(TILE as u32);
            found.cut = (opacity / alpha_min).ln() + CUT_ROUNDING;
            found.tile_x0 = x0 / tile;
            found.tile_x1 = x1.div_ceil(tile);
            found.tile_y0 = y0 / tile;
            found.tile_y1 = y1.div_ceil(tile);
        }
    }
    found
}

/// Sigma at the offset, and how far it may be off.
#[cube]
fn sigma(splat: &Footprint, dx: f32, dy: f32) -> (f32, f32) {
    let squares = 0.5f32 * (splat.a * dx * dx + splat.c * dy * dy);
    let mixed = splat.b * dx * dy;
    (squares + mixed, (squares + mixed.abs()) * SIGMA_ROUNDING)
}

/// Whether the splat reaches any pixel's centre of the tile: the smallest sigma over the rectangle
/// of these is that of the centre or lies on an edge that faces it.
#[cube]
fn overlaps(splat: &Footprint, tile_x: u32, tile_y: u32, image: &ImageSize) -> bool {
    let size = comptime!(TILE as f32);
    let left = f32::cast_from(tile_x) * size + 0.5f32;
    let top = f32::cast_from(tile_y) * size + 0.5f32;
    let right = f32::min(left + (size - 1.0f32), f32::cast_from(image.width) - 0.5f32);
    let bottom = f32::min(top + (size - 1.0f32), f32::cast_from(image.height) - 0.5f32);
    let x = f32::clamp(splat.x, left, right);
    let y = f32::clamp(splat.y, top, bottom);
    let mut reached = x == splat.x && y == splat.y;
    // Not an ellipse: nothing is known of where it ends.
    if !(splat.a > 0.0f32 && splat.c > 0.0f32 && splat.a * splat.c > splat.b * splat.b) {
        reached = true;
    }
    if x != splat.x {
        let dx = splat.x - x;
        let best = f32::clamp(splat.y + splat.b / splat.c * dx, top, bottom);
        let (value, rounding) = sigma(splat, dx, splat.y - best);
        reached = reached || value - rounding <= splat.cut;
    }
    if y != splat.y {
        let dy = splat.y - y;
        let best = f32::clamp(splat.x + splat.b / splat.a * dy, left, right);
        let (value, rounding) = sigma(splat, splat.x - best, dy);
        reached = reached || value - rounding <= splat.cut;
    }
    reached
}

/// Bits that compare as unsigned integers like the finite float does.
#[cube]
fn ascending_bits(value: f32) -> u32 {
    let bits = u32::reinterpret(value);
    // -0 must not come before 0.
    let bits = select(bits == 0x8000_0000u32, 0u32, bits);
    let positive = (bits >> 31u32) == 0u32;
    select(positive, bits | 0x8000_0000u32, !bits)
}

#[cube(launch)]
fn find_tiles(
    splats: &[f32],
    keys: &mut [u32],
    ids: &mut [u32],
    tile_counts: &mut [u32],
    image: ImageSize,
    n: u32,
) {
    let row = ABSOLUTE_POS;
    if row < n as usize {
        let splat = footprint(splats, row, &image);
        let mut found = 0u32;
        for tile_y in splat.tile_y0..splat.tile_y1 {
            for tile_x in splat.tile_x0..splat.tile_x1 {
                if overlaps(&splat, tile_x, tile_y, &image) {
                    found += 1u32;
                }
            }
        }
        let key = ascending_bits(splats[row * N_COLUMNS + splats::DEPTH]);
        keys[row] = select(found > 0u32, key, BEHIND_ALL);
        ids[row] = row as u32;
        tile_counts[row] = found;
    }
}

#[cube(launch)]
fn reorder(order: &[u32], values: &[u32], ordered: &mut [u32], n: u32) {
    if ABSOLUTE_POS < n as usize {
        ordered[ABSOLUTE_POS] = values[order[ABSOLUTE_POS] as usize];
    }
}

#[cube(launch)]
fn expand(
    splats: &[f32],
    order: &[u32],
    tile_counts: &[u32],
    starts: &[u32],
    firsts: &mut [u32],
    tile_keys: &mut [u32],
    slots: &mut [u32],
    slot_rows: &mut [u32],
    image: ImageSize,
    n: u32,
    capacity: u32,
) {
    let place = ABSOLUTE_POS;
    if place < n as usize {
        let row = order[place];
        let mut slot = starts[place];
        firsts[row as usize] = slot;
        let mut to_list = tile_counts[row as usize];
        if to_list > 0u32 {
            let splat = footprint(splats, row as usize, &image);
            let mut left = (splat.tile_y1 - splat.tile_y0) * (splat.tile_x1 - splat.tile_x0);
            for tile_y in splat.tile_y0..splat.tile_y1 {
                for tile_x in splat.tile_x0..splat.tile_x1 {
                    let found = overlaps(&splat, tile_x, tile_y, &image);
                    // A tile too many shows nothing of the splat.
                    if to_list > 0u32 && (found || left <= to_list) {
                        if slot < capacity {
                            tile_keys[slot as usize] = tile_y * image.tile_columns + tile_x;
                            slots[slot as usize] = slot;
                            slot_rows[slot as usize] = row;
                        }
                        slot += 1u32;
                        to_list -= 1u32;
                    }
                    left -= 1u32;
                }
            }
        }
    }
}

#[cube(launch)]
fn finish_lists(
    tile_keys: &[u32],
    slots: &[u32],
    slot_rows: &[u32],
    starts: &[u32],
    rows: &mut [u32],
    ranges: &mut [u32],
    n: u32,
    capacity: u32,
) {
    let i = ABSOLUTE_POS;
    let total = starts[n as usize];
    // Lists that don't hold everything are not used.
    if total <= capacity && i < total as usize {
        rows[i] = slot_rows[slots[i] as usize];
        let tile = tile_keys[i] as usize;
        let mut first = i == 0;
        if i > 0 {
            first = tile_keys[i - 1] as usize != tile;
        }
        if first {
            ranges[2 * tile] = i as u32;
        }
        let mut last = i + 1 == total as usize;
        if i + 1 < total as usize {
            last = tile_keys[i + 1] as usize != tile;
        }
        if last {
            ranges[2 * tile + 1] = i as u32 + 1u32;
        }
    }
}
