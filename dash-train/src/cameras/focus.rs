//! The point that cameras look at.

use dash_kernels::Camera;
use glam::{DMat3, DVec3};

use crate::numbers::quantile;

/// Depth of the scene by the spread of the cameras, where nothing better is known.
const DEPTH_BY_SPREAD: f64 = 10.0;
/// What six digits of a pose leave open, as a share of the distance from the origin.
const ROUNDED_POSES: f64 = 1e-5;
/// Distances from the origin, world units, below and above which that share is of these.
const ONE_PLACE_WITHIN: [f64; 2] = [1e-3, 100.0];
/// Pull of the meeting point towards the cameras' centre: it decides only for axes that are
/// parallel to within half a degree, whose meeting point is noise.
const PARALLEL_PULL: f64 = 1e-4;
/// Axes meet in front when at least three quarters of the cameras see the point further away than this many
/// times their spread.
const LEAST_DEPTH_BY_SPREAD: f64 = 0.25;

/// The point that the cameras look at.
///
/// It is where their axes meet (least squares) if that is in front of them, else a point ahead of their centre at
/// ten times their spread (1 for cameras at one place). Without cameras it is the origin.
///
/// # Units
/// World units.
pub fn focus_point(cameras: &[Camera]) -> [f64; 3] {
    if cameras.is_empty() {
        return [0.0; 3];
    }
    let positions: Vec<DVec3> = cameras.iter().map(|c| c.position().into()).collect();
    let (centre, spread) = centre_and_spread(&positions);
    if let Some(target) = meeting_point(cameras, &positions, centre, spread) {
        return target.into();
    }
    let forward: DVec3 = cameras.iter().map(|c| DVec3::from(c.forward())).sum();
    (centre + forward.normalize_or_zero() * default_depth(spread)).into()
}

/// The mean of the cameras' positions, and the 90th percentile of their distances from it; 0 of cameras in one place.
pub(super) fn centre_and_spread(positions: &[DVec3]) -> (DVec3, f64) {
    let centre = positions.iter().sum::<DVec3>() / positions.len() as f64;
    let distances = positions.iter().map(|p| p.distance(centre));
    match in_one_place(positions) {
        true => (centre, 0.0),
        false => (centre, quantile(distances, 0.9)),
    }
}

/// The distance within which positions are one place: what rounded poses differ by.
pub(crate) fn one_place(positions: &[DVec3]) -> f64 {
    let farthest = positions.iter().map(|p| p.length()).fold(0.0, f64::max);
    // In map coordinates all cameras of a scene are far from the origin.
    ROUNDED_POSES * farthest.clamp(ONE_PLACE_WITHIN[0], ONE_PLACE_WITHIN[1])
}

/// Whether cameras stand in one place, so that nothing shows how far anything is.
pub(crate) fn in_one_place(positions: &[DVec3]) -> bool {
    let within = one_place(positions);
    positions.iter().all(|p| p.distance(positions[0]) <= within)
}

/// The distance to look at where the axes don't meet in front of the cameras.
pub(super) fn default_depth(spread: f64) -> f64 {
    if spread > 0.0 {
        DEPTH_BY_SPREAD * spread
    } else {
        1.0
    }
}

/// The point nearest to all viewing axes, if it lies in front of the cameras.
pub(super) fn meeting_point(
    cameras: &[Camera],
    positions: &[DVec3],
    centre: DVec3,
    spread: f64,
) -> Option<DVec3> {
    let n = cameras.len() as f64;
    let mut normal = DMat3::from_diagonal(DVec3::splat(PARALLEL_PULL));
    let mut right_side = centre * PARALLEL_PULL;
    for (camera, position) in cameras.iter().zip(positions) {
        let axis = DVec3::from(camera.forward());
        let across =
            DMat3::IDENTITY - DMat3::from_cols(axis * axis.x, axis * axis.y, axis * axis.z);
        normal += across * (1.0 / n);
        right_side += across * *position / n;
    }
    let point = normal.inverse() * right_side;
    let depths = cameras
        .iter()
        .zip(positions)
        .map(|(camera, position)| DVec3::from(camera.forward()).dot(point - *position));
    let least = quantile(depths, 0.25);
    (spread > 0.0 && point.is_finite() && least > LEAST_DEPTH_BY_SPREAD * spread).then_some(point)
}
