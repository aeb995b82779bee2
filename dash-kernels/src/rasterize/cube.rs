//! Rasterization on CubeCL devices.
//!
//! Splats are sorted by depth, expanded to the tiles they overlap in that order, and sorted by tile with a stable sort.
//! Each tile is then blended by one cube. Only the device knows the number of (tile, splat) intersections. Their buffers
//! have a capacity that follows the need of earlier calls; when a frame exceeds it, every tile goes over all splats,
//! slowly but with the same result. So nothing has to wait for the device.

mod blend;
mod blend_vjp;
mod capacity;
mod footprint;
mod intersect;
mod moments;
mod slots;
#[cfg(test)]
mod tests;
mod tile;

use burn_cubecl::CubeBackend;
use burn_cubecl::tensor::CubeTensor;
use cubecl::prelude::*;

use crate::cube::atomic::has_native_add;
use crate::cube::{contiguous, uninitialised, zeros};
use crate::splats::N_COLUMNS;

use super::{N_CHANNELS, Rasterize, RasterizeOptions, RasterizeVjp};
use intersect::Intersections;

/// Settings of the kernels for a device.
#[derive(Debug, Clone, Copy)]
struct Tuning {
    /// Units of the cube that owns a tile.
    units: usize,
    /// Whether the device adds floats atomically.
    native_add: bool,
    /// Gradients of intersections that fit one buffer.
    slots_per_window: usize,
    /// Capacity for intersections; `None` follows the need of earlier calls.
    capacity: Option<usize>,
}

impl Tuning {
    fn of(client: &Client) -> Self {
        Self {
            units: blend::units_per_tile(client),
            native_add: has_native_add(client),
            slots_per_window: capacity::slots_per_window(client),
            capacity: None,
        }
    }
}

/// State of the forward pass for the backward pass.
#[derive(Debug, Clone)]
pub struct Saved {
    splats: CubeTensor,
    intersections: Intersections,
    pixels: blend::Pixels,
    options: RasterizeOptions,
    tuning: Tuning,
}

impl Rasterize for CubeBackend {
    fn rasterize(splats: CubeTensor, options: RasterizeOptions) -> CubeTensor {
        Self::rasterize_saving(splats, options).0
    }
}

impl RasterizeVjp for CubeBackend {
    type Saved = Saved;

    fn rasterize_saving(splats: CubeTensor, options: RasterizeOptions) -> (CubeTensor, Saved) {
        let tuning = Tuning::of(&splats.client);
        rasterize_with(splats, options, tuning)
    }

    fn rasterize_vjp(saved: Saved, v_image: CubeTensor) -> CubeTensor {
        let n = saved.splats.meta.shape()[0];
        let v_splats = zeros(&saved.splats, [n, N_COLUMNS]);
        blend_vjp::blend_vjp(&saved, &contiguous(v_image), &v_splats);
        v_splats
    }
}

fn rasterize_with(
    splats: CubeTensor,
    options: RasterizeOptions,
    tuning: Tuning,
) -> (CubeTensor, Saved) {
    let splats = contiguous(splats);
    let intersections = Intersections::new(&splats, &options, tuning.capacity);
    let image = uninitialised(&splats, [options.height, options.width, N_CHANNELS]);
    let pixels = blend::blend(&splats, &intersections, &options, &image, tuning.units);
    let saved = Saved {
        splats,
        intersections,
        pixels,
        options,
        tuning,
    };
    (image, saved)
}
