//! Costs by coverage on CubeCL devices.
//!
//! Visible motion: a unit owns a Gaussian, and Burn sums the costs. Floaters: cubes add up what their units own, as in
//! `cube/sums.rs`. No atomics; deterministic.

use burn::backend::ops::FloatTensorOps;
use burn_cubecl::CubeBackend;
use burn_cubecl::tensor::CubeTensor;
use cubecl::prelude::*;

use super::{AT_REST, Coverage, CoverageVjp, FloaterWeights, NEAR, NEAREST, PictureSize};
use crate::cube::sums::{UNITS, add_up, cubes, total};
use crate::cube::{arg, contiguous, is_finite, uninitialised, units};
use crate::host::dims;
use crate::splats::{
    CONIC_A, CONIC_B, CONIC_C, DEPTH, MEAN_X, MEAN_Y, N_COLUMNS, OPACITY, RADIUS_X, RADIUS_Y,
};

/// Motion, in shares of the picture's width, beyond which more of it changes nothing in single precision.
const ENOUGH: f32 = 1e15;

impl Coverage for CubeBackend {
    fn visible_motion(
        extents: CubeTensor,
        splats: CubeTensor,
        picture: PictureSize,
        far: f32,
    ) -> CubeTensor {
        Self::visible_motion_and_gradient(extents, splats, picture, far).0
    }

    fn floater_cost(
        opacity_logits: CubeTensor,
        splats: CubeTensor,
        motion: CubeTensor,
        picture: PictureSize,
        weights: FloaterWeights,
        moves: bool,
    ) -> CubeTensor {
        Self::floater_cost_and_gradient(opacity_logits, splats, motion, picture, weights, moves).0
    }
}

impl CoverageVjp for CubeBackend {
    fn visible_motion_and_gradient(
        extents: CubeTensor,
        splats: CubeTensor,
        picture: PictureSize,
        far: f32,
    ) -> (CubeTensor, CubeTensor) {
        let [extents, splats] = [extents, splats].map(contiguous);
        let [n] = dims::<1>(&extents);
        let (costs, slopes) = (uninitialised(&extents, [n]), uninitialised(&extents, [n]));
        let (count, dim) = units(&extents.client, n);
        visible_motion_kernel::launch(
            &extents.client,
            count,
            dim,
            arg(&extents),
            arg(&splats),
            arg(&costs),
            arg(&slopes),
            launched(picture),
            far,
            n as u32,
        );
        (CubeBackend::float_sum(costs), slopes)
    }

    fn floater_cost_and_gradient(
        opacity_logits: CubeTensor,
        splats: CubeTensor,
        motion: CubeTensor,
        picture: PictureSize,
        weights: FloaterWeights,
        moves: bool,
    ) -> (CubeTensor, CubeTensor) {
        let [logits, splats, motion] = [opacity_logits, splats, motion].map(contiguous);
        let [n] = dims::<1>(&logits);
        let client = logits.client.clone();
        let (n_cubes, count, dim) = cubes(&client, n);
        let covered = uninitialised(&logits, [n_cubes, 2]);
        let counts_nearness = weights.nearness > 0.0;
        if counts_nearness {
            covered_kernel::launch(
                &client,
                count.clone(),
                dim,
                arg(&splats),
                arg(&covered),
                launched(picture),
                n as u32,
                n_cubes as u32,
            );
        }
        let (costs, slopes) = (
            uninitialised(&logits, [n_cubes]),
            uninitialised(&logits, [n]),
        );
        floater_kernel::launch(
            &client,
            count,
            dim,
            GaussiansLaunch::new(arg(&logits), arg(&splats), arg(&motion)),
            arg(&covered),
            arg(&costs),
            arg(&slopes),
            launched(picture),
            WeightsLaunch::new(weights.opacity / n as f32, weights.nearness),
            n as u32,
            n_cubes as u32,
            Counts {
                motion: moves,
                nearness: counts_nearness,
            },
        );
        (total(&costs, n_cubes), slopes)
    }
}

#[derive(CubeType, CubeLaunch, Clone, Copy)]
struct Picture {
    width: f32,
    height: f32,
    focal: f32,
}

fn launched(picture: PictureSize) -> PictureLaunch {
    PictureLaunch::new(picture.width, picture.height, picture.focal)
}

/// What a picture shows of a Gaussian; all zero of one that is not drawn.
#[derive(CubeType, Clone, Copy)]
struct Drawn {
    opacity: f32,
    /// Of the picture, at most all of it; what lies beside it counts.
    share: f32,
    /// The part of `share` in the picture.
    inside: f32,
    /// How large a world unit appears there, in shares of the picture's width.
    scale: f32,
}

#[cube]
fn drawn(
    splats: &[f32], // [N, C]
    row: usize,
    picture: &Picture,
) -> Drawn {
    let first = row * N_COLUMNS;
    let (a, b, c) = (
        splats[first + CONIC_A],
        splats[first + CONIC_B],
        splats[first + CONIC_C],
    );
    let (opacity, depth) = (splats[first + OPACITY], splats[first + DEPTH]);
    let (radius_x, radius_y) = (splats[first + RADIUS_X], splats[first + RADIUS_Y]);
    let det = a * c - b * b;
    let scale = picture.focal / depth;
    let inside = part_inside(splats[first + MEAN_X], radius_x, picture.width)
        * part_inside(splats[first + MEAN_Y], radius_y, picture.height);
    let shown = radius_x > 0.0f32
        && depth > 0.0f32
        && det > 0.0f32
        && is_finite(opacity)
        && is_finite(scale)
        && is_finite(inside);
    let share = f32::min(
        1.0f32 / (det.sqrt() * picture.width * picture.height),
        1.0f32,
    );
    Drawn {
        opacity: select(shown, f32::clamp(opacity, 0.0f32, 1.0f32), 0.0f32),
        share: select(shown, share, 0.0f32),
        inside: select(shown, share * inside, 0.0f32),
        scale: select(shown, scale, 0.0f32),
    }
}

