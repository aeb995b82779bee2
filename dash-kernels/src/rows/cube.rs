//! Rows on CubeCL devices.
//!
//! A unit owns a value of the output, backward one of the gradient of all rows or of what was joined. No shared memory, no atomics;
//! deterministic.

use burn_cubecl::CubeBackend;
use burn_cubecl::tensor::CubeTensor;
use cubecl::prelude::*;

use super::{JoinRows, JoinRowsVjp, NOT_TAKEN, TakeRows, TakeRowsVjp};
use crate::cube::{Buffer, arg, contiguous, finite_or_zero, uninitialised, units};

impl TakeRows for CubeBackend {
    fn take_rows(values: CubeTensor, rows: Vec<u32>) -> CubeTensor {
        let values = contiguous(values);
        let width = values.meta.shape()[1];
        let out = uninitialised(&values, [rows.len(), width]);
        let (count, dim) = units(&values.client, rows.len() * width);
        take_kernel::launch(
            &values.client,
            count,
            dim,
            arg(&values),
            Buffer::from_words(&values.client, &rows).arg(),
            arg(&out),
            (rows.len() * width) as u32,
            width as u32,
        );
        out
    }
}

impl TakeRowsVjp for CubeBackend {
    fn take_rows_vjp(v_out: CubeTensor, places: Vec<u32>) -> CubeTensor {
        let v_out = contiguous(v_out);
        let width = v_out.meta.shape()[1];
        let gradient = uninitialised(&v_out, [places.len(), width]);
        let (count, dim) = units(&v_out.client, places.len() * width);
        take_vjp_kernel::launch(
            &v_out.client,
            count,
            dim,
            arg(&v_out),
            Buffer::from_words(&v_out.client, &places).arg(),
            arg(&gradient),
            (places.len() * width) as u32,
            width as u32,
        );
        gradient
    }
}

impl JoinRows for CubeBackend {
    fn join_rows(first: CubeTensor, second: CubeTensor) -> CubeTensor {
        let [first, second] = [first, second].map(contiguous);
        let [n, width] = [0, 1].map(|axis| first.meta.shape()[axis]);
        let m = second.meta.shape()[0];
        let out = uninitialised(&first, [n + m, width]);
        let (count, dim) = units(&first.client, (n + m) * width);
        join_kernel::launch(
            &first.client,
            count,
            dim,
            arg(&first),
            arg(&second),
            arg(&out),
            (n * width) as u32,
            ((n + m) * width) as u32,
        );
        out
    }
}

impl JoinRowsVjp for CubeBackend {
    fn join_rows_vjp(v_out: CubeTensor, n: usize) -> [CubeTensor; 2] {
        let v_out = contiguous(v_out);
        let [all, width] = [0, 1].map(|axis| v_out.meta.shape()[axis]);
        let first = uninitialised(&v_out, [n, width]);
        let second = uninitialised(&v_out, [all - n, width]);
        let (count, dim) = units(&v_out.client, all * width);
        join_vjp_kernel::launch(
            &v_out.client,
            count,
            dim,
            arg(&v_out),
            arg(&first),
            arg(&second),
            (n * width) as u32,
            (all * width) as u32,
        );
        [first, second]
    }
}

#[cube(launch)]
fn join_kernel(
    first: &[f32],   // [N, C]
    second: &[f32],  // [M, C]
    out: &mut [f32], // [N + M, C]
    n_first: u32,
    length: u32,
) {
    let at = ABSOLUTE_POS;
    let n_first = n_first as usize;
    if at >= length as usize {
        terminate!();
    }
    if at < n_first {
        out[at] = finite_or_zero(first[at]);
    } else {
        out[at] = finite_or_zero(second[at - n_first]);
    }
}

#[cube(launch)]
fn join_vjp_kernel(
    v_out: &[f32],      // [N + M, C]
    first: &mut [f32],  // [N, C]
    second: &mut [f32], // [M, C]
    n_first: u32,
    length: u32,
) {
    let at = ABSOLUTE_POS;
    let n_first = n_first as usize;
    if at >= length as usize {
        terminate!();
    }
    let v = finite_or_zero(v_out[at]);
    if at < n_first {
        first[at] = v;
    } else {
        second[at - n_first] = v;
    }
}

#[cube(launch)]
fn take_kernel(
    values: &[f32],  // [N, C]
    rows: &[u32],    // [M]
    out: &mut [f32], // [M, C]
    length: u32,
    width: u32,
) {
    if ABSOLUTE_POS >= length as usize {
        terminate!();
    }
    let width = width as usize;
    let row = rows[ABSOLUTE_POS / width] as usize;
    out[ABSOLUTE_POS] = finite_or_zero(values[row * width + ABSOLUTE_POS % width]);
}

#[cube(launch)]
fn take_vjp_kernel(
    v_out: &[f32],        // [M, C]
    places: &[u32],       // [N]
    gradient: &mut [f32], // [N, C]
    length: u32,
    width: u32,
) {
    if ABSOLUTE_POS >= length as usize {
        terminate!();
    }
    let width = width as usize;
    let place = places[ABSOLUTE_POS / width];
    let mut value = 0.0f32;
    if place != NOT_TAKEN {
        value = finite_or_zero(v_out[place as usize * width + ABSOLUTE_POS % width]);
    }
    gradient[ABSOLUTE_POS] = value;
}
