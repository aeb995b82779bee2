//! Displacements on CubeCL devices.
//!
//! Forward a unit owns an axis of a trajectory, backward a coefficient. No shared memory, no atomics; deterministic.

use burn_cubecl::CubeBackend;
use burn_cubecl::tensor::CubeTensor;
use cubecl::prelude::*;

use super::{AXES, Displacement, DisplacementVjp};
use crate::cube::{Buffer, arg, contiguous, finite_or_zero, uninitialised, units};

impl Displacement for CubeBackend {
    fn displacement(coefficients: CubeTensor, basis: Vec<f32>) -> CubeTensor {
        let coefficients = contiguous(coefficients);
        let n = coefficients.meta.num_elements() / (AXES * basis.len());
        let out = uninitialised(&coefficients, [n, AXES]);
        let (count, dim) = units(&coefficients.client, n * AXES);
        displacement_kernel::launch(
            &coefficients.client,
            count,
            dim,
            arg(&coefficients),
            values(&coefficients.client, &basis).arg(),
            arg(&out),
            (n * AXES) as u32,
            basis.len() as u32,
        );
        out
    }
}

impl DisplacementVjp for CubeBackend {
    fn displacement_vjp(v_out: CubeTensor, basis: Vec<f32>) -> CubeTensor {
        let v_out = contiguous(v_out);
        let n = v_out.meta.num_elements() / AXES;
        let gradient = uninitialised(&v_out, [n, AXES * basis.len()]);
        let (count, dim) = units(&v_out.client, n * AXES * basis.len());
        displacement_vjp_kernel::launch(
            &v_out.client,
            count,
            dim,
            arg(&v_out),
            values(&v_out.client, &basis).arg(),
            arg(&gradient),
            (n * AXES * basis.len()) as u32,
            basis.len() as u32,
        );
        gradient
    }
}

/// The values of the basis functions on the device.
pub(crate) fn values(client: &Client, basis: &[f32]) -> Buffer {
    Buffer::from_words(client, bytemuck::cast_slice(basis))
}

#[cube(launch)]
fn displacement_kernel(
    coefficients: &[f32], // [N, B * 3]
    basis: &[f32],        // [B]
    out: &mut [f32],      // [N, 3]
    length: u32,
    n_functions: u32,
) {
    if ABSOLUTE_POS >= length as usize {
        terminate!();
    }
    let (row, axis) = (ABSOLUTE_POS / AXES, ABSOLUTE_POS % AXES);
    out[ABSOLUTE_POS] = displaced(coefficients, basis, row, axis, n_functions as usize);
}

/// A trajectory's displacement along an axis.
#[cube]
pub(crate) fn displaced(
    coefficients: &[f32], // [N, B * 3]
    basis: &[f32],        // [B]
    row: usize,
    axis: usize,
    n_functions: usize,
) -> f32 {
    let first = row * n_functions * AXES + axis;
    let mut sum = 0.0f32;
    for k in 0..n_functions {
        let coefficient = finite_or_zero(coefficients[first + AXES * k]);
        sum = f32::clamp(fma(coefficient, basis[k], sum), f32::MIN, f32::MAX);
    }
    sum
}

#[cube(launch)]
fn displacement_vjp_kernel(
    v_out: &[f32],        // [N, 3]
    basis: &[f32],        // [B]
    gradient: &mut [f32], // [N, B * 3]
    length: u32,
    n_functions: u32,
) {
    if ABSOLUTE_POS >= length as usize {
        terminate!();
    }
    let width = n_functions as usize * AXES;
    let v = v_out[ABSOLUTE_POS / width * AXES + ABSOLUTE_POS % AXES];
    let value = finite_or_zero(v) * basis[ABSOLUTE_POS % width / AXES];
    gradient[ABSOLUTE_POS] = f32::clamp(value, f32::MIN, f32::MAX);
}