/// How much of `mean` +- `radius` lies in [0, `size`].
#[cube]
fn part_inside(mean: f32, radius: f32, size: f32) -> f32 {
    let from = f32::max(mean - radius, 0.0f32);
    let to = f32::min(mean + radius, size);
    f32::clamp((to - from) / (2.0f32 * radius), 0.0f32, 1.0f32)
}

#[cube(launch)]
fn visible_motion_kernel(
    extents: &[f32],    // [N]
    splats: &[f32],     // [N, C]
    costs: &mut [f32],  // [N]
    slopes: &mut [f32], // [N]
    picture: Picture,
    far: f32,
    n: u32,
) {
    if ABSOLUTE_POS >= n as usize {
        terminate!();
    }
    let drawn = drawn(splats, ABSOLUTE_POS, &picture);
    let extent = extents[ABSOLUTE_POS];
    let sound = is_finite(extent);
    let weight = select(sound, drawn.opacity * drawn.share, 0.0f32);
    let motion = f32::min(select(sound, extent, 0.0f32) * drawn.scale, ENOUGH);
    let damped = 1.0f32 + motion / far;
    costs[ABSOLUTE_POS] = weight * (motion / damped);
    slopes[ABSOLUTE_POS] = weight * drawn.scale / damped / damped;
}

/// What each cube's Gaussians cover, and the same times their disparities.
#[cube(launch)]
fn covered_kernel(
    splats: &[f32],      // [N, C]
    covered: &mut [f32], // [cubes, 2]
    picture: Picture,
    n: u32,
    n_cubes: u32,
) {
    let mut sums = Shared::<[f32]>::new_slice(comptime!(2 * UNITS));
    let unit = UNIT_POS as usize;
    let mut covers = 0.0f32;
    let mut near = 0.0f32;
    let mut row = CUBE_POS * UNITS + unit;
    while row < n as usize {
        let drawn = drawn(splats, row, &picture);
        covers += drawn.opacity * drawn.inside;
        near += drawn.opacity * drawn.inside * drawn.scale;
        row += n_cubes as usize * UNITS;
    }
    sums[unit] = covers;
    sums[UNITS + unit] = near;
    add_up(&mut sums, 2usize);
    if unit == 0 && CUBE_POS < n_cubes as usize {
        covered[2 * CUBE_POS] = sums[0usize];
        covered[2 * CUBE_POS + 1] = sums[UNITS];
    }
}

/// Weight of an opacity, and of nearness.
#[derive(CubeType, CubeLaunch, Clone, Copy)]
struct Weights {
    opacity: f32,
    nearness: f32,
}

/// What a Gaussian's opacity costs for being near.
#[cube]
fn nearness(
    splats: &[f32], // [N, C]
    motion: &[f32], // [N]
    row: usize,
    typical: f32,
    picture: &Picture,
    #[comptime] moves: bool,
) -> f32 {
    let drawn = drawn(splats, row, picture);
    let mut moved = 0.0f32;
    if comptime!(moves) {
        moved = motion[row];
    }
    let moved = select(is_finite(moved), moved, 0.0f32) * drawn.scale;
    let ratio = drawn.scale / typical;
    let near = f32::clamp(ratio * ratio - NEAR * NEAR, 0.0f32, NEAREST);
    let weight = drawn.inside * near / (1.0f32 + moved / AT_REST);
    select(is_finite(typical) && typical > 0.0f32, weight, 0.0f32)
}

#[derive(CubeType, CubeLaunch)]
struct Gaussians {
    logits: Box<[f32]>, // [N]
    splats: Box<[f32]>, // [N, C]
    motion: Box<[f32]>, // [N]
}

/// What counts.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
struct Counts {
    motion: bool,
    nearness: bool,
}

#[cube(launch)]
fn floater_kernel(
    gaussians: Gaussians,
    covered: &[f32],    // [cubes, 2]
    costs: &mut [f32],  // [cubes]
    slopes: &mut [f32], // [N]
    picture: Picture,
    weights: Weights,
    n: u32,
    n_cubes: u32,
    #[comptime] counts: Counts,
) {
    let mut sums = Shared::<[f32]>::new_slice(UNITS);
    let unit = UNIT_POS as usize;
    let mut typical = 0.0f32;
    if comptime!(counts.nearness) {
        let mut all = 0.0f32;
        let mut near = 0.0f32;
        for cube in 0..n_cubes as usize {
            all += covered[2 * cube];
            near += covered[2 * cube + 1];
        }
        typical = near / all;
    }
    let mut cost = 0.0f32;
    let mut row = CUBE_POS * UNITS + unit;
    while row < n as usize {
        let logit = gaussians.logits[row];
        let mut weight = weights.opacity;
        if comptime!(counts.nearness) {
            weight += weights.nearness
                * nearness(
                    &gaussians.splats,
                    &gaussians.motion,
                    row,
                    typical,
                    &picture,
                    counts.motion,
                );
        }
        let sound = is_finite(logit);
        let opacity = select(sound, 1.0f32 / (1.0f32 + (-logit).exp()), 0.0f32);
        cost += opacity * weight;
        slopes[row] = opacity * (1.0f32 - opacity) * weight;
        row += n_cubes as usize * UNITS;
    }
    sums[unit] = cost;
    add_up(&mut sums, 1usize);
    if unit == 0 && CUBE_POS < n_cubes as usize {
        costs[CUBE_POS] = sums[0usize];
    }
}
