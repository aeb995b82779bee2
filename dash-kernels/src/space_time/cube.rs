//! Points of the unit cube on CubeCL devices.
//!
//! A unit owns a position. No shared memory, no atomics; deterministic.

use burn_cubecl::CubeBackend;
use burn_cubecl::tensor::CubeTensor;
use cubecl::prelude::*;

use super::{AXES, Bounds, SpaceTime, SpaceTimeVjp, WIDTH};
use crate::cube::{Buffer, arg, contiguous, finite_or_zero, is_finite, uninitialised, units};

impl SpaceTime for CubeBackend {
    fn space_time(
        positions: CubeTensor,
        steps: CubeTensor,
        rows: Vec<u32>,
        bounds: Bounds,
        time: f32,
    ) -> CubeTensor {
        let [positions, steps] = [positions, steps].map(contiguous);
        let client = &positions.client;
        let [n, m] = [positions.meta.shape()[0], rows.len()];
        let out = uninitialised(&positions, [n + m, WIDTH]);
        let (count, dim) = units(client, n + m);
        // No device binds an empty buffer.
        let rows = Buffer::from_words(client, if m > 0 { &rows } else { &[0] });
        space_time_kernel::launch(
            client,
            count,
            dim,
            arg(&positions),
            arg(&steps),
            rows.arg(),
            arg(&out),
            launched(&bounds),
            time,
            n as u32,
            m as u32,
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

/// A point of the unit cube.
#[derive(CubeType, Clone, Copy)]
struct Point {
    x: f32,
    y: f32,
    z: f32,
    t: f32,
}

#[cube]
fn point_of(
    positions: &[f32], // [N, 3]
    row: usize,
    axes: &Axes,
    time: f32,
    #[comptime] clamp: bool,
) -> Point {
    let from = AXES * row;
    Point {
        x: limited(along(positions[from], axes.min_x, axes.scale_x), clamp),
        y: limited(along(positions[from + 1], axes.min_y, axes.scale_y), clamp),
        z: limited(along(positions[from + 2], axes.min_z, axes.scale_z), clamp),
        t: time,
    }
}

/// A coordinate beside another.
#[cube]
fn beside(value: f32, step: f32) -> f32 {
    f32::clamp(finite_or_zero(value + step), 0.0f32, 1.0f32)
}

#[cube(launch)]
fn space_time_kernel(
    positions: &[f32], // [N, 3]
    steps: &[f32],     // [M, 4]
    rows: &[u32],      // [M]
    out: &mut [f32],   // [N + M, 4]
    axes: Axes,
    time: f32,
    n: u32,
    m: u32,
    #[comptime] clamp: bool,
) {
    let i = ABSOLUTE_POS;
    if i >= (n + m) as usize {
        terminate!();
    }
    let is_beside = i >= n as usize;
    let mut row = i;
    if is_beside {
        row = rows[i - n as usize] as usize;
    }
    let mut point = point_of(positions, row, &axes, time, clamp);
    if is_beside {
        let from = (i - n as usize) * WIDTH;
        point.x = beside(point.x, steps[from]);
        point.y = beside(point.y, steps[from + 1]);
        point.z = beside(point.z, steps[from + 2]);
        point.t = beside(point.t, steps[from + 3]);
    }
    let to = WIDTH * i;
    out[to] = point.x;
    out[to + 1] = point.y;
    out[to + 2] = point.z;
    out[to + 3] = point.t;
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
