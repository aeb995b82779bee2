//! Gradient of the blending, replayed back to front.
//!
//! As in the forward pass a cube owns a tile and a unit a run of pixels. A unit sums a splat's gradient over its
//! pixels. The sums of `BATCH` splats are added up over the cube in shared memory (at most 15.5 KiB), one unit for each
//! value, in a fixed order, and written to the slot of the (tile, splat) intersection. `sum_slots` then adds up each
//! splat's slots, which follow each other. Where the device can't bind as many slots as there may be intersections,
//! both kernels go over them in windows. No atomics, the same bits on every run. When the lists overflowed there are no
//! slots, and the cubes add to the splats' gradients atomically.

use burn_cubecl::tensor::CubeTensor;
use cubecl::prelude::*;

use crate::cube::atomic::{ExchangeAdd, FloatAdd, NativeAdd};
use crate::cube::{Buffer, arg, calculate_cubes};
use crate::splats::{self, ALPHA_MAX, N_COLUMNS, N_DIFFERENTIABLE};

use super::super::tiles::TILE;
use super::super::{CHANNEL_ALPHA, CHANNEL_DEPTH, N_CHANNELS};
use super::Saved;
use super::moments::Moments;
use super::slots::{Window, WindowLaunch, clear_slots, sum_window};
use super::tile::{
    Frame, Lists, Splat, TileList, alpha_at, first_pixel, frame, gradient_column, lists_arg,
    middle, read_splat, tile_list,
};

/// Splats whose gradients are added up together; a round of the loop over a tile's list, whose
/// inner loops are unrolled for the reason that [`PER_ROUND`](super::blend) has.
const BATCH: usize = 6;
const BATCH_VALUES: usize = BATCH * N_DIFFERENTIABLE;

/// Adds the gradient to `v_splats [N, C]`, which holds zeros.
pub(super) fn blend_vjp(saved: &Saved, v_image: &CubeTensor, v_splats: &CubeTensor) {
    if saved.tuning.native_add {
        launch_vjp::<NativeAdd>(saved, v_image, v_splats);
    } else {
        launch_vjp::<ExchangeAdd>(saved, v_image, v_splats);
    }
}

fn launch_vjp<A: FloatAdd>(saved: &Saved, v_image: &CubeTensor, v_splats: &CubeTensor) {
    let client = &v_image.client;
    let lists = &saved.intersections;
    let slots_per_window = saved.tuning.slots_per_window.min(lists.capacity);
    let v_slots = Buffer::uninitialised(client, slots_per_window * N_DIFFERENTIABLE);
    for first in (0..lists.capacity).step_by(slots_per_window) {
        let window = || {
            let length = slots_per_window.min(lists.capacity - first);
            let is_last = first + length == lists.capacity;
            WindowLaunch::new(first as u32, length as u32, u32::from(is_last))
        };
        blend_window::<A>(saved, v_image, v_splats, &v_slots, window());
        sum_window(saved, v_splats, &v_slots, window());
    }
}

fn blend_window<A: FloatAdd>(
    saved: &Saved,
    v_image: &CubeTensor,
    v_splats: &CubeTensor,
    v_slots: &Buffer,
    window: WindowLaunch,
) {
    let client = &v_image.client;
    let lists = &saved.intersections;
    blend_tiles_vjp::launch::<A>(
        client,
        calculate_cubes(client, lists.tiles[0] * lists.tiles[1]),
        CubeDim::new_1d(saved.tuning.units as u32),
        arg(&saved.splats),
        lists_arg(lists),
        lists.slots.arg(),
        PicturesLaunch::new(saved.pixels.values.arg(), arg(v_image)),
        v_slots.arg(),
        arg(v_splats),
        frame(lists, &saved.options, &saved.splats),
        window,
        TILE * TILE / saved.tuning.units,
    );
}

/// One past the place of the last splat that any unit of the cube has drawn; every unit has to call it.
#[cube]
fn end_of_drawn(
    pixels: &ReplayedPixels,
    #[comptime] per_unit: usize,
    #[comptime] units: usize,
) -> u32 {
    let mut own = 0u32;
    #[unroll]
    for k in 0..per_unit {
        own = u32::max(own, pixels.last[k]);
    }
    let mut values = Shared::<[u32]>::new_slice(units);
    values[UNIT_POS as usize] = own;
    sync_cube();
    let mut largest = 0u32;
    for unit in 0..units {
        largest = u32::max(largest, values[unit]);
    }
    largest
}

/// What is drawn, as the forward pass left it, and its gradient.
#[derive(CubeType, CubeLaunch)]
struct Pictures {
    forward: Box<[u32]>, // [H, W, 2]
    v_image: Box<[f32]>, // [H, W, 5]
}

