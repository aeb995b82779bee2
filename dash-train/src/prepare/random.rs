//! Random initial points where the cameras look.

use dash_kernels::Camera;
use glam::DVec3;
use rand::{Rng, SeedableRng};
use rand_pcg::Pcg64;

use crate::cameras::focus_point;
use crate::ply::PointCloud;

/// The box reaches this share of the cameras' mean distance from where their axes meet: short of the
/// nearest cameras of a ring.
const REACH_SHARE: f64 = 0.7;
/// Cameras that must see a point.
const MIN_CAMERAS: usize = 2;
/// Draws before fewer points are accepted: at the beginning, and more for each point that was found.
const FIRST_DRAWS: usize = 100_000;
const DRAWS_PER_POINT: usize = 200;
/// Smallest reach that is drawn from, in world units, where all cameras stand in one place.
const MIN_REACH: f64 = 1e-3;

/// Up to `n` points of random colours in a box around the point where the cameras' axes meet. Each is seen by at
/// least two cameras; there are fewer if view frusta hardly overlap.
pub(super) fn random_points(cameras: &[Camera], n: usize, seed: u64) -> PointCloud {
    let focus = DVec3::from(focus_point(cameras));
    let distances = cameras
        .iter()
        .map(|camera| focus.distance(camera.position().into()));
    let reach = REACH_SHARE * distances.sum::<f64>() / cameras.len().max(1) as f64;
    let reach = reach.max(MIN_REACH);
    let mut rng = Pcg64::seed_from_u64(seed);
    let mut points = PointCloud::default();
    let mut n_draws = 0;
    while points.len() < n && n_draws < FIRST_DRAWS + DRAWS_PER_POINT * points.len() {
        n_draws += 1;
        let mut draw = || reach * rng.random_range(-1.0..1.0);
        let point = (focus + DVec3::new(draw(), draw(), draw())).to_array();
        let seen_by = cameras
            .iter()
            .filter(|camera| camera.project_inside(point).is_some());
        if seen_by.take(MIN_CAMERAS).count() == MIN_CAMERAS {
            points.push_finite(point, rng.random());
        }
    }
    points
}
