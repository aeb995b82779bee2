//! Cameras between keyframes.

use dash_kernels::Camera;
use glam::{DAffine3, DMat3, DQuat, DVec3};

/// A camera at a time.
#[derive(Debug, Clone, PartialEq)]
pub struct PathCamera {
    /// Pose and intrinsics.
    pub camera: Camera,
    /// In [0, 1] over the clip.
    pub time: f32,
}

/// `n` cameras on a smooth path through keyframes, evenly from the first to the last; all of the first's size. Nothing
/// without keyframes.
///
/// Positions follow a Catmull-Rom spline, rotations the shortest turn; fields of view and times are interpolated linearly.
///
/// ```
/// use dash_kernels::Camera;
/// use dash_view::camera_path::{PathCamera, between};
///
/// let lens = Camera::new(80.0, 80.0, 32.0, 24.0, 64, 48);
/// let key = |x: f64, time: f32| PathCamera {
///     camera: lens.clone().look_at([x, 0.0, -4.0], [0.0; 3], [0.0, -1.0, 0.0]),
///     time,
/// };
/// let path = between(&[key(-1.0, 0.0), key(1.0, 1.0)], 5);
/// assert_eq!((path.len(), path[2].time), (5, 0.5));
/// ```
pub fn between(keyframes: &[PathCamera], n: usize) -> Vec<PathCamera> {
    let (Some(first), Some(last)) = (keyframes.first(), keyframes.len().checked_sub(1)) else {
        return Vec::new();
    };
    let (width, height) = (first.camera.width, first.camera.height);
    let keys: Vec<Key> = keyframes.iter().map(Key::of).collect();
    let camera = |index: usize| {
        let place = last as f64 * index as f64 / n.saturating_sub(1).max(1) as f64;
        let from = (place as usize).min(last);
        let key = |offset: isize| &keys[from.saturating_add_signed(offset).min(last)];
        let share = place - from as f64;
        let at = Key::between([key(-1), key(0), key(1), key(2)], share);
        at.camera(width, height)
    };
    (0..n).map(camera).collect()
}

/// A keyframe in values that can be interpolated.
struct Key {
    position: DVec3,
    rotation: DQuat,
    /// Focal lengths and principal point by the picture's height.
    intrinsics: [f64; 4],
    time: f64,
}

impl Key {
    fn of(keyframe: &PathCamera) -> Self {
        let camera = &keyframe.camera;
        let pose = camera.world_from_camera();
        let (w, h) = (camera.width as f64, camera.height as f64);
        Self {
            position: pose.translation,
            rotation: DQuat::from_mat3(&pose.matrix3).normalize(),
            intrinsics: [
                camera.fx / h,
                camera.fy / h,
                (camera.cx - 0.5 * w) / h,
                (camera.cy - 0.5 * h) / h,
            ],
            time: f64::from(keyframe.time),
        }
    }

    /// At a share of the way from the second to the third.
    fn between([before, from, to, after]: [&Self; 4], share: f64) -> Self {
        let mix = |a: f64, b: f64| a + (b - a) * share;
        let (leaves, arrives) = (
            0.5 * (to.position - before.position),
            0.5 * (after.position - from.position),
        );
        let (s, s2, s3) = (share, share * share, share * share * share);
        let position = from.position * (2.0 * s3 - 3.0 * s2 + 1.0)
            + leaves * (s3 - 2.0 * s2 + s)
            + to.position * (3.0 * s2 - 2.0 * s3)
            + arrives * (s3 - s2);
        Self {
            position,
            rotation: from.rotation.slerp(to.rotation, share),
            intrinsics: std::array::from_fn(|k| mix(from.intrinsics[k], to.intrinsics[k])),
            time: mix(from.time, to.time),
        }
    }

    fn camera(&self, width: usize, height: usize) -> PathCamera {
        let (w, h) = (width as f64, height as f64);
        let [fx, fy, cx, cy] = self.intrinsics.map(|value| value * h);
        let camera = Camera::new(fx, fy, cx + 0.5 * w, cy + 0.5 * h, width, height);
        let rows = DMat3::from_quat(self.rotation).transpose();
        PathCamera {
            camera: camera.placed(rows.to_cols_array_2d(), self.position.to_array()),
            time: self.time as f32,
        }
    }
}

/// The camera's eye, and the corners of its picture at a depth, in world coordinates.
pub fn frustum(camera: &Camera, depth: f64) -> [[f64; 3]; 5] {
    let world_from_camera: DAffine3 = camera.world_from_camera();
    let (w, h) = (camera.width as f64, camera.height as f64);
    let corner = |x, y| camera.unproject([x, y], depth);
    [
        world_from_camera.translation.to_array(),
        corner(0.0, 0.0),
        corner(w, 0.0),
        corner(w, h),
        corner(0.0, h),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn key(eye: [f64; 3], focal: f64, time: f32) -> PathCamera {
        let camera = Camera::new(focal, focal, 40.0, 30.0, 80, 60);
        PathCamera {
            camera: camera.look_at(eye, [0.0; 3], [0.0, -1.0, 0.0]),
            time,
        }
    }

    #[test]
    fn a_path_goes_through_its_keyframes() {
        let keys = [
            key([0.0, 0.0, -3.0], 50.0, 0.0),
            key([3.0, 0.5, 0.0], 60.0, 0.4),
            key([0.0, -1.0, 3.0], 50.0, 1.0),
        ];
        let path = between(&keys, 5);
        for (key, found) in keys.iter().zip(path.iter().step_by(2)) {
            let pairs = [(&key.camera, &found.camera)];
            for (a, b) in pairs {
                let rotation = a.rotation.as_flattened().iter();
                let off = rotation.zip(b.rotation.as_flattened()).map(|(a, b)| a - b);
                assert!(off.fold(0.0, |m: f64, v| m.max(v.abs())) < 1e-9);
                assert!((DVec3::from(a.position()) - DVec3::from(b.position())).length() < 1e-9);
                assert!((a.fx - b.fx).abs() < 1e-9 && (a.cx - b.cx).abs() < 1e-9);
            }
            assert!((key.time - found.time).abs() < 1e-6);
        }
        assert!((path[1].time - 0.2).abs() < 1e-6 && (path[1].camera.fx - 55.0).abs() < 1e-9);
    }

    #[test]
    fn one_keyframe_stands_still_and_none_is_no_path() {
        let keys = [key([0.0, 0.0, -3.0], 50.0, 0.3)];
        let path = between(&keys, 4);
        assert_eq!(path.len(), 4);
        assert!(path.iter().all(|camera| *camera == path[0]));
        assert!(between(&[], 4).is_empty() && between(&keys, 0).is_empty());
    }
}
