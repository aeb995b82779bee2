//! Smoothness on CubeCL devices. Forward, cubes add up what their units own, as in `cube/sums.rs`; backward, a unit owns a value
//! of the gradient. No atomics; deterministic.

use burn::backend::ops::FloatTensorOps;
use burn::tensor::Slice;
use burn_cubecl::CubeBackend;
use burn_cubecl::tensor::CubeTensor;
use cubecl::prelude::*;

use super::{FieldSmoothness, FieldSmoothnessVjp};
use crate::cube::sums::{UNITS, add_up, cubes, total};
use crate::cube::{Buffer, arg, contiguous, uninitialised, units};
use crate::host::dims;
use crate::rows::{NOT_TAKEN, places};

impl FieldSmoothness for CubeBackend {
    fn smoothness(
        features: CubeTensor,
        n: usize,
        rows: Vec<u32>,
    ) -> (CubeTensor, CubeTensor, CubeTensor) {
        let features = contiguous(features);
        let [n_all, width] = dims::<2>(&features);
        let client = &features.client;
        let n_values = rows.len() * width;
        let (n_cubes, count, dim) = cubes(client, n_values);
        let sums = uninitialised(&features, [n_cubes]);
        let on_device = Buffer::from_words(client, &rows);
        smoothness_kernel::launch(
            client,
            count,
            dim,
            arg(&features),
            on_device.arg(),
            arg(&sums),
            n as u32,
            width as u32,
            n_values as u32,
            n_cubes as u32,
            1.0 / rows.len() as f32,
        );
        let cost = total(&sums, n_cubes);
        let first = n + rows.len();
        let part = |from: usize, to: usize| {
            CubeBackend::float_slice(features.clone(), &[Slice::from(from..to)])
        };
        let others = if n_all > first {
            part(first, n_all)
        } else {
            cost.clone()
        };
        (part(0, n), cost, others)
    }
}

impl FieldSmoothnessVjp for CubeBackend {
    fn smoothness_vjp(
        features: CubeTensor,
        gradients: [Option<CubeTensor>; 3],
        n: usize,
        rows: Vec<u32>,
    ) -> CubeTensor {
        let features = contiguous(features);
        let [n_all, width] = dims::<2>(&features);
        let client = &features.client;
        let [v_own, v_cost, v_others] = gradients.map(|v| v.map(contiguous));
        let has = [&v_own, &v_cost, &v_others].map(Option::is_some);
        // What is not there has something bound in its place, and is not looked at.
        let [v_own, v_cost, v_others] =
            [v_own, v_cost, v_others].map(|v| v.unwrap_or_else(|| features.clone()));
        let v_features = uninitialised(&features, [n_all, width]);
        let (count, dim) = units(client, n_all * width);
        let on_device = Buffer::from_words(client, &rows);
        let places = Buffer::from_words(client, &places(n, &rows));
        smoothness_vjp_kernel::launch(
            client,
            count,
            dim,
            arg(&features),
            on_device.arg(),
            places.arg(),
            GradientsLaunch::new(arg(&v_own), arg(&v_cost), arg(&v_others)),
            arg(&v_features),
            SizesLaunch::new(
                n as u32,
                rows.len() as u32,
                width as u32,
                (n_all * width) as u32,
                2.0 / rows.len() as f32,
            ),
            has,
        );
        v_features
    }
}

/// What each cube's values beside points add to the cost.
#[cube(launch)]
fn smoothness_kernel(
    features: &[f32], // [N + M + R, F]
    rows: &[u32],     // [M]
    sums: &mut [f32], // [cubes]
    n: u32,
    width: u32,
    n_values: u32,
    n_cubes: u32,
    factor: f32,
) {
    let mut shared = Shared::<[f32]>::new_slice(UNITS);
    let unit = UNIT_POS as usize;
    let width = width as usize;
    let mut sum = 0.0f32;
    let mut at = CUBE_POS * UNITS + unit;
    while at < n_values as usize {
        let own = rows[at / width] as usize * width + at % width;
        let difference = features[own] - features[n as usize * width + at];
        sum += difference * difference;
        at += n_cubes as usize * UNITS;
    }
    shared[unit] = sum;
    add_up(&mut shared, 1usize);
    if unit == 0 && CUBE_POS < n_cubes as usize {
        sums[CUBE_POS] = shared[0usize] * factor;
    }
}

/// Gradients of the outputs.
#[derive(CubeType, CubeLaunch)]
struct Gradients {
    v_own: Box<[f32]>,    // [N, F]
    v_cost: Box<[f32]>,   // [1]
    v_others: Box<[f32]>, // [R, F]
}

/// How many there are of everything.
#[derive(CubeType, CubeLaunch)]
struct Sizes {
    /// Points.
    n: u32,
    /// Points with another beside them.
    m: u32,
    /// Features of a point.
    width: u32,
    /// Values in all.
    length: u32,
    /// Factor of a difference.
    factor: f32,
}

#[cube(launch)]
fn smoothness_vjp_kernel(
    features: &[f32],       // [N + M + R, F]
    rows: &[u32],           // [M]
    places: &[u32],         // [N]
    gradients: Gradients,   // [N, F], [1], [R, F]
    v_features: &mut [f32], // [N + M + R, F]
    sizes: Sizes,
    #[comptime] has: [bool; 3],
) {
    let at = ABSOLUTE_POS;
    if at >= sizes.length as usize {
        terminate!();
    }
    let (n, m, width) = (sizes.n as usize, sizes.m as usize, sizes.width as usize);
    let (row, column) = (at / width, at % width);
    let mut v_cost = 0.0f32;
    if comptime!(has[1]) {
        v_cost = sizes.factor * gradients.v_cost[0usize];
    }
    let mut v = 0.0f32;
    if row < n {
        if comptime!(has[0]) {
            v = gradients.v_own[at];
        }
        let place = places[row];
        if place != NOT_TAKEN {
            let beside = features[(n + place as usize) * width + column];
            v += v_cost * (features[at] - beside);
        }
    } else if row < n + m {
        let own = features[rows[row - n] as usize * width + column];
        v = v_cost * (features[at] - own);
    } else if comptime!(has[2]) {
        v = gradients.v_others[at - (n + m) * width];
    }
    v_features[at] = v;
}
