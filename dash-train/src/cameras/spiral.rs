//! A smooth path in the middle of given cameras.

use std::f64::consts::TAU;

use dash_kernels::Camera;
use glam::DVec3;

use super::focus::{centre_and_spread, default_depth, meeting_point};
use crate::numbers::quantile;

/// Rounds of the path before a rig that looks one way (LLFF's number); one around a scene.
const TURNS: f64 = 2.0;
/// The share of the cameras' spread that the path keeps within.
const SPREAD_PERCENTILE: f64 = 0.8;
/// The path's radius before a single camera, by the distance looked at.
const SINGLE_CAMERA_RADIUS: f64 = 0.03;

/// A closed path of `n` cameras in the middle of `cameras`, all looking at the point where the given
/// cameras' axes meet (least squares).
///
/// Cameras that look one way get an LLFF-style spiral around their centre, with radii from the
/// 80th percentile of their spread along the mean camera's axes. Cameras that surround the point get
/// one orbit around it, at their median distance, that rises and sinks within their heights. A
/// single camera (or several at one place) gets a small circle. `focus_depth` is the distance to look at
/// where the axes don't meet before the cameras: when they are parallel, diverge, or there is only
/// one; without it ten times the cameras' spread, or 1.
///
/// Intrinsics and image size are those of the camera nearest to the centre. Empty when `cameras` is
/// empty or `n` is 0.
///
/// # Units
/// `focus_depth` in world units.
///
/// # Source
/// The spiral is that of LLFF (Mildenhall et al. 2019), `render_path_spiral`.
///
/// ```
/// use dash_kernels::Camera;
/// use dash_train::cameras::spiral;
///
/// let lens = Camera::new(80.0, 80.0, 32.0, 24.0, 64, 48);
/// let rig = [-1.0, 0.0, 1.0].map(|x| lens.clone().look_at([x, 0.0, -4.0], [0.0; 3], [0.0, -1.0, 0.0]));
/// assert_eq!(spiral(&rig, 30, None).len(), 30);
/// ```
pub fn spiral(cameras: &[Camera], n: usize, focus_depth: Option<f64>) -> Vec<Camera> {
    if cameras.is_empty() {
        return Vec::new();
    }
    let positions: Vec<DVec3> = cameras.iter().map(|c| c.position().into()).collect();
    let (centre, spread) = centre_and_spread(&positions);
    let nearest = positions
        .iter()
        .enumerate()
        .min_by(|(_, a), (_, b)| a.distance(centre).total_cmp(&b.distance(centre)))
        .map_or(0, |(index, _)| index);
    let template = &cameras[nearest];
    let mean_axis = |row: usize| {
        let sum: DVec3 = cameras.iter().map(|c| DVec3::from(c.rotation[row])).sum();
        // Cancelled axes say nothing: then the nearest camera's.
        if sum.length() > 1e-3 * cameras.len() as f64 {
            sum.normalize()
        } else {
            DVec3::from(template.rotation[row])
        }
    };
    let up = -mean_axis(1);
    let met = meeting_point(cameras, &positions, centre, spread);
    let eyes_and_target = match met {
        Some(target) if surrounds(&positions, target, up) => {
            (orbit(&positions, target, up, n), target)
        }
        _ => {
            let forward = mean_axis(2);
            let depth = focus_depth.unwrap_or(default_depth(spread));
            let target = met.unwrap_or(centre + forward * depth);
            (before_the_scene(&positions, centre, target, up, n), target)
        }
    };
    let (eyes, target) = eyes_and_target;
    eyes.into_iter()
        .map(|eye| {
            let mut camera = template.clone();
            camera.translation = [0.0; 3];
            camera.look_at(eye, target, up_beside(up, target - eye))
        })
        .collect()
}

/// `up`, or some other direction where one can't look along `forward` with it.
fn up_beside(up: DVec3, forward: DVec3) -> DVec3 {
    if up.cross(forward).length() > 1e-6 * forward.length() {
        up
    } else {
        forward.any_orthogonal_vector()
    }
}

/// Whether no half of the horizon around `target` is without cameras.
fn surrounds(positions: &[DVec3], target: DVec3, up: DVec3) -> bool {
    let (east, north) = up.any_orthonormal_pair();
    let mut angles: Vec<f64> = positions
        .iter()
        .map(|p| (*p - target).dot(north).atan2((*p - target).dot(east)))
        .collect();
    angles.sort_by(f64::total_cmp);
    let across_the_seam = angles[0] + TAU - angles[angles.len() - 1];
    let widest_gap = angles
        .windows(2)
        .map(|pair| pair[1] - pair[0])
        .fold(across_the_seam, f64::max);
    // Two cameras that face each other leave two halves.
    widest_gap <= TAU / 2.0 + 1e-6
}

