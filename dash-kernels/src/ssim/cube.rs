//! Structural similarity on CubeCL devices.
//!
//! A cube of 256 units owns a tile of 16 x 16 pixels of one channel. Moments are blurred along rows
//! and then along columns in shared memory (forward 11.8 KiB, backward 24.8 KiB), a value by a unit, neighbours by
//! neighbours; a barrier separates the steps. No atomics; deterministic.
//!
//! So much shared memory lets few cubes run at once, so a cube has as many units as every device can have.
//!
//! Variances are differences of large numbers where an image is flat. The CPU forms them in f64;
//! here both images are first shifted by their values in the middle of the tile, which changes
//! no variance and leaves little to cancel.

pub(crate) mod loss;
mod tile;

use burn_cubecl::CubeBackend;
use burn_cubecl::tensor::CubeTensor;
use cubecl::prelude::*;

use crate::cube::{arg, calculate_cubes, contiguous, finite_or_zero, is_finite, uninitialised};

use super::window::RADIUS;
use super::{Ssim, SsimVjp};
use tile::{
    Frame, FrameLaunch, Tile, blur_moments_along_rows, blurred_from, gradient_at, load,
    moment_gradients, own_tile, pixel, terms,
};

/// Side of a tile in pixels.
const TILE: usize = 16;
/// Of a cube.
const UNITS: usize = 256;
/// Side of the region that the moments of a tile reach into, and its moments' moments.
const REACH: usize = TILE + 2 * RADIUS;
const FAR_REACH: usize = TILE + 4 * RADIUS;

/// Pixels count as no further from zero than this, so that their squares stay finite.
const LARGEST: f32 = 1e9;

impl Ssim for CubeBackend {
    fn ssim(x: CubeTensor, y: CubeTensor) -> CubeTensor {
        let (x, y) = (contiguous(x), contiguous(y));
        let shape = sizes(&x);
        let out = uninitialised(&x, shape);
        ssim_kernel::launch(
            &x.client,
            calculate_cubes(&x.client, n_cubes(shape)),
            CubeDim::new_1d(UNITS as u32),
            arg(&x),
            arg(&y),
            arg(&out),
            frame(shape),
        );
        out
    }
}

impl SsimVjp for CubeBackend {
    fn ssim_vjp(
        x: CubeTensor,
        y: CubeTensor,
        v_out: CubeTensor,
        [needs_x, needs_y]: [bool; 2],
    ) -> [Option<CubeTensor>; 2] {
        let [x, y, v_out] = [x, y, v_out].map(contiguous);
        let shape = sizes(&x);
        let gradient = |own: &CubeTensor, other: &CubeTensor| {
            let v_own = uninitialised(own, shape);
            ssim_vjp_kernel::launch(
                &own.client,
                calculate_cubes(&own.client, n_cubes(shape)),
                CubeDim::new_1d(UNITS as u32),
                arg(own),
                arg(other),
                arg(&v_out),
                arg(&v_own),
                frame(shape),
            );
            v_own
        };
        [
            needs_x.then(|| gradient(&x, &y)),
            needs_y.then(|| gradient(&y, &x)),
        ]
    }
}

fn sizes(image: &CubeTensor) -> [usize; 3] {
    crate::host::dims::<3>(image)
}

fn n_cubes([height, width, channels]: [usize; 3]) -> usize {
    height.div_ceil(TILE) * width.div_ceil(TILE) * channels
}

fn frame([height, width, channels]: [usize; 3]) -> FrameLaunch {
    FrameLaunch::new(
        height as u32,
        width as u32,
        channels as u32,
        channels as u32,
    )
}

#[cube(launch)]
fn ssim_kernel(
    x: &[f32],       // [H, W, C]
    y: &[f32],       // [H, W, C]
    out: &mut [f32], // [H, W, C]
    frame: Frame,
) {
    let tile = own_tile(x, y, &frame);
    let mut pixels = Shared::<[f32]>::new_slice(comptime!(2 * REACH * REACH));
    let mut blurred = Shared::<[f32]>::new_slice(comptime!(4 * REACH * TILE));
    load(x, y, &mut pixels, &tile, &frame, RADIUS, REACH);
    // Neighbours' pixels are blurred.
    sync_cube();
    blur_moments_along_rows(&pixels, &mut blurred, REACH);
    // Neighbours' rows are blurred.
    sync_cube();
    let plane = comptime!(REACH * TILE);
    let mut item = UNIT_POS as usize;
    while item < comptime!(TILE * TILE) {
        let row = tile.top as u32 + (item / TILE) as u32;
        let column = tile.left as u32 + (item % TILE) as u32;
        if row < frame.height && column < frame.width {
            let t = terms(
                blurred_from(&blurred, item, TILE),
                blurred_from(&blurred, item + plane, TILE),
                blurred_from(&blurred, item + comptime!(2 * plane), TILE),
                blurred_from(&blurred, item + comptime!(3 * plane), TILE),
                &tile,
            );
            let luminance = t.luminance / t.luminance_norm;
            let contrast = t.contrast / t.contrast_norm;
            let at = (row * frame.width + column) * frame.channels + tile.channel;
            out[at as usize] = f32::clamp(luminance * contrast, -1.0f32, 1.0f32);
        }
        item += UNITS;
    }
}

