//! Blending of tiles, front to back.
//!
//! A cube owns a tile: as many units as a subgroup has, within bounds, each with a run of pixels
//! below each other. Units go through the tile's list on their own: neighbours read the same splat,
//! so the cache does what staging in shared memory would, without barriers. No shared memory, no
//! atomics; deterministic.

use burn_cubecl::tensor::CubeTensor;
use cubecl::prelude::*;

use crate::cube::{Buffer, arg, calculate_cubes, finite_or_zero};
use crate::splats::{ALPHA_MAX, TRANSMITTANCE_STOP};

use super::super::tiles::TILE;
use super::super::{CHANNEL_ALPHA, CHANNEL_DEPTH, N_CHANNELS, RasterizeOptions};
use super::intersect::Intersections;
use super::tile::{
    Frame, Lists, Splat, alpha_at, first_pixel, frame, lists_arg, middle, read_splat, tile_list,
};

/// Units of a cube: a wide subgroup owns a tile alone, so that its barriers cost nothing; narrow
/// subgroups, as those of CPUs, exchange less when a unit sums more pixels itself.
pub(super) fn units_per_tile(client: &Client) -> usize {
    let subgroup = client.properties().hardware.plane_size_max as usize;
    subgroup.next_power_of_two().clamp(16, 64)
}

/// Splats drawn in a round of the loop over a tile's list. Mesa's software driver ends loops after
/// 65,535 rounds in all, so that it draws the first 262,140 splats of a tile.
const PER_ROUND: usize = 4;

/// What the forward pass leaves of every pixel for the backward pass.
#[derive(Debug, Clone)]
pub(super) struct Pixels {
    /// Bits of the transmittance behind the last splat, and one past the last splat drawn, as a place in the list
    /// `[H, W, 2]`.
    pub values: Buffer,
}

/// Draws the image.
pub(super) fn blend(
    splats: &CubeTensor,
    lists: &Intersections,
    options: &RasterizeOptions,
    image: &CubeTensor,
    units: usize,
) -> Pixels {
    let client = &splats.client;
    let n_pixels = options.width * options.height;
    let pixels = Pixels {
        values: Buffer::uninitialised(client, 2 * n_pixels),
    };
    blend_tiles::launch(
        client,
        calculate_cubes(client, lists.tiles[0] * lists.tiles[1]),
        CubeDim::new_1d(units as u32),
        arg(splats),
        lists_arg(lists),
        arg(image),
        pixels.values.arg(),
        frame(lists, options, splats),
        TILE * TILE / units,
    );
    pixels
}

/// A unit's pixels while splats are blended over them.
#[derive(CubeType)]
struct BlendedPixels {
    /// Transmittance behind the splats so far.
    transmittance: Array<f32>, // [per_unit]
    /// Accumulated colour.
    red: Array<f32>, // [per_unit]
    green: Array<f32>, // [per_unit]
    blue: Array<f32>,  // [per_unit]
    /// Accumulated depth.
    depth: Array<f32>, // [per_unit]
    /// One past the place of the last splat blended.
    last: Array<u32>, // [per_unit]
    /// Whether the pixel is in the image and not finished.
    live: Array<bool>, // [per_unit]
}

#[cube]
fn empty_pixels(
    column: u32,
    first_row: u32,
    frame: &Frame,
    #[comptime] per_unit: usize,
) -> BlendedPixels {
    let mut pixels = BlendedPixels {
        transmittance: Array::<f32>::new(per_unit),
        red: Array::<f32>::new(per_unit),
        green: Array::<f32>::new(per_unit),
        blue: Array::<f32>::new(per_unit),
        depth: Array::<f32>::new(per_unit),
        last: Array::<u32>::new(per_unit),
        live: Array::<bool>::new(per_unit),
    };
    #[unroll]
    for k in 0..per_unit {
        pixels.transmittance[k] = 1.0f32;
        pixels.red[k] = 0.0f32;
        pixels.green[k] = 0.0f32;
        pixels.blue[k] = 0.0f32;
        pixels.depth[k] = 0.0f32;
        pixels.last[k] = 0u32;
        pixels.live[k] = column < frame.width && first_row + comptime!(k as u32) < frame.height;
    }
    pixels
}