/// Eyes on a circle around `target`.
fn orbit(positions: &[DVec3], target: DVec3, up: DVec3, n: usize) -> Vec<DVec3> {
    let (east, north) = up.any_orthonormal_pair();
    let distance = quantile(positions.iter().map(|p| p.distance(target)), 0.5);
    let elevations: Vec<f64> = positions
        .iter()
        .map(|p| {
            up.dot((*p - target).normalize_or_zero())
                .clamp(-1.0, 1.0)
                .asin()
        })
        .collect();
    let middle = elevations.iter().sum::<f64>() / elevations.len() as f64;
    let swing = quantile(elevations.iter().map(|e| (e - middle).abs()), 0.5);
    // Straight above, `up` says nothing about the image's orientation.
    let steepest = 80_f64.to_radians();
    angles(n, 1.0)
        .map(|angle| {
            let elevation = (middle + swing * angle.sin()).clamp(-steepest, steepest);
            let level = east * angle.cos() + north * angle.sin();
            target + distance * (level * elevation.cos() + up * elevation.sin())
        })
        .collect()
}

/// Eyes on LLFF's spiral around the cameras' centre.
fn before_the_scene(
    positions: &[DVec3],
    centre: DVec3,
    target: DVec3,
    up: DVec3,
    n: usize,
) -> Vec<DVec3> {
    let forward = (target - centre).normalize();
    let right = forward.cross(up_beside(up, forward)).normalize();
    let axes = [right, right.cross(forward), forward];
    let mut radii = axes.map(|axis| {
        let offsets = positions.iter().map(|p| axis.dot(*p - centre).abs());
        quantile(offsets, SPREAD_PERCENTILE)
    });
    let depth = centre.distance(target);
    if radii[0].max(radii[1]) < 1e-6 * depth {
        radii = [
            SINGLE_CAMERA_RADIUS * depth,
            SINGLE_CAMERA_RADIUS * depth,
            0.0,
        ];
    }
    // Half the distance to the scene at most, so that no eye comes past it.
    radii[2] = radii[2].min(depth / 2.0);
    angles(n, TURNS)
        .map(|angle| {
            centre + axes[0] * (radii[0] * angle.cos()) + axes[1] * (radii[1] * angle.sin())
                - axes[2] * (radii[2] * (angle / 2.0).sin())
        })
        .collect()
}

/// `n` angles over whole turns, without the last, which is the first again.
fn angles(n: usize, turns: f64) -> impl Iterator<Item = f64> {
    (0..n).map(move |i| TAU * turns * i as f64 / n as f64)
}

#[cfg(test)]
mod tests {
    use glam::DMat3;

    use super::*;

    const UP: [f64; 3] = [0.0, 1.0, 0.0];

    fn at(eye: [f64; 3], target: [f64; 3]) -> Camera {
        Camera::new(100.0, 100.0, 40.0, 30.0, 80, 60).look_at(eye, target, UP)
    }

    fn assert_looks_at(camera: &Camera, target: DVec3, tolerance_px: f64) {
        let ([u, v], depth) = camera
            .project(target.into())
            .expect("the target is in front");
        assert!(
            (u - camera.cx).abs() < tolerance_px && (v - camera.cy).abs() < tolerance_px,
            "{u}, {v} at depth {depth}"
        );
        let rotation = DMat3::from_cols_array_2d(&camera.rotation);
        assert!((rotation * rotation.transpose()).abs_diff_eq(DMat3::IDENTITY, 1e-9));
        assert!(camera.rotation[1][1] < 0.0, "upright");
    }

    /// No step is more than `times` the mean step, the one from the last to the first included.
    fn assert_smooth(path: &[Camera], times: f64) {
        let eye = |i: usize| DVec3::from(path[i % path.len()].position());
        let steps: Vec<f64> = (0..path.len())
            .map(|i| eye(i).distance(eye(i + 1)))
            .collect();
        let mean = steps.iter().sum::<f64>() / steps.len() as f64;
        let longest = steps.iter().fold(0.0, |a: f64, b| a.max(*b));
        assert!(
            mean > 0.0 && longest <= times * mean,
            "{longest} against {mean}"
        );
    }