#[cube(launch)]
fn ssim_vjp_kernel(
    x: &[f32],       // [H, W, C]
    y: &[f32],       // [H, W, C]
    v_out: &[f32],   // [H, W, C]
    v_x: &mut [f32], // [H, W, C]
    frame: Frame,
) {
    let tile = own_tile(x, y, &frame);
    let mut pixels = Shared::<[f32]>::new_slice(comptime!(2 * FAR_REACH * FAR_REACH));
    let mut blurred = Shared::<[f32]>::new_slice(comptime!(4 * FAR_REACH * REACH));
    load(
        x,
        y,
        &mut pixels,
        &tile,
        &frame,
        comptime!(2 * RADIUS),
        FAR_REACH,
    );
    // Neighbours' pixels are blurred.
    sync_cube();
    blur_moments_along_rows(&pixels, &mut blurred, FAR_REACH);
    // Neighbours' rows are blurred, and the pixels make room for the moments' gradients.
    sync_cube();
    moments_vjp(&blurred, &mut pixels, v_out, &tile, &frame);
    // Neighbours' gradients are blurred, and the blurred moments make room for them.
    sync_cube();
    blur_gradients_along_rows(&pixels, &mut blurred);
    // Neighbours' rows are blurred.
    sync_cube();
    let plane = comptime!(REACH * TILE);
    let mut item = UNIT_POS as usize;
    while item < comptime!(TILE * TILE) {
        let row = tile.top as u32 + (item / TILE) as u32;
        let column = tile.left as u32 + (item % TILE) as u32;
        if row < frame.height && column < frame.width {
            let v_mean = blurred_from(&blurred, item, TILE);
            let v_square = blurred_from(&blurred, item + plane, TILE);
            let v_product = blurred_from(&blurred, item + comptime!(2 * plane), TILE);
            let at = (row * frame.width + column) * frame.channels + tile.channel;
            let (i, j) = (row as i32, column as i32);
            let stride = frame.channels;
            let a = pixel(x, i, j, tile.channel, stride, &frame) - tile.shift_x;
            let b = pixel(y, i, j, tile.channel, stride, &frame) - tile.shift_y;
            let v = v_mean + 2.0f32 * a * v_square + b * v_product;
            v_x[at as usize] = select(is_finite(x[at as usize]), finite_or_zero(v), 0.0f32);
        }
        item += UNITS;
    }
}

/// Gradients of the moments in the tile's reach, from moments blurred along rows.
#[cube]
fn moments_vjp(
    blurred: &Shared<[f32]>,       // [4, FAR_REACH, REACH]
    gradients: &mut Shared<[f32]>, // [3, REACH, REACH]
    v_out: &[f32],                 // [H, W, C]
    tile: &Tile,
    frame: &Frame,
) {
    let plane = comptime!(FAR_REACH * REACH);
    let v_plane = comptime!(REACH * REACH);
    let mut item = UNIT_POS as usize;
    while item < v_plane {
        let t = terms(
            blurred_from(blurred, item, REACH),
            blurred_from(blurred, item + plane, REACH),
            blurred_from(blurred, item + comptime!(2 * plane), REACH),
            blurred_from(blurred, item + comptime!(3 * plane), REACH),
            tile,
        );
        // Outside the image there is no similarity, and no gradient of it.
        let row = tile.top + (item / REACH) as i32 - comptime!(RADIUS as i32);
        let column = tile.left + (item % REACH) as i32 - comptime!(RADIUS as i32);
        let v = gradient_at(v_out, row, column, tile.channel, frame);
        let gradient = moment_gradients(&t, v);
        gradients[item] = gradient.mean;
        gradients[item + v_plane] = gradient.square;
        gradients[item + comptime!(2 * v_plane)] = gradient.product;
        item += UNITS;
    }
}

/// Blurs the three planes of gradients along their rows.
#[cube]
fn blur_gradients_along_rows(
    gradients: &Shared<[f32]>,   // [3, REACH, REACH]
    blurred: &mut Shared<[f32]>, // [3, REACH, TILE]
) {
    let mut item = UNIT_POS as usize;
    while item < comptime!(3 * REACH * TILE) {
        let first = item / TILE * REACH + item % TILE;
        blurred[item] = blurred_from(gradients, first, 1usize);
        item += UNITS;
    }
}
