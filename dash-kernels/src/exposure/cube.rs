//! Exposure on CubeCL devices. A unit owns a value; the response's gradient is a reduction of Burn's.
//!
//! No shared memory, no atomics; deterministic.

use burn::backend::ops::FloatTensorOps;
use burn::tensor::Shape;
use burn_cubecl::CubeBackend;
use burn_cubecl::tensor::CubeTensor;
use cubecl::prelude::*;

use super::{CHANNELS, Expose, ExposeVjp, RESPONSE};
use crate::cube::{arg, contiguous, is_finite, uninitialised, units};
use crate::host::dims;
use crate::splats::{N_COLUMNS, RED};

impl Expose for CubeBackend {
    fn expose(splats: CubeTensor, response: CubeTensor) -> CubeTensor {
        let [splats, response] = [splats, response].map(contiguous);
        let [n, _] = dims::<2>(&splats);
        let out = uninitialised(&splats, [n, N_COLUMNS]);
        let (count, dim) = units(&splats.client, n * N_COLUMNS);
        expose_kernel::launch(
            &splats.client,
            count,
            dim,
            arg(&splats),
            arg(&response),
            arg(&out),
            (n * N_COLUMNS) as u32,
        );
        out
    }
}

impl ExposeVjp for CubeBackend {
    fn expose_vjp(splats: CubeTensor, response: CubeTensor, v_out: CubeTensor) -> [CubeTensor; 2] {
        let [splats, response, v_out] = [splats, response, v_out].map(contiguous);
        let [n, _] = dims::<2>(&splats);
        let v_splats = uninitialised(&splats, [n, N_COLUMNS]);
        let products = uninitialised(&splats, [n, RESPONSE]);
        let (count, dim) = units(&splats.client, n * N_COLUMNS);
        expose_vjp_kernel::launch(
            &splats.client,
            count,
            dim,
            arg(&splats),
            arg(&response),
            arg(&v_out),
            arg(&v_splats),
            arg(&products),
            (n * N_COLUMNS) as u32,
        );
        let v_response = CubeBackend::float_sum_dim(products, 0);
        let v_response = CubeBackend::float_reshape(v_response, Shape::new([2, CHANNELS]));
        [v_splats, v_response]
    }
}

#[cube(launch)]
fn expose_kernel(
    splats: &[f32],   // [N, C]
    response: &[f32], // [2, 3]
    out: &mut [f32],  // [N, C]
    length: u32,
) {
    if ABSOLUTE_POS >= length as usize {
        terminate!();
    }
    let column = ABSOLUTE_POS % N_COLUMNS;
    let mut value = splats[ABSOLUTE_POS];
    let is_geometry = column < RED;
    if !is_geometry && column < comptime!(RED + CHANNELS) {
        let channel = column - RED;
        value = value * (1.0f32 + response[channel]) + response[channel + CHANNELS];
    }
    out[ABSOLUTE_POS] = value;
}

#[cube(launch)]
fn expose_vjp_kernel(
    splats: &[f32],       // [N, C]
    response: &[f32],     // [2, 3]
    v_out: &[f32],        // [N, C]
    v_splats: &mut [f32], // [N, C]
    products: &mut [f32], // [N, 6]
    length: u32,
) {
    if ABSOLUTE_POS >= length as usize {
        terminate!();
    }
    let column = ABSOLUTE_POS % N_COLUMNS;
    let v = v_out[ABSOLUTE_POS];
    let mut v_own = v;
    let is_geometry = column < RED;
    if !is_geometry && column < comptime!(RED + CHANNELS) {
        let channel = column - RED;
        v_own = v * (1.0f32 + response[channel]);
        let v_gain = v * splats[ABSOLUTE_POS];
        let sound = is_finite(v_gain);
        let first = ABSOLUTE_POS / N_COLUMNS * RESPONSE + channel;
        products[first] = select(sound, v_gain, 0.0f32);
        products[first + CHANNELS] = select(sound, v, 0.0f32);
    }
    v_splats[ABSOLUTE_POS] = v_own;
}