/// A unit's pixels while splats are taken off them, back to front.
#[derive(CubeType)]
struct ReplayedPixels {
    /// Transmittance behind the splats still to come.
    transmittance: Array<f32>, // [per_unit]
    /// Colour and depth accumulated behind those splats, times their gradients.
    accumulated: Array<f32>, // [per_unit]
    v_red: Array<f32>,   // [per_unit]
    v_green: Array<f32>, // [per_unit]
    v_blue: Array<f32>,  // [per_unit]
    v_depth: Array<f32>, // [per_unit]
    last: Array<u32>,    // [per_unit]
}

#[cube]
fn read_pixels(
    pictures: &Pictures,
    column: u32,
    first_row: u32,
    frame: &Frame,
    #[comptime] per_unit: usize,
) -> ReplayedPixels {
    let mut pixels = ReplayedPixels {
        transmittance: Array::<f32>::new(per_unit),
        accumulated: Array::<f32>::new(per_unit),
        v_red: Array::<f32>::new(per_unit),
        v_green: Array::<f32>::new(per_unit),
        v_blue: Array::<f32>::new(per_unit),
        v_depth: Array::<f32>::new(per_unit),
        last: Array::<u32>::new(per_unit),
    };
    #[unroll]
    for k in 0..per_unit {
        pixels.transmittance[k] = 1.0f32;
        pixels.accumulated[k] = 0.0f32;
        pixels.v_red[k] = 0.0f32;
        pixels.v_green[k] = 0.0f32;
        pixels.v_blue[k] = 0.0f32;
        pixels.v_depth[k] = 0.0f32;
        pixels.last[k] = 0u32;
        let row = first_row + comptime!(k as u32);
        if column < frame.width && row < frame.height {
            let pixel = (row * frame.width + column) as usize;
            let at = pixel * N_CHANNELS;
            let (red, green, blue) = (
                pictures.v_image[at],
                pictures.v_image[at + 1],
                pictures.v_image[at + 2],
            );
            pixels.v_red[k] = red;
            pixels.v_green[k] = green;
            pixels.v_blue[k] = blue;
            pixels.v_depth[k] = pictures.v_image[at + CHANNEL_DEPTH];
            // Behind all splats the background adds colour and takes away alpha.
            let background = frame.red * red + frame.green * green + frame.blue * blue;
            let transmittance = f32::reinterpret(pictures.forward[2 * pixel]);
            pixels.transmittance[k] = transmittance;
            pixels.accumulated[k] =
                transmittance * (background - pictures.v_image[at + CHANNEL_ALPHA]);
            pixels.last[k] = pictures.forward[2 * pixel + 1];
        }
    }
    pixels
}

/// Takes a splat off the unit's pixels, the first one centred at `(x, y)`, from the tile's
/// middle where it is a needle: its gradient, summed over them.
#[cube]
fn replay(
    pixels: &mut ReplayedPixels,
    splat: &Splat,
    place: usize,
    x: f32,
    y: f32,
    #[comptime] per_unit: usize,
    #[comptime] is_needle: bool,
) -> Array<f32> {
    let mut v = no_gradient();
    let dx = splat.x - x;
    let mut sums = Moments::zero();
    #[unroll]
    for k in 0..per_unit {
        let dy = splat.y - (y + comptime!(k as f32));
        let raw = alpha_at(splat, dx, dy, is_needle);
        if raw > 0.0f32 && (place as u32) < pixels.last[k] {
            let alpha = f32::min(raw, comptime!(ALPHA_MAX as f32));
            let remains = 1.0f32 - alpha;
            let before = pixels.transmittance[k] / remains;
            let visibility = alpha * before;
            let v_visibility = splat.red * pixels.v_red[k]
                + splat.green * pixels.v_green[k]
                + splat.blue * pixels.v_blue[k]
                + splat.depth * pixels.v_depth[k];
            v[splats::RED] += visibility * pixels.v_red[k];
            v[splats::GREEN] += visibility * pixels.v_green[k];
            v[splats::BLUE] += visibility * pixels.v_blue[k];
            v[splats::DEPTH] += visibility * pixels.v_depth[k];
            let v_alpha = before * v_visibility - pixels.accumulated[k] / remains;
            pixels.accumulated[k] += visibility * v_visibility;
            pixels.transmittance[k] = before;
            if raw <= comptime!(ALPHA_MAX as f32) {
                let v_own = -(alpha * v_alpha);
                if comptime!(is_needle) {
                    sums.add_needle(v_own, splat, dx, dy);
                } else {
                    sums.add_conic(v_own, dy);
                }
            }
        }
    }
    if comptime!(is_needle) {
        sums.write_needle(&mut v, splat);
    } else {
        sums.write_conic(&mut v, splat, dx);
    }
    let v_sigma = sums.v;
    // Opacity is positive wherever anything was drawn.
    v[splats::OPACITY] = select(v_sigma != 0.0f32, -v_sigma / splat.opacity, 0.0f32);
    v
}

#[cube]
fn no_gradient() -> Array<f32> {
    let mut v = Array::<f32>::new(N_DIFFERENTIABLE);
    #[unroll]
    for value in 0..N_DIFFERENTIABLE {
        v[value] = 0.0f32;
    }
    v
}

