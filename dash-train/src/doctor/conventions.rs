//! Ways in which poses are commonly mistaken, and where the cameras' axes meet.

use dash_kernels::Camera;
use glam::{DMat3, DVec3};

/// Length of the mean axis from which on axes are too nearly parallel to meet anywhere: about six
/// degrees from their middle.
const PARALLEL: f64 = 0.995;
/// Share of the cameras that must have a meeting point in front for a convention to be right.
const IN_FRONT: f64 = 0.9;
/// Meeting points are equally close up to this factor and this share of the cameras' distance.
const AS_CLOSE: f64 = 1.5;
const TIE: f64 = 1e-6;
/// Cameras that must have axes for their meeting point to mean something.
const MIN_AXES: usize = 3;

/// What would have to be done to the poses as they were loaded.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Convention {
    /// Camera-to-world and world-to-camera interchanged.
    inverse: bool,
    /// The file's axes, undone before the pose is inverted.
    flip_first: bool,
    /// A turn in the camera's own axes.
    turn: Turn,
    /// In words.
    pub(super) words: &'static str,
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum Turn {
    None,
    /// y and z negated: between OpenGL's and OpenCV's axes.
    Flip,
    /// About the viewing axis, by so many quarters.
    Quarters(i32),
}

const fn convention(
    inverse: bool,
    flip_first: bool,
    turn: Turn,
    words: &'static str,
) -> Convention {
    Convention {
        inverse,
        flip_first,
        turn,
        words,
    }
}

/// Everything that is tried instead of the poses as loaded.
pub(super) const CONVENTIONS: [Convention; 8] = [
    convention(
        false,
        false,
        Turn::Flip,
        "y and z axes negated (OpenGL's axes where OpenCV's were expected, or the other way round)",
    ),
    convention(
        true,
        false,
        Turn::None,
        "poses inverted (camera-to-world where world-to-camera was expected, or the other way round)",
    ),
    convention(
        true,
        true,
        Turn::Flip,
        "poses inverted (world-to-camera with OpenGL's axes where camera-to-world was expected)",
    ),
    convention(
        true,
        false,
        Turn::Flip,
        "poses inverted and then y and z axes negated",
    ),
    convention(
        true,
        true,
        Turn::None,
        "y and z axes negated and then poses inverted",
    ),
    convention(
        false,
        false,
        Turn::Quarters(1),
        "pictures turned by a quarter (columns of the rotation in another order)",
    ),
    convention(
        false,
        false,
        Turn::Quarters(3),
        "pictures turned back by a quarter (columns of the rotation in another order)",
    ),
    convention(
        false,
        false,
        Turn::Quarters(2),
        "pictures turned upside down (x and y axes negated)",
    ),
];

impl Convention {
    /// The camera as it would be.
    pub(super) fn apply(&self, camera: &Camera) -> Camera {
        let mut rotation = rows(camera);
        let mut translation = DVec3::from(camera.translation);
        if self.inverse {
            // The rigid transform itself becomes its inverse; with its file's axes flipped, the
            // flip stood on the other side.
            let flip = DMat3::from_diagonal(DVec3::new(1.0, -1.0, -1.0));
            if self.flip_first {
                (rotation, translation) = (flip * rotation, flip * translation);
            }
            let back = rotation.transpose();
            (rotation, translation) = (back, -(back * translation));
        }
        let turn = match self.turn {
            Turn::None => DMat3::IDENTITY,
            Turn::Flip => DMat3::from_diagonal(DVec3::new(1.0, -1.0, -1.0)),
            Turn::Quarters(n) => DMat3::from_rotation_z(f64::from(n) * std::f64::consts::FRAC_PI_2),
        };
        (rotation, translation) = (turn * rotation, turn * translation);
        let columns = rotation.transpose().to_cols_array_2d();
        Camera {
            rotation: columns,
            translation: translation.into(),
            ..camera.clone()
        }
    }

    /// Whether this moves or turns the viewing axis, so that axes alone can speak for it.
    fn changes_axes(&self) -> bool {
        self.inverse || self.turn == Turn::Flip
    }
}

/// The rotation from world to camera.
fn rows(camera: &Camera) -> DMat3 {
    DMat3::from_cols_array_2d(&camera.rotation).transpose()
}

/// Where cameras' axes meet, and how well.
#[derive(Debug, Clone)]
pub(super) struct Meeting {
    /// The point nearest to all axes (least squares).
    pub(super) point: DVec3,
    /// Whether each camera has it in front.
    pub(super) in_front: Vec<bool>,
    /// Distance of the axes from it, as a share of the cameras' distance (root mean square).
    pub(super) off: f64,
}

impl Meeting {
    /// The meeting point; `None` for few cameras, for cameras in one place, and for parallel axes.
    pub(super) fn of(cameras: &[Camera]) -> Option<Self> {
        if cameras.len() < MIN_AXES {
            return None;
        }
        let n = cameras.len() as f64;
        let axes: Vec<DVec3> = cameras.iter().map(|c| c.forward().into()).collect();
        let positions: Vec<DVec3> = cameras.iter().map(|c| c.position().into()).collect();
        if (axes.iter().sum::<DVec3>() / n).length() > PARALLEL {
            return None;
        }
        let across = |a: DVec3| DMat3::IDENTITY - DMat3::from_cols(a * a.x, a * a.y, a * a.z);
        let mut normal = DMat3::ZERO;
        let mut right_side = DVec3::ZERO;
        for (&axis, &position) in axes.iter().zip(&positions) {
            normal += across(axis) * (1.0 / n);
            right_side += across(axis) * position / n;
        }
        let point = normal.inverse() * right_side;
        if !point.is_finite() {
            return None;
        }
        let depth = |i: usize| axes[i].dot(point - positions[i]);
        let squares =
            |of: &dyn Fn(usize) -> f64| (0..axes.len()).map(|i| of(i).powi(2)).sum::<f64>();
        let distance = squares(&|i| positions[i].distance(point));
        let missed = squares(&|i| (across(axes[i]) * (point - positions[i])).length());
        (distance > 0.0).then(|| Self {
            point,
            in_front: (0..axes.len()).map(|i| depth(i) > 0.0).collect(),
            off: (missed / distance).sqrt(),
        })
    }

    /// Share of the cameras that have the point in front.
    pub(super) fn share(&self) -> f64 {
        let n = self.in_front.iter().filter(|&&front| front).count();
        n as f64 / self.in_front.len().max(1) as f64
    }
}

/// The first, most common convention with which the axes meet in front of the cameras about as closely as
/// with any.
pub(super) fn meeting_in_front(cameras: &[Camera]) -> Option<(Convention, Meeting)> {
    let found: Vec<(Convention, Meeting)> = CONVENTIONS
        .into_iter()
        .filter(Convention::changes_axes)
        .filter_map(|convention| {
            let turned: Vec<Camera> = cameras.iter().map(|c| convention.apply(c)).collect();
            Some((convention, Meeting::of(&turned)?))
        })
        .filter(|(_, meeting)| meeting.share() > IN_FRONT)
        .collect();
    let closest = found.iter().map(|f| f.1.off).fold(f64::INFINITY, f64::min);
    found
        .into_iter()
        .find(|f| f.1.off <= AS_CLOSE * closest + TIE)
}
