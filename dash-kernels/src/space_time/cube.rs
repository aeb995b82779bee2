//! Points of the unit cube on CubeCL devices.
//!
//! A unit owns a position. No shared memory, no atomics; deterministic.

use burn_cubecl::CubeBackend;
use burn_cubecl::tensor::CubeTensor;
use cubecl::prelude::*;

use super::{AXES, Bounds, SpaceTime, SpaceTimeVjp, WIDTH};
use crate::cube::{arg, contiguous, finite_or_zero, is_finite, uninitialised, units};

impl SpaceTime for CubeBackend {
    fn space_time(positions: CubeTensor, bounds: Bounds, time: f32) -> CubeTensor {
        let positions = contiguous(positions);
        let n = positions.meta.shape()[0];
        let out = uninitialised(&positions, [n, WIDTH]);
        let (count, dim) = units(&positions.client, n);
        space_time_kernel::launch(
            &positions.client,
            count,
            dim,
            arg(&positions),
            arg(&out),
            launched(&bounds),
            time,
            n as u32,
            bounds.clamp,
        );
        out
    }
}

impl SpaceTimeVjp for CubeBackend {
    fn space_time_vjp(positions: CubeTensor, v_out: CubeTensor, bounds: Bounds) -> CubeTensor {
        let [positions, v_out] = [positions, v_out].map(contiguous);
        let n = positions.meta.shape()[0];
        let gradient = uninitialised(&positions, [n, AXES]);
        let (count, dim) = units(&positions.client, n);
        space_time_vjp_kernel::launch(
            &positions.client,
            count,
            dim,
            arg(&positions),
            arg(&v_out),
            arg(&gradient),
            launched(&bounds),
            n as u32,
            bounds.clamp,
        );
        gradient
    }
}

#[derive(CubeType, CubeLaunch, Clone, Copy)]
struct Axes {
    min_x: f32,
    min_y: f32,
    min_z: f32,
    scale_x: f32,
    scale_y: f32,
    scale_z: f32,
}

fn launched(bounds: &Bounds) -> AxesLaunch {
    let ([x, y, z], [width, height, depth]) = (bounds.min, bounds.scale);
    AxesLaunch::new(x, y, z, width, height, depth)
}

#[cube]
fn along(position: f32, min: f32, scale: f32) -> f32 {
    select(is_finite(position), (position - min) * scale, 0.0f32)
}

/// In the unit interval, or finite.
#[cube]
fn limited(value: f32, #[comptime] clamp: bool) -> f32 {
    if comptime!(clamp) {
        f32::clamp(value, 0.0f32, 1.0f32)
    } else {
        f32::clamp(value, f32::MIN, f32::MAX)
    }
}

#[cube]
fn limited_vjp(value: f32, v: f32, scale: f32, #[comptime] clamp: bool) -> f32 {
    let gradient = f32::clamp(finite_or_zero(v) * scale, f32::MIN, f32::MAX);
    if comptime!(clamp) {
        let moved = value != f32::clamp(value, 0.0f32, 1.0f32);
        select(moved, 0.0f32, gradient)
    } else {
        gradient
    }
}

#[cube(launch)]
fn space_time_kernel(
    positions: &[f32], // [N, 3]
    out: &mut [f32],   // [N, 4]
    axes: Axes,
    time: f32,
    n: u32,
    #[comptime] clamp: bool,
) {
    let i = ABSOLUTE_POS;
    if i >= n as usize {
        terminate!();
    }
    let (from, to) = (AXES * i, WIDTH * i);
    out[to] = limited(along(positions[from], axes.min_x, axes.scale_x), clamp);
    out[to + 1] = limited(along(positions[from + 1], axes.min_y, axes.scale_y), clamp);
    out[to + 2] = limited(along(positions[from + 2], axes.min_z, axes.scale_z), clamp);
    out[to + 3] = time;
}

#[cube(launch)]
fn space_time_vjp_kernel(
    positions: &[f32],    // [N, 3]
    v_out: &[f32],        // [N, 4]
    gradient: &mut [f32], // [N, 3]
    axes: Axes,
    n: u32,
    #[comptime] clamp: bool,
) {
    let i = ABSOLUTE_POS;
    if i >= n as usize {
        terminate!();
    }
    let (at, from) = (AXES * i, WIDTH * i);
    let x = along(positions[at], axes.min_x, axes.scale_x);
    let y = along(positions[at + 1], axes.min_y, axes.scale_y);
    let z = along(positions[at + 2], axes.min_z, axes.scale_z);
    gradient[at] = limited_vjp(x, v_out[from], axes.scale_x, clamp);
    gradient[at + 1] = limited_vjp(y, v_out[from + 1], axes.scale_y, clamp);
    gradient[at + 2] = limited_vjp(z, v_out[from + 2], axes.scale_z, clamp);
}