/// Writes a unit's sums for a splat, which start at `at`.
#[cube]
fn store(
    sums: &mut Shared<[f32]>, // [BATCH_VALUES, units + 1]
    v: &Array<f32>,           // [N_DIFFERENTIABLE]
    at: usize,
    #[comptime] stride: usize,
) {
    #[unroll]
    for value in 0..N_DIFFERENTIABLE {
        sums[at + comptime!(value * stride)] = v[value];
    }
}

/// Adds up the units' sums of the last splats of a list, a batch of them; a unit owns a value.
#[cube]
fn add_up_batch<A: FloatAdd>(
    splats: &[f32],               // [N, C]
    sums: &Shared<[f32]>,         // [BATCH_VALUES, units + 1]
    v_slots: &mut [f32],          // [slots per window, N_DIFFERENTIABLE]
    v_splats: &[Atomic<A::Word>], // [N, C]
    lists: &Lists,
    slots: &[u32], // [capacity]
    list: &TileList,
    window: &Window,
    #[comptime] units: usize,
) {
    #[unroll]
    for turn in 0..comptime!(BATCH_VALUES.div_ceil(units)) {
        let own = UNIT_POS as usize + comptime!(turn * units);
        let step = own / N_DIFFERENTIABLE;
        let value = own % N_DIFFERENTIABLE;
        if own < BATCH_VALUES && list.end > list.start + step {
            let mut sum = 0.0f32;
            #[unroll]
            for other in 0..units {
                sum += sums[own * comptime!(units + 1) + other];
            }
            let place = list.end - step - 1;
            if list.overflowed {
                // Of all splats few reach the tile, and all tiles wait for each other here.
                if sum != 0.0f32 {
                    let at = lists.order[place] as usize * N_COLUMNS;
                    let column = gradient_column(value, splats[at + splats::ALONG] > 0.0f32);
                    A::add(&v_splats[at + column], sum);
                }
            } else {
                let slot = slots[place] - window.first;
                if slot < window.length {
                    v_slots[slot as usize * N_DIFFERENTIABLE + value] = sum;
                }
            }
        }
    }
}

#[cube(launch)]
fn blend_tiles_vjp<A: FloatAdd>(
    splats: &[f32], // [N, C]
    lists: Lists,
    slots: &[u32], // [capacity]
    pictures: Pictures,
    v_slots: &mut [f32],          // [slots per window, N_DIFFERENTIABLE]
    v_splats: &[Atomic<A::Word>], // [N, C]
    frame: Frame,
    window: Window,
    #[comptime] per_unit: usize,
) {
    let units = comptime!(TILE * TILE / per_unit);
    // One more than there are units, so that units that walk along different values meet different
    // banks.
    let stride = comptime!(units + 1);
    let tile = CUBE_POS;
    if tile >= (frame.tile_columns * frame.tile_rows) as usize {
        terminate!();
    }
    let list = tile_list(tile, &lists, &frame);
    // Without slots the first window has done it all.
    if list.overflowed && window.first > 0u32 {
        terminate!();
    }
    let (column, first_row) = first_pixel(tile, &frame, per_unit);
    let mut pixels = read_pixels(&pictures, column, first_row, &frame, per_unit);
    let x = f32::cast_from(column) + 0.5f32;
    let y = f32::cast_from(first_row) + 0.5f32;
    let end = end_of_drawn(&pixels, per_unit, units) as usize;
    let middle = middle(tile, &frame);
    clear_slots(v_slots, &list, slots, end, &window);

    let mut sums = Shared::<[f32]>::new_slice(comptime!(BATCH_VALUES * stride));
    let mut batch_end = end;
    while batch_end > list.start {
        #[unroll]
        for step in 0..BATCH {
            if batch_end > list.start + step {
                let place = batch_end - step - 1;
                let splat = read_splat(splats, place, &list, &lists, middle);
                let at = step * N_DIFFERENTIABLE * stride + UNIT_POS as usize;
                if splat.along > 0.0f32 {
                    let (x, y) = (x - middle.0, y - middle.1);
                    let v = replay(&mut pixels, &splat, place, x, y, per_unit, true);
                    store(&mut sums, &v, at, stride);
                } else {
                    let v = replay(&mut pixels, &splat, place, x, y, per_unit, false);
                    store(&mut sums, &v, at, stride);
                }
            }
        }
        // A value is added up by one unit after all units have summed theirs.
        sync_cube();
        let unread = TileList {
            start: list.start,
            end: batch_end,
            overflowed: list.overflowed,
        };
        add_up_batch::<A>(
            splats, &sums, v_slots, v_splats, &lists, slots, &unread, &window, units,
        );
        // All are added up before the next batch overwrites them.
        sync_cube();
        batch_end -= usize::min(BATCH, batch_end);
    }
}
