//! The photometric loss and its gradient, in one pass over the similarity's tiles.
//!
//! What a pixel of a tile adds to the loss is summed over the tile in shared memory, and the tiles' sums by one cube, in one
//! order. No atomics; deterministic.

use burn_cubecl::tensor::CubeTensor;
use cubecl::prelude::*;

use super::tile::{
    Frame, FrameLaunch, Tile, blur_moments_along_rows, blurred_from, is_inside, load,
    moment_gradients, own_tile, pixel, terms,
};
use super::{FAR_REACH, REACH, TILE, UNITS, blur_gradients_along_rows, n_cubes};
use crate::cube::{arg, calculate_cubes, finite_or_zero, is_finite, uninitialised};
use crate::ssim::window::RADIUS;

/// Sums of a tile: similarities, absolute and squared errors.
const SUMS: usize = 3;
/// Base-2 logarithm of [`UNITS`].
const HALVINGS: usize = 8;

/// Loss and mean squared error, `[1]` each, and the gradient of the loss to the image, of the image's shape. Both images
/// are contiguous.
pub(crate) fn photometric(
    image: &CubeTensor,  // [H, W, C + E]
    target: &CubeTensor, // [H, W, C]
    dssim: f32,
) -> ([CubeTensor; 2], CubeTensor) {
    let of_image = crate::host::dims::<3>(image);
    let shape = crate::host::dims::<3>(target);
    let [height, width, channels] = shape;
    let n = shape.iter().product::<usize>() as f32;
    let n_tiles = n_cubes(shape);
    let client = image.client.clone();
    let v_image = uninitialised(image, of_image);
    let sums = uninitialised(image, [n_tiles, SUMS]);
    let frame = [height, width, channels, of_image[2]].map(|size| size as u32);
    loss_kernel::launch(
        &client,
        calculate_cubes(&client, n_tiles),
        CubeDim::new_1d(UNITS as u32),
        arg(image),
        arg(target),
        arg(&v_image),
        arg(&sums),
        FrameLaunch::new(frame[0], frame[1], frame[2], frame[3]),
        -dssim / n,
        (1.0 - dssim) / n,
        n_tiles as u32,
    );
    let [loss, mse] = [(); 2].map(|()| uninitialised(image, [1]));
    sum_kernel::launch(
        &client,
        CubeCount::new_single(),
        CubeDim::new_1d(UNITS as u32),
        arg(&sums),
        arg(&loss),
        arg(&mse),
        n,
        dssim,
        n_tiles as u32,
    );
    ([loss, mse], v_image)
}

