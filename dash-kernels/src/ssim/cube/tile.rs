//! A tile's pixels, blurred moments and terms, and the blurs along rows and columns.

use cubecl::prelude::*;

use crate::cube::{finite_or_zero, is_finite};

use super::super::window::{C1, C2, RADIUS, TAPS, window};
use super::{LARGEST, TILE, UNITS};

#[derive(CubeType, CubeLaunch, Clone, Copy)]
pub(super) struct Frame {
    pub height: u32,
    pub width: u32,
    pub channels: u32,
    /// Channels of the first image in memory, of which the similarity looks at the first `channels`.
    pub wide: u32,
}

/// The tile and channel of this cube.
#[derive(CubeType, Clone, Copy)]
pub(super) struct Tile {
    /// First row and column; signed, because regions around it begin outside the image.
    pub top: i32,
    pub left: i32,
    pub channel: u32,
    /// What is taken off the two images.
    pub shift_x: f32,
    pub shift_y: f32,
}

/// Whether a pixel lies in the images.
#[cube]
pub(super) fn is_inside(row: i32, column: i32, frame: &Frame) -> bool {
    row >= 0i32 && column >= 0i32 && (row as u32) < frame.height && (column as u32) < frame.width
}

/// A value of an image of `stride` channels, zero outside the image.
#[cube]
pub(super) fn pixel(
    image: &[f32], // [H, W, stride]
    row: i32,
    column: i32,
    channel: u32,
    stride: u32,
    frame: &Frame,
) -> f32 {
    let mut value = 0.0f32;
    if is_inside(row, column, frame) {
        let at = ((row as u32) * frame.width + column as u32) * stride + channel;
        let stored = image[at as usize];
        if is_finite(stored) {
            value = f32::clamp(stored, -LARGEST, LARGEST);
        }
    }
    value
}

#[cube]
pub(super) fn own_tile(
    x: &[f32], // [H, W, wide]
    y: &[f32], // [H, W, C]
    frame: &Frame,
) -> Tile {
    let side = comptime!(TILE as u32);
    let columns = frame.width.div_ceil(side);
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
        shift_x: pixel(x, row as i32, column as i32, channel, frame.wide, frame),
        shift_y: pixel(y, row as i32, column as i32, channel, frame.channels, frame),
    }
}

/// Reads both images in a square of `side` pixels that begins `margin` before the tile.
#[cube]
pub(super) fn load(
    x: &[f32],                  // [H, W, wide]
    y: &[f32],                  // [H, W, C]
    pixels: &mut Shared<[f32]>, // [2, side, side]
    tile: &Tile,
    frame: &Frame,
    #[comptime] margin: usize,
    #[comptime] side: usize,
) {
    let mut i = UNIT_POS as usize;
    while i < comptime!(side * side) {
        let row = tile.top + (i / side) as i32 - comptime!(margin as i32);
        let column = tile.left + (i % side) as i32 - comptime!(margin as i32);
        pixels[i] = pixel(x, row, column, tile.channel, frame.wide, frame) - tile.shift_x;
        pixels[i + comptime!(side * side)] =
            pixel(y, row, column, tile.channel, frame.channels, frame) - tile.shift_y;
        i += UNITS;
    }
}

/// The blurred value whose window starts at a place, with such steps from one value to the next.
#[cube]
pub(super) fn blurred_from(
    values: &Shared<[f32]>, // [planes * rows * columns]
    first: usize,
    #[comptime] step: usize,
) -> f32 {
    let mut sum = 0.0f32;
    #[unroll]
    for tap in 0..TAPS {
        sum += comptime!(window()[tap] as f32) * values[first + comptime!(tap * step)];
    }
    sum
}

/// Blurs the moments of a square of `side` pixels along its rows: `side` rows of what is left.
#[cube]
pub(super) fn blur_moments_along_rows(
    pixels: &Shared<[f32]>,      // [2, side, side]
    blurred: &mut Shared<[f32]>, // [4, side, side - 2 * RADIUS]
    #[comptime] side: usize,
) {
    let kept = comptime!(side - 2 * RADIUS);
    let count = comptime!(side * kept);
    let mut item = UNIT_POS as usize;
    while item < count {
        let first = item / kept * side + item % kept;
        let mut mean_x = 0.0f32;
        let mut mean_y = 0.0f32;
        let mut squares = 0.0f32;
        let mut products = 0.0f32;
        #[unroll]
        for tap in 0..TAPS {
            let weight = comptime!(window()[tap] as f32);
            let a = pixels[first + comptime!(tap)];
            let b = pixels[first + comptime!(tap + side * side)];
            mean_x += weight * a;
            mean_y += weight * b;
            squares += weight * (a * a + b * b);
            products += weight * (a * b);
        }
        blurred[item] = mean_x;
        blurred[item + count] = mean_y;
        blurred[item + comptime!(2 * count)] = squares;
        blurred[item + comptime!(3 * count)] = products;
        item += UNITS;
    }
}

/// The factors of the similarity at a pixel; means are those of the shifted images.
#[derive(CubeType, Clone, Copy)]
pub(super) struct Terms {
    pub shifted_x: f32,
    pub shifted_y: f32,
    pub mean_x: f32,
    pub mean_y: f32,
    pub variance: f32,
    pub luminance: f32,
    pub contrast: f32,
    pub luminance_norm: f32,
    pub contrast_norm: f32,
}

/// The terms from the blurred moments of the shifted images.
#[cube]
pub(super) fn terms(
    shifted_x: f32,
    shifted_y: f32,
    squares: f32,
    product: f32,
    tile: &Tile,
) -> Terms {
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

/// The gradient of the similarity at a pixel, zero outside the image.
#[cube]
pub(super) fn gradient_at(
    v_out: &[f32], // [H, W, C]
    row: i32,
    column: i32,
    channel: u32,
    frame: &Frame,
) -> f32 {
    let mut v = 0.0f32;
    if is_inside(row, column, frame) {
        let at = ((row as u32) * frame.width + column as u32) * frame.channels + channel;
        v = finite_or_zero(v_out[at as usize]);
    }
    v
}

/// Gradients of the moments of the shifted images, and the similarity.
#[derive(CubeType, Clone, Copy)]
pub(super) struct MomentGradients {
    pub mean: f32,
    pub square: f32,
    pub product: f32,
    pub similarity: f32,
}

/// From the gradient of the similarity at a pixel.
#[cube]
pub(super) fn moment_gradients(t: &Terms, v: f32) -> MomentGradients {
    let luminance = t.luminance / t.luminance_norm;
    let contrast = t.contrast / t.contrast_norm;
    let similarity = luminance * contrast;
    let product = 2.0f32 * v * luminance / t.contrast_norm;
    let square = select(
        t.variance > 0.0f32,
        -(v * similarity) / t.contrast_norm,
        0.0f32,
    );
    let through_luminance =
        2.0f32 * v * (t.mean_y * contrast - t.mean_x * similarity) / t.luminance_norm;
    MomentGradients {
        mean: through_luminance - product * t.shifted_y - 2.0f32 * t.shifted_x * square,
        square,
        product,
        similarity,
    }
}
