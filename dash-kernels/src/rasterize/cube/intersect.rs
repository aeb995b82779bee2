//! Lists of splats by tile, in drawing order.
//!
//! A unit owns one splat, or one intersection in `finish_lists`. No shared memory, no atomics;
//! integer results, the same on every run.

#[cfg(test)]
mod tests;

use burn_cubecl::tensor::CubeTensor;
use cubecl::prelude::*;

use crate::cube::radix_sort::{DeviceCount, sort_pairs};
use crate::cube::scan::exclusive_scan;
use crate::cube::{Buffer, arg, units};
use crate::splats::{self, N_COLUMNS};

use super::super::RasterizeOptions;
use super::super::tiles::TILE;
use super::capacity;
use super::footprint::{ImageSize, ImageSizeLaunch, footprint, overlaps};

/// Key of a splat that touches no tile: sorts behind every depth.
const BEHIND_ALL: u32 = u32::MAX;

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
    /// Where the intersections of a place in `order` start, and so its gradients among `slots`; their number at the end
    /// `[N + 1]`.
    pub starts: Buffer,
    /// Most intersections that the lists can hold.
    pub capacity: usize,
    /// Rows by tile, in drawing order `[capacity]`.
    pub rows: Buffer,
    /// For each of these where its gradient is kept: the slots of a row follow each other.
    pub slots: Buffer,
    /// Start and end of each tile's list, and the number of intersections at the end `[2 n_tiles + 1]`.
    pub ranges: Buffer,
    /// Tiles per row and column of the image.
    pub tiles: [usize; 2],
}

/// Splats in drawing order, before tiles are listed.
struct DrawingOrder {
    order: Buffer,
    tile_counts: Buffer,
    starts: Buffer,
}

impl DrawingOrder {
    /// The order of `splats [N, C]`. Fills `ranges` with zeros.
    fn new(splats: &CubeTensor, image: ImageSizeLaunch, ranges: &Buffer) -> Self {
        let client = &splats.client;
        let n = splats.meta.shape()[0];
        let new = || Buffer::uninitialised(client, n);
        let (keys, ids, tile_counts) = (new(), new(), new());
        let (count, dim) = units(client, n.max(ranges.len()));
        find_tiles::launch(
            client,
            count,
            dim,
            arg(splats),
            keys.arg(),
            ids.arg(),
            tile_counts.arg(),
            ranges.arg(),
            image,
            n as u32,
            ranges.len() as u32,
        );
        let all = Buffer::from_words(client, &[n as u32]);
        let all = DeviceCount {
            buffer: &all,
            at: 0,
        };
        let (_, order) = sort_pairs(client, keys, ids, &all, u32::BITS);
        let ordered_counts = new();
        let (count, dim) = units(client, n);
        reorder::launch(
            client,
            count,
            dim,
            order.arg(),
            tile_counts.arg(),
            ordered_counts.arg(),
            n as u32,
        );
        Self {
            starts: exclusive_scan(client, &ordered_counts),
            order,
            tile_counts,
        }
    }
}

impl Intersections {
    /// The lists of `splats [N, C]`, with room for as many intersections as earlier calls suggest
    /// unless `capacity` says otherwise.
    pub fn new(splats: &CubeTensor, options: &RasterizeOptions, capacity: Option<usize>) -> Self {
        let client = &splats.client;
        let n = splats.meta.shape()[0];
        let tiles = [options.width.div_ceil(TILE), options.height.div_ceil(TILE)];
        let (width, height) = (options.width as u32, options.height as u32);
        let image = || ImageSizeLaunch::new(width, height, tiles[0] as u32);
        let n_tiles = tiles[0] * tiles[1];
        let ranges = Buffer::uninitialised(client, 2 * n_tiles + 1);
        let drawing = DrawingOrder::new(splats, image(), &ranges);
        let (order, tile_counts, starts) = (drawing.order, drawing.tile_counts, drawing.starts);
        let capacity = capacity.unwrap_or_else(|| capacity::next(client, &starts, n, tiles));

        let new = |length| Buffer::uninitialised(client, length);
        let (tile_keys, slots, slot_rows) = (new(capacity), new(capacity), new(capacity));
        let (count, dim) = units(client, n);
        expand::launch(
            client,
            count,
            dim,
            arg(splats),
            order.arg(),
            tile_counts.arg(),
            starts.arg(),
            ExpandedLaunch::new(tile_keys.arg(), slots.arg(), slot_rows.arg()),
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
        let rows = new(capacity);
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
            n_tiles as u32,
            capacity as u32,
        );
        Self {
            order,
            tile_counts,
            starts,
            capacity,
            rows,
            slots,
            ranges,
            tiles,
        }
    }
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
    splats: &[f32],          // [N, C]
    keys: &mut [u32],        // [N]
    ids: &mut [u32],         // [N]
    tile_counts: &mut [u32], // [N]
    ranges: &mut [u32],      // [n_ranges]
    image: ImageSize,
    n: u32,
    n_ranges: u32,
) {
    let row = ABSOLUTE_POS;
    if row < n_ranges as usize {
        ranges[row] = 0u32;
    }
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
fn reorder(
    order: &[u32],       // [N]
    values: &[u32],      // [N]
    ordered: &mut [u32], // [N]
    n: u32,
) {
    if ABSOLUTE_POS < n as usize {
        ordered[ABSOLUTE_POS] = values[order[ABSOLUTE_POS] as usize];
    }
}

/// The intersections in drawing order, with their tiles, slots and rows.
#[derive(CubeType, CubeLaunch)]
struct Expanded {
    tile_keys: Box<[u32]>, // [capacity]
    slots: Box<[u32]>,     // [capacity]
    slot_rows: Box<[u32]>, // [capacity]
}

#[cube(launch)]
fn expand(
    splats: &[f32],      // [N, C]
    order: &[u32],       // [N]
    tile_counts: &[u32], // [N]
    starts: &[u32],      // [N + 1]
    mut expanded: Expanded,
    image: ImageSize,
    n: u32,
    capacity: u32,
) {
    let place = ABSOLUTE_POS;
    if place < n as usize {
        let row = order[place];
        let mut slot = starts[place];
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
                            let at = slot as usize;
                            expanded.tile_keys[at] = tile_y * image.tile_columns + tile_x;
                            expanded.slots[at] = slot;
                            expanded.slot_rows[at] = row;
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
    tile_keys: &[u32],  // [capacity]
    slots: &[u32],      // [capacity]
    slot_rows: &[u32],  // [capacity]
    starts: &[u32],     // [N + 1]
    rows: &mut [u32],   // [capacity]
    ranges: &mut [u32], // [2 n_tiles + 1]
    n: u32,
    n_tiles: u32,
    capacity: u32,
) {
    let i = ABSOLUTE_POS;
    let total = starts[n as usize];
    if i == 0 {
        ranges[2 * n_tiles as usize] = total;
    }
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
