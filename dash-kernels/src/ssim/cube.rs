//! Structural similarity on CubeCL devices.
//!
//! A cube of 256 units owns a tile of 16 x 16 pixels of one channel. Moments are blurred along rows
//! and then along columns in shared memory (forward 11.9 KiB, backward 24.8 KiB); units take the
//! values of a step in turns, and a barrier parts the steps. No atomics; deterministic.
//!
//! Variances are differences of large numbers where an image is flat. The CPU forms them in f64;
//! here both images are first shifted by their values in the middle of the tile, which changes
//! no variance and leaves little to cancel.

use burn_cubecl::CubeBackend;
use burn_cubecl::tensor::CubeTensor;
use cubecl::prelude::*;

use crate::cube::{arg, calculate_cubes, contiguous, is_finite, uninitialised};

use super::window::{C1, C2, RADIUS, TAPS, window};
use super::{Ssim, SsimVjp};

/// Side of a tile in pixels.
const TILE: usize = 16;
const UNITS: usize = TILE * TILE;
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
        forward::launch(
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
            backward::launch(
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
    FrameLaunch::new(height as u32, width as u32, channels as u32)
}

#[derive(CubeType, CubeLaunch, Clone, Copy)]
struct Frame {
    height: u32,
    width: u32,
    channels: u32,
}

/// The tile and channel of this cube.
#[derive(CubeType, Clone, Copy)]
struct Tile {
    /// First row and column; signed, because regions around it begin outside the image.
    top: i32,
    left: i32,
    channel: u32,
    /// What is taken off the two images.
    shift_x: f32,
    shift_y: f32,
}

#[cube]
fn pixel(image: &[f32], row: i32, column: i32, channel: u32, frame: &Frame) -> f32 {
    let mut value = 0.0f32;
    if row >= 0i32 && column >= 0i32 && (row as u32) < frame.height && (column as u32) < frame.width
    {
        let at = ((row as u32) * frame.width + column as u32) * frame.channels + channel;
        let stored = image[at as usize];
        if is_finite(stored) {
            value = f32::clamp(stored, -LARGEST, LARGEST);
        }
    }
    value
}

#[cube]
fn own_tile(x: &[f32], y: &[f32], frame: &Frame) -> Tile {
    let side = comptime!(TILE as u32);
    let columns = (frame.width + side - 1u32) / side;
    let cube = CUBE_POS as u32;
    let channel = cube % frame.channels;
    let tile = cube / frame.channels;
    let top = tile / columns * side;
    let left = tile % columns * side;
    // The middle of the part of the tile that lies in the image.
    let row = (top + u32::min(top + side, frame.height)) / 2u32;
    let column = (left + u32::min(left + side, frame.width)) / 2u32;
    Tile {
        top: top as i32,
        left: left as i32,
        channel,
        shift_x: pixel(x, row as i32, column as i32, channel, frame),
        shift_y: pixel(y, row as i32, column as i32, channel, frame),
    }
}

/// Reads both images in a square of `side` pixels that begins `margin` before the tile.
#[cube]
fn load(
    x: &[f32],
    y: &[f32],
    pixels: &mut Shared<[f32]>,
    tile: &Tile,
    frame: &Frame,
    #[comptime] margin: usize,
    #[comptime] side: usize,
) {
    let mut i = UNIT_POS as usize;
    while i < comptime!(side * side) {
        let row = tile.top + (i / side) as i32 - comptime!(margin as i32);
        let column = tile.left + (i % side) as i32 - comptime!(margin as i32);
        pixels[i] = pixel(x, row, column, tile.channel, frame) - tile.shift_x;
        pixels[i + comptime!(side * side)] =
            pixel(y, row, column, tile.channel, frame) - tile.shift_y;
        i += UNITS;
    }
}

/// Blurs the moments of a square of `side` pixels along its rows: `side` rows of what is left.
#[cube]
fn blur_moments_along_rows(
    pixels: &Shared<[f32]>,
    blurred: &mut Shared<[f32]>,
    #[comptime] side: usize,
) {
    let kept = comptime!(side - 2 * RADIUS);
    let count = comptime!(side * kept);
    let mut i = UNIT_POS as usize;
    while i < count {
        let from = i / kept * side + i % kept;
        let mut mean_x = 0.0f32;
        let mut mean_y = 0.0f32;
        let mut squares = 0.0f32;
        let mut product = 0.0f32;
        #[unroll]
        for tap in 0..TAPS {
            let weight = comptime!(window()[tap] as f32);
            let a = pixels[from + tap];
            let b = pixels[from + comptime!(side * side + tap)];
            mean_x += weight * a;
            mean_y += weight * b;
            squares += weight * (a * a + b * b);
            product += weight * (a * b);
        }
        blurred[i] = mean_x;
        blurred[i + count] = mean_y;
        blurred[i + comptime!(2 * count)] = squares;
        blurred[i + comptime!(3 * count)] = product;
        i += UNITS;
    }
}

/// Blurs a plane along its columns at one place.
#[cube]
fn blur_along_column(
    plane: &Shared<[f32]>,
    from: usize,
    #[comptime] columns: usize,
) -> f32 {
    let mut sum = 0.0f32;
    #[unroll]
    for tap in 0..TAPS {
        sum += comptime!(window()[tap] as f32) * plane[from + comptime!(tap * columns)];
    }
    sum
}

/// The factors of the similarity at a pixel; means are those of the shifted images.
#[derive(CubeType, Clone, Copy)]
struct Terms {
    shifted_x: f32,
    shifted_y: f32,
    mean_x: f32,
    mean_y: f32,
    variance: f32,
    luminance: f32,
    contrast: f32,
    luminance_norm: f32,
    contrast_norm: f32,
}

/// The terms at place `i` of a square of `kept` pixels, from moments blurred along its rows.
#[cube]
fn terms(
    blurred: &Shared<[f32]>,
    i: usize,
    tile: &Tile,
    #[comptime] kept: usize,
) -> Terms {
    let count = comptime!((kept + 2 * RADIUS) * kept);
    let shifted_x = blur_along_column(blurred, i, kept);
    let shifted_y = blur_along_column(blurred, i + count, kept);
    let squares = blur_along_column(blurred, i + comptime!(2 * count), kept);
    let product = blur_along_column(blurred, i + comptime!(3 * count), kept);
    let mean_x = shifted_x + tile.shift_x;
    let mean_y = shifted_y + tile.shift_y;
    let variance = squares - (shifted_x * shifted_x + shifted_y * shifted_y);
    Terms {
        shifted_x,
        shifted_y,
        mean_x,
        mean_y,
        variance,
        luminance: 2.0f32 * (mean_x * mean_y) + comptime!(C1 as f32),
        contrast: 2.0f32 * (product - shifted_x * shifted_y) + comptime!(C2 as f32),
        luminance_norm: mean_x * mean_x + mean_y * mean_y + comptime!(C1 as f32),
        contrast_norm: f32::max(variance, 0.0f32) + comptime!(C2 as f32),
    }
}

#[cube(launch)]
fn forward(x: &[f32], y: &[f32], out: &mut [f32], frame: Frame) {
    let tile = own_tile(x, y, &frame);
    let mut pixels = Shared::<[f32]>::new_slice(comptime!(2 * REACH * REACH));
    let mut blurred = Shared::<[f32]>::new_slice(comptime!(4 * REACH * TILE));
    load(x, y, &mut pixels, &tile, &frame, RADIUS, REACH);
    // Neighbours' pixels are blurred.
    sync_cube();
    blur_moments_along_rows(&pixels, &mut blurred, REACH);
    // Neighbours' rows are blurred.
    sync_cube();
    let unit = UNIT_POS as usize;
    let row = tile.top as u32 + (unit / TILE) as u32;
    let column = tile.left as u32 + (unit % TILE) as u32;
    if row < frame.height && column < frame.width {
        let terms = terms(&blurred, unit, &tile, TILE);
        let luminance = terms.luminance / terms.luminance_norm;
        let contrast = terms.contrast / terms.contrast_norm;
        let at = (row * frame.width + column) * frame.channels + tile.channel;
        out[at as usize] = f32::clamp(luminance * contrast, -1.0f32, 1.0f32);
    }
}

#[cube(launch)]
fn backward(x: &[f32], y: &[f32], v_out: &[f32], v_x: &mut [f32], frame: Frame) {
    let tile = own_tile(x, y, &frame);
    let mut pixels = Shared::<[f32]>::new_slice(comptime!(2 * FAR_REACH * FAR_REACH));
    let mut blurred = Shared::<[f32]>::new_slice(comptime!(4 * FAR_REACH * REACH));
    load(x, y, &mut pixels, &tile, &frame, comptime!(2 * RADIUS), FAR_REACH);
    // Neighbours' pixels are blurred.
    sync_cube();
    blur_moments_along_rows(&pixels, &mut blurred, FAR_REACH);
    // Neighbours' rows are blurred, and the pixels make room for the moments' gradients.
    sync_cube();
    let plane = comptime!(REACH * REACH);
    let mut i = UNIT_POS as usize;
    while i < plane {
        let row = tile.top + (i / REACH) as i32 - comptime!(RADIUS as i32);
        let column = tile.left + (i % REACH) as i32 - comptime!(RADIUS as i32);
        let t = terms(&blurred, i, &tile, REACH);
        // Outside the image there is no similarity, and no gradient of it.
        let v = gradient_at(v_out, row, column, tile.channel, &frame);
        let luminance = t.luminance / t.luminance_norm;
        let contrast = t.contrast / t.contrast_norm;
        let similarity = luminance * contrast;
        let v_product = 2.0f32 * v * luminance / t.contrast_norm;
        let v_squares = select(t.variance > 0.0f32, -(v * similarity) / t.contrast_norm, 0.0f32);
        let through_luminance =
            2.0f32 * v * (t.mean_y * contrast - t.mean_x * similarity) / t.luminance_norm;
        pixels[i] =
            through_luminance - v_product * t.shifted_y - 2.0f32 * t.shifted_x * v_squares;
        pixels[i + plane] = v_squares;
        pixels[i + comptime!(2 * plane)] = v_product;
        i += UNITS;
    }
    // Neighbours' gradients are blurred, and the blurred moments make room for them.
    sync_cube();
    let rows_plane = comptime!(REACH * TILE);
    let mut i = UNIT_POS as usize;
    while i < rows_plane {
        let from = i / TILE * REACH + i % TILE;
        #[unroll]
        for k in 0..3 {
            let mut sum = 0.0f32;
            #[unroll]
            for tap in 0..TAPS {
                sum += comptime!(window()[tap] as f32) * pixels[from + comptime!(k * plane + tap)];
            }
            blurred[i + comptime!(k * rows_plane)] = sum;
        }
        i += UNITS;
    }
    // Neighbours' rows are blurred.
    sync_cube();
    let unit = UNIT_POS as usize;
    let row = tile.top as u32 + (unit / TILE) as u32;
    let column = tile.left as u32 + (unit % TILE) as u32;
    if row < frame.height && column < frame.width {
        let v_mean = blur_along_column(&blurred, unit, TILE);
        let v_squares = blur_along_column(&blurred, unit + rows_plane, TILE);
        let v_product = blur_along_column(&blurred, unit + comptime!(2 * rows_plane), TILE);
        let a = pixel(x, row as i32, column as i32, tile.channel, &frame) - tile.shift_x;
        let b = pixel(y, row as i32, column as i32, tile.channel, &frame) - tile.shift_y;
        let at = (row * frame.width + column) * frame.channels + tile.channel;
        let v = v_mean + 2.0f32 * a * v_squares + b * v_product;
        v_x[at as usize] = select(is_finite(x[at as usize]), v, 0.0f32);
    }
}

/// The gradient of the similarity at a pixel, zero outside the image.
#[cube]
fn gradient_at(v_out: &[f32], row: i32, column: i32, channel: u32, frame: &Frame) -> f32 {
    let mut v = 0.0f32;
    if row >= 0i32 && column >= 0i32 && (row as u32) < frame.height && (column as u32) < frame.width
    {
        let at = ((row as u32) * frame.width + column as u32) * frame.channels + channel;
        v = v_out[at as usize];
    }
    v
}