    #[test]
    fn before_a_forward_facing_rig() {
        let target = DVec3::new(0.5, 0.2, 6.0);
        let rig: Vec<Camera> = (0..15)
            .map(|i| {
                at(
                    [(i % 5) as f64 - 2.0, (i / 5) as f64 - 1.0, 0.0],
                    target.into(),
                )
            })
            .collect();
        let path = spiral(&rig, 60, None);
        assert_eq!(path.len(), 60);
        assert_smooth(&path, 2.0);
        for camera in &path {
            assert_looks_at(camera, target, 2.0);
            let [x, y, z] = camera.position();
            assert!(
                x.abs() < 2.0 && y.abs() < 1.01 && z.abs() < 0.5,
                "{x} {y} {z}"
            );
        }
        let widest = path.iter().map(|c| c.position()[0]).fold(0.0, f64::max);
        assert!(widest > 1.0, "{widest}");
    }

    #[test]
    fn around_a_scene() {
        let target = DVec3::new(1.0, -1.0, 2.0);
        let ring: Vec<Camera> = (0..12)
            .map(|i| {
                let angle = TAU * f64::from(i) / 12.0;
                let eye = target + DVec3::new(4.0 * angle.cos(), 1.5, 4.0 * angle.sin());
                at(eye.into(), target.into())
            })
            .collect();
        let path = spiral(&ring, 36, None);
        assert_smooth(&path, 1.01);
        for camera in &path {
            assert_looks_at(camera, target, 0.1);
            let offset = DVec3::from(camera.position()) - target;
            assert!(
                (offset.length() - 18.25_f64.sqrt()).abs() < 1e-2,
                "{offset}"
            );
            assert!((offset.y - 1.5).abs() < 1e-2, "{offset}");
        }
    }

    #[test]
    fn a_single_camera_gets_a_small_circle() {
        let camera = at([1.0, 2.0, 3.0], [1.0, 2.0, 8.0]);
        let path = spiral(std::slice::from_ref(&camera), 24, Some(4.0));
        assert_smooth(&path, 1.01);
        for view in &path {
            assert_looks_at(view, DVec3::new(1.0, 2.0, 7.0), 1e-6);
            let eye = DVec3::from(view.position());
            assert!((eye.distance(DVec3::new(1.0, 2.0, 3.0)) - 0.12).abs() < 1e-9);
        }
        assert_eq!(spiral(&[camera.clone(), camera], 3, None).len(), 3);
    }

    #[test]
    fn parallel_and_diverging_axes_look_at_the_given_depth() {
        let parallel: Vec<Camera> = (0..5)
            .map(|i| {
                at(
                    [f64::from(i) - 2.0, 0.0, 0.0],
                    [f64::from(i) - 2.0, 0.0, 5.0],
                )
            })
            .collect();
        for view in spiral(&parallel, 20, Some(8.0)) {
            assert_looks_at(&view, DVec3::new(0.0, 0.0, 8.0), 1e-6);
        }
        let diverging: Vec<Camera> = (0..5)
            .map(|i| f64::from(i) - 2.0)
            .map(|x| at([x, 0.0, 0.0], [1.5 * x, 0.0, 5.0]))
            .collect();
        for view in spiral(&diverging, 20, None) {
            assert_looks_at(&view, DVec3::new(0.0, 0.0, 20.0), 1e-6);
        }
    }

    #[test]
    fn straight_down_and_face_to_face() {
        let down = Camera::new(100.0, 100.0, 40.0, 30.0, 80, 60);
        let overhead: Vec<Camera> = [[0.0, 5.0, 1.0], [1.0, 5.0, 0.0], [-1.0, 5.0, 0.0]]
            .into_iter()
            .map(|eye| down.clone().look_at(eye, [0.0, 0.0, 0.3], [0.0, 0.0, 1.0]))
            .collect();
        let pair = [
            at([0.0, 0.0, -3.0], [0.0; 3]),
            at([0.0, 0.0, 3.0], [0.0; 3]),
        ];
        for (cameras, target) in [
            (&overhead[..], DVec3::new(0.0, 0.0, 0.3)),
            (&pair, DVec3::ZERO),
        ] {
            for view in spiral(cameras, 10, None) {
                let ([u, v], _) = view.project(target.into()).expect("in front");
                assert!((u - 40.0).abs() < 1.0 && (v - 30.0).abs() < 1.0, "{u} {v}");
            }
        }
    }

    #[test]
    fn nothing_of_nothing() {
        assert!(spiral(&[], 10, None).is_empty());
        assert!(spiral(&[at([0.0; 3], [0.0, 0.0, 1.0])], 0, None).is_empty());
    }
}