/// Blends a splat over the unit's pixels, the first one centred at `(x, y)`, from the tile's
/// middle where it is a needle; whether any of them still goes on.
#[cube]
fn blend_splat(
    pixels: &mut BlendedPixels,
    splat: &Splat,
    place: usize,
    x: f32,
    y: f32,
    #[comptime] per_unit: usize,
    #[comptime] is_needle: bool,
) -> bool {
    let dx = splat.x - x;
    let mut any_live = false;
    #[unroll]
    for k in 0..per_unit {
        let dy = splat.y - (y + comptime!(k as f32));
        let alpha = f32::min(
            alpha_at(splat, dx, dy, is_needle),
            comptime!(ALPHA_MAX as f32),
        );
        let next = pixels.transmittance[k] * (1.0f32 - alpha);
        if alpha > 0.0f32 && pixels.live[k] {
            if next < comptime!(TRANSMITTANCE_STOP as f32) {
                pixels.live[k] = false;
            } else {
                let visibility = alpha * pixels.transmittance[k];
                pixels.red[k] += visibility * splat.red;
                pixels.green[k] += visibility * splat.green;
                pixels.blue[k] += visibility * splat.blue;
                pixels.depth[k] += visibility * splat.depth;
                pixels.transmittance[k] = next;
                pixels.last[k] = place as u32 + 1u32;
            }
        }
        any_live = any_live || pixels.live[k];
    }
    any_live
}

#[cube(launch)]
fn blend_tiles(
    splats: &[f32], // [N, C]
    lists: Lists,
    image: &mut [f32],   // [H, W, 5]
    forward: &mut [u32], // [H, W, 2]
    frame: Frame,
    #[comptime] per_unit: usize,
) {
    let tile = CUBE_POS;
    if tile >= (frame.tile_columns * frame.tile_rows) as usize {
        terminate!();
    }
    let list = tile_list(tile, &lists, &frame);
    let (column, first_row) = first_pixel(tile, &frame, per_unit);
    let x = f32::cast_from(column) + 0.5f32;
    let y = f32::cast_from(first_row) + 0.5f32;
    let mut pixels = empty_pixels(column, first_row, &frame, per_unit);
    let middle = middle(tile, &frame);
    let (near_x, near_y) = (x - middle.0, y - middle.1);
    let mut place = list.start;
    let mut any_live = pixels.live[0];
    while place < list.end && any_live {
        #[unroll]
        for step in 0..PER_ROUND {
            if place + step < list.end {
                let at = place + step;
                let splat = read_splat(splats, at, &list, &lists, middle);
                if splat.along > 0.0f32 {
                    any_live = blend_splat(&mut pixels, &splat, at, near_x, near_y, per_unit, true);
                } else {
                    any_live = blend_splat(&mut pixels, &splat, at, x, y, per_unit, false);
                }
            }
        }
        place += PER_ROUND;
    }
    #[unroll]
    for k in 0..per_unit {
        let row = first_row + comptime!(k as u32);
        if column < frame.width && row < frame.height {
            let pixel = (row * frame.width + column) as usize;
            let at = pixel * N_CHANNELS;
            let transmittance = pixels.transmittance[k];
            image[at] = finite_or_zero(pixels.red[k] + transmittance * frame.red);
            image[at + 1] = finite_or_zero(pixels.green[k] + transmittance * frame.green);
            image[at + 2] = finite_or_zero(pixels.blue[k] + transmittance * frame.blue);
            image[at + CHANNEL_ALPHA] = 1.0f32 - transmittance;
            image[at + CHANNEL_DEPTH] = finite_or_zero(pixels.depth[k]);
            forward[2 * pixel] = u32::reinterpret(transmittance);
            forward[2 * pixel + 1] = pixels.last[k];
        }
    }
}