#[cube(launch)]
fn loss_kernel(
    image: &[f32],       // [H, W, C + E]
    target: &[f32],      // [H, W, C]
    v_image: &mut [f32], // [H, W, C + E]
    sums: &mut [f32],    // [tiles, 3]
    frame: Frame,
    v_similar: f32,
    v_absolute: f32,
    n_tiles: u32,
) {
    let tile = own_tile(image, target, &frame);
    let mut pixels = Shared::<[f32]>::new_slice(comptime!(2 * FAR_REACH * FAR_REACH));
    let mut blurred = Shared::<[f32]>::new_slice(comptime!(4 * FAR_REACH * REACH));
    load(
        image,
        target,
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
    let similarity = moments_and_similarity(&blurred, &mut pixels, v_similar, &tile, &frame);
    // Neighbours' gradients are blurred, and the blurred moments make room for them.
    sync_cube();
    blur_gradients_along_rows(&pixels, &mut blurred);
    // Neighbours' rows are blurred.
    sync_cube();
    let mut absolute = 0.0f32;
    let mut squared = 0.0f32;
    let mut item = UNIT_POS as usize;
    while item < comptime!(TILE * TILE) {
        let (own_absolute, own_squared) = score_pixel(
            image, target, v_image, &blurred, item, &tile, &frame, v_absolute,
        );
        absolute += own_absolute;
        squared += own_squared;
        item += UNITS;
    }
    let unit = UNIT_POS as usize;
    // The pixels' gradients have been blurred: there is room.
    pixels[unit] = similarity;
    pixels[unit + UNITS] = absolute;
    pixels[unit + comptime!(2 * UNITS)] = squared;
    add_up(&mut pixels);
    if UNIT_POS == 0 && (CUBE_POS as u32) < n_tiles {
        let first = CUBE_POS * SUMS;
        sums[first] = pixels[0usize];
        sums[first + 1] = pixels[UNITS];
        sums[first + 2] = pixels[comptime!(2 * UNITS)];
    }
}

/// Writes the gradient of a pixel of the tile, from the moments' gradients blurred along rows. Returns its absolute and its squared
/// error; 0 outside the image.
#[cube]
fn score_pixel(
    image: &[f32],           // [H, W, C + E]
    target: &[f32],          // [H, W, C]
    v_image: &mut [f32],     // [H, W, C + E]
    blurred: &Shared<[f32]>, // [3, REACH, TILE]
    item: usize,
    tile: &Tile,
    frame: &Frame,
    v_absolute: f32,
) -> (f32, f32) {
    let plane = comptime!(REACH * TILE);
    let mut absolute = 0.0f32;
    let mut squared = 0.0f32;
    let row = tile.top + (item / TILE) as i32;
    let column = tile.left + (item % TILE) as i32;
    if is_inside(row, column, frame) {
        let v_mean = blurred_from(blurred, item, TILE);
        let v_square = blurred_from(blurred, item + plane, TILE);
        let v_product = blurred_from(blurred, item + comptime!(2 * plane), TILE);
        let a = pixel(image, row, column, tile.channel, frame.wide, frame) - tile.shift_x;
        let b = pixel(target, row, column, tile.channel, frame.channels, frame) - tile.shift_y;
        let place = row as u32 * frame.width + column as u32;
        let first = place * frame.wide;
        let at = (first + tile.channel) as usize;
        let value = image[at];
        let error = value - target[(place * frame.channels + tile.channel) as usize];
        absolute = f32::abs(error);
        squared = error * error;
        let v = v_mean + 2.0f32 * a * v_square + b * v_product;
        let mut v = select(is_finite(value), finite_or_zero(v), 0.0f32);
        if is_finite(error) {
            if error > 0.0f32 {
                v += v_absolute;
            }
            if error < 0.0f32 {
                v -= v_absolute;
            }
        }
        v_image[at] = v;
        // Nobody else writes the channels that the target lacks.
        if tile.channel == 0u32 {
            let mut channel = frame.channels;
            while channel < frame.wide {
                v_image[(first + channel) as usize] = 0.0f32;
                channel += 1u32;
            }
        }
    }
    (absolute, squared)
}

/// Gradients of the moments in the tile's reach, from moments blurred along rows, and the sum of the similarities of this
/// unit's pixels in the tile.
#[cube]
fn moments_and_similarity(
    blurred: &Shared<[f32]>,       // [4, FAR_REACH, REACH]
    gradients: &mut Shared<[f32]>, // [3, REACH, REACH]
    v_similar: f32,
    tile: &Tile,
    frame: &Frame,
) -> f32 {
    let plane = comptime!(FAR_REACH * REACH);
    let v_plane = comptime!(REACH * REACH);
    let side = comptime!(TILE as i32);
    let mut similarity = 0.0f32;
    let mut item = UNIT_POS as usize;
    while item < v_plane {
        let t = terms(
            blurred_from(blurred, item, REACH),
            blurred_from(blurred, item + plane, REACH),
            blurred_from(blurred, item + comptime!(2 * plane), REACH),
            blurred_from(blurred, item + comptime!(3 * plane), REACH),
            tile,
        );
        let row = (item / REACH) as i32 - comptime!(RADIUS as i32);
        let column = (item % REACH) as i32 - comptime!(RADIUS as i32);
        // Outside the image there is no similarity, and no gradient of it.
        let inside = is_inside(tile.top + row, tile.left + column, frame);
        let gradient = moment_gradients(&t, select(inside, v_similar, 0.0f32));
        gradients[item] = gradient.mean;
        gradients[item + v_plane] = gradient.square;
        gradients[item + comptime!(2 * v_plane)] = gradient.product;
        if inside && row >= 0i32 && row < side && column >= 0i32 && column < side {
            similarity += f32::clamp(gradient.similarity, -1.0f32, 1.0f32);
        }
        item += UNITS;
    }
    similarity
}

/// Adds up three runs of [`UNITS`] values, each into its first.
#[cube]
fn add_up(values: &mut Shared<[f32]>, // [3 * UNITS] and more
) {
    let unit = UNIT_POS as usize;
    // What all units wrote is read.
    sync_cube();
    #[unroll]
    for step in 0..HALVINGS {
        let half = comptime!(UNITS >> (step + 1));
        if unit < half {
            #[unroll]
            for run in 0..SUMS {
                let to = unit + comptime!(run * UNITS);
                values[to] += values[to + half];
            }
        }
        // What other units have added is added.
        sync_cube();
    }
}

/// One cube adds the tiles' sums.
#[cube(launch)]
fn sum_kernel(
    sums: &[f32],     // [tiles, 3]
    loss: &mut [f32], // [1]
    mse: &mut [f32],  // [1]
    n: f32,
    dssim: f32,
    n_tiles: u32,
) {
    let mut values = Shared::<[f32]>::new_slice(comptime!(SUMS * UNITS));
    let unit = UNIT_POS as usize;
    let mut similarity = 0.0f32;
    let mut absolute = 0.0f32;
    let mut squared = 0.0f32;
    let mut tile = unit;
    while tile < n_tiles as usize {
        similarity += sums[tile * SUMS];
        absolute += sums[tile * SUMS + 1];
        squared += sums[tile * SUMS + 2];
        tile += UNITS;
    }
    values[unit] = similarity;
    values[unit + UNITS] = absolute;
    values[unit + comptime!(2 * UNITS)] = squared;
    add_up(&mut values);
    if UNIT_POS == 0 {
        let unlike = 1.0f32 - values[0usize] / n;
        loss[0usize] = (1.0f32 - dssim) * (values[UNITS] / n) + dssim * unlike;
        mse[0usize] = values[comptime!(2 * UNITS)] / n;
    }
}
