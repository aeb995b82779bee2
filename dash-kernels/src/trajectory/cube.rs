//! Extents of trajectories on CubeCL devices.
//!
//! Forward a unit owns a trajectory, backward one axis of it, and walks its spans outwards from the anchor. No
//! shared memory, no atomics; deterministic.

use burn_cubecl::CubeBackend;
use burn_cubecl::tensor::CubeTensor;
use cubecl::prelude::*;

use crate::cube::{arg, contiguous, finite_or_zero, uninitialised, units};

use super::{LARGEST, Polyline, SquaredExtent, SquaredExtentVjp};

impl SquaredExtent for CubeBackend {
    fn squared_extent(coefficients: CubeTensor, polyline: Polyline) -> CubeTensor {
        let coefficients = contiguous(coefficients);
        let n = coefficients.meta.num_elements() / polyline.width();
        let out = uninitialised(&coefficients, [n]);
        let (count, dim) = units(&coefficients.client, n);
        squared_extent_kernel::launch(
            &coefficients.client,
            count,
            dim,
            arg(&coefficients),
            arg(&out),
            n as u32,
            polyline.n_spans as u32,
            polyline.span as u32,
            polyline.share,
            polyline.inverse_steady,
        );
        out
    }
}

impl SquaredExtentVjp for CubeBackend {
    fn squared_extent_vjp(
        coefficients: CubeTensor,
        v_out: CubeTensor,
        polyline: Polyline,
    ) -> CubeTensor {
        let (coefficients, v_out) = (contiguous(coefficients), contiguous(v_out));
        let n = v_out.meta.num_elements();
        let gradient = uninitialised(&coefficients, [n, polyline.width()]);
        let (count, dim) = units(&coefficients.client, 3 * n);
        squared_extent_vjp_kernel::launch(
            &coefficients.client,
            count,
            dim,
            arg(&coefficients),
            arg(&v_out),
            arg(&gradient),
            n as u32,
            polyline.n_spans as u32,
            polyline.span as u32,
            polyline.share,
            polyline.inverse_steady,
        );
        gradient
    }
}

/// The displacement beyond a span.
#[cube]
fn on(at: f32, span: f32, part: f32) -> f32 {
    f32::clamp(at + part * finite_or_zero(span), -LARGEST, LARGEST)
}

#[cube(launch)]
fn squared_extent_kernel(
    coefficients: &[f32], // [N, B * 3]
    out: &mut [f32],      // [N]
    n: u32,
    n_spans: u32,
    span: u32,
    share: f32,
    inverse_steady: f32,
) {
    if ABSOLUTE_POS >= n as usize {
        terminate!();
    }
    let (n_spans, span) = (n_spans as usize, span as usize);
    let mut sum = 0.0f32;
    for axis in 0..3usize {
        let first = ABSOLUTE_POS * n_spans * 3usize + axis;
        let both = coefficients[first + 3usize * span];
        let mut at = on(0.0f32, both, 1.0f32 - share);
        sum += at * at;
        for k in span + 1..n_spans {
            at = on(at, coefficients[first + 3usize * k], 1.0f32);
            sum += at * at;
        }
        at = on(0.0f32, both, share);
        sum += at * at;
        for back in 0..span {
            at = on(
                at,
                coefficients[first + 3usize * (span - 1usize - back)],
                1.0f32,
            );
            sum += at * at;
        }
    }
    out[ABSOLUTE_POS] = sum * inverse_steady;
}

#[cube(launch)]
fn squared_extent_vjp_kernel(
    coefficients: &[f32], // [N, B * 3]
    v_out: &[f32],        // [N]
    gradient: &mut [f32], // [N, B * 3]
    n: u32,
    n_spans: u32,
    span: u32,
    share: f32,
    inverse_steady: f32,
) {
    let row = ABSOLUTE_POS / 3usize;
    if row >= n as usize {
        terminate!();
    }
    let (n_spans, span) = (n_spans as usize, span as usize);
    let first = row * n_spans * 3usize + ABSOLUTE_POS % 3usize;
    let factor = 2.0f32 * finite_or_zero(v_out[row]) * inverse_steady;
    let both = coefficients[first + 3usize * span];
    // Displacements outwards, then their sums back.
    let after = on(0.0f32, both, 1.0f32 - share);
    let mut at = after;
    for k in span + 1..n_spans {
        at = on(at, coefficients[first + 3usize * k], 1.0f32);
        gradient[first + 3usize * k] = at;
    }
    let mut sum_after = 0.0f32;
    for back in 0..n_spans - 1usize - span {
        let k = first + 3usize * (n_spans - 1usize - back);
        sum_after += gradient[k];
        gradient[k] = scaled(sum_after, factor);
    }
    let before = on(0.0f32, both, share);
    at = before;
    for back in 0..span {
        let k = first + 3usize * (span - 1usize - back);
        at = on(at, coefficients[k], 1.0f32);
        gradient[k] = at;
    }
    let mut sum_before = 0.0f32;
    for k in 0..span {
        sum_before += gradient[first + 3usize * k];
        gradient[first + 3usize * k] = scaled(sum_before, factor);
    }
    gradient[first + 3usize * span] = scaled(
        (1.0f32 - share) * (sum_after + after) + share * (sum_before + before),
        factor,
    );
}

#[cube]
fn scaled(sum: f32, factor: f32) -> f32 {
    f32::clamp(sum * factor, f32::MIN, f32::MAX)
}
