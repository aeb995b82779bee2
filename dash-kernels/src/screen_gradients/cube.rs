//! Sums of screen-space gradients on CubeCL devices.
//!
//! A unit owns a Gaussian. No shared memory, no atomics; deterministic.

use burn_cubecl::CubeBackend;
use burn_cubecl::tensor::CubeTensor;
use cubecl::prelude::*;

use super::{SUMS, ScreenGradients};
use crate::cube::{arg, contiguous, is_finite, own_memory, units};
use crate::splats::{MEAN_X, MEAN_Y, N_COLUMNS, RADIUS_X};

impl ScreenGradients for CubeBackend {
    fn add_screen_gradients(
        sums: CubeTensor,
        v_splats: CubeTensor,
        splats: CubeTensor,
        first: usize,
        half_size: [f32; 2],
    ) -> CubeTensor {
        let [v_splats, splats] = [v_splats, splats].map(contiguous);
        let sums = own_memory(sums);
        let client = sums.client.clone();
        let n = sums.meta.num_elements() / SUMS;
        let (count, dim) = units(&client, n);
        add_kernel::launch(
            &client,
            count,
            dim,
            arg(&sums),
            arg(&v_splats),
            arg(&splats),
            half_size[0],
            half_size[1],
            first as u32,
            n as u32,
        );
        sums
    }
}

#[cube(launch)]
fn add_kernel(
    sums: &mut [f32], // [N, 2]
    v_splats: &[f32], // [first + N and more, C]
    splats: &[f32],   // [N, C]
    half_width: f32,
    half_height: f32,
    first: u32,
    n: u32,
) {
    if ABSOLUTE_POS >= n as usize {
        terminate!();
    }
    let v_row = (ABSOLUTE_POS + first as usize) * N_COLUMNS;
    let x = f32::abs(v_splats[v_row + MEAN_X] * half_width);
    let y = f32::abs(v_splats[v_row + MEAN_Y] * half_height);
    if splats[ABSOLUTE_POS * N_COLUMNS + RADIUS_X] > 0.0f32 && is_finite(x) && is_finite(y) {
        // Squares may leave the range of f32 where the length does not.
        let longer = f32::max(x, y);
        let ratio = f32::min(x, y) / f32::max(longer, f32::MIN_POSITIVE);
        sums[SUMS * ABSOLUTE_POS] += longer * (1.0f32 + ratio * ratio).sqrt();
        sums[SUMS * ABSOLUTE_POS + 1] += 1.0f32;
    }
}
