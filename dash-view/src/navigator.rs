//! The eye: orbit, pan, zoom, fly.

use std::f64::consts::PI;

use dash_kernels::Camera;
use glam::{DMat3, DQuat, DVec3};

/// How near to the poles of an orbit the eye comes, radians.
const POLE: f64 = 0.03;
/// Fields of view that are offered, vertical, radians.
const FIELDS_OF_VIEW: [f64; 2] = [0.1, 2.4];
/// The field of view where no camera says one, vertical, radians.
const FIELD_OF_VIEW: f64 = 0.8;

/// An eye that looks at a target.
///
/// Axes are those of cameras in this project: x right, y down, z forward.
///
/// ```
/// use dash_view::navigator::Navigator;
/// use glam::DVec3;
///
/// let mut eye = Navigator::new(DVec3::ZERO, 4.0);
/// eye.orbit(0.3, 0.1);
/// eye.zoom(0.5);
/// let position = DVec3::from(eye.camera(64, 48).position());
/// assert!((position.length() - 2.0).abs() < 1e-9);
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct Navigator {
    pose: Pose,
    home: Pose,
    /// The direction that orbits keep upright, of length one.
    up: DVec3,
}

#[derive(Debug, Clone, PartialEq)]
struct Pose {
    /// The point that orbits turn about.
    target: DVec3,
    /// From the eye to the target.
    distance: f64,
    /// Right, down and forward, as columns.
    axes: DMat3,
    /// Vertical, radians.
    field_of_view: f64,
}

impl Pose {
    fn eye(&self) -> DVec3 {
        self.target - self.axes.z_axis * self.distance
    }
}

impl Navigator {
    /// Looks along z at `target`, y down.
    ///
    /// # Units
    /// `distance` in world units.
    pub fn new(target: DVec3, distance: f64) -> Self {
        let pose = Pose {
            target,
            distance: distance.max(f64::MIN_POSITIVE),
            axes: DMat3::IDENTITY,
            field_of_view: FIELD_OF_VIEW,
        };
        Self {
            home: pose.clone(),
            pose,
            up: -DVec3::Y,
        }
    }

    /// Takes the eye's place as the one that [`Navigator::reset`] returns to.
    pub fn set_home(&mut self) {
        self.home = self.pose.clone();
    }

    /// Returns to where it began.
    pub fn reset(&mut self) {
        self.pose = self.home.clone();
    }

    /// Looks as `camera` does; the target is the point on its axis next to `focus`, or as far as the last one where that is
    /// behind the camera.
    pub fn look_through(&mut self, camera: &Camera, focus: DVec3) {
        let pose = camera.world_from_camera();
        let axes = orthonormal(pose.matrix3);
        let along = (focus - pose.translation).dot(axes.z_axis);
        let distance = match along > 1e-6 * (focus - pose.translation).length() {
            true => along,
            false => self.pose.distance,
        };
        self.pose = Pose {
            target: pose.translation + axes.z_axis * distance,
            distance,
            axes,
            field_of_view: camera.fov_y_radians(),
        };
    }

    /// The direction that orbits keep upright.
    pub fn up(&self) -> DVec3 {
        self.up
    }

    /// Sets the direction that orbits keep upright, and turns the eye upright, where it does not look along it.
    pub fn set_up(&mut self, up: DVec3) {
        let Some(up) = up.try_normalize() else {
            return;
        };
        self.up = up;
        let forward = self.pose.axes.z_axis;
        if let Some(right) = forward.cross(up).try_normalize() {
            self.pose.axes = DMat3::from_cols(right, forward.cross(right), forward);
        }
    }

    /// The field of view, from the top to the bottom of the picture.
    ///
    /// # Units
    /// Radians.
    pub fn field_of_view(&self) -> f64 {
        self.pose.field_of_view
    }

    /// Sets it, within what can be drawn.
    ///
    /// # Units
    /// Radians.
    pub fn set_field_of_view(&mut self, radians: f64) {
        self.pose.field_of_view = radians.clamp(FIELDS_OF_VIEW[0], FIELDS_OF_VIEW[1]);
    }

    /// Turns about the target; positive angles move the scene right and down.
    ///
    /// # Units
    /// Radians.
    pub fn orbit(&mut self, yaw: f64, pitch: f64) {
        let (target, distance) = (self.pose.target, self.pose.distance);
        self.rotate(yaw, pitch);
        self.pose.target = target;
        self.pose.distance = distance;
    }

    /// Turns about the eye; positive angles move the scene right and down.
    ///
    /// # Units
    /// Radians.
    pub fn turn(&mut self, yaw: f64, pitch: f64) {
        let eye = self.pose.eye();
        self.rotate(-yaw, -pitch);
        self.pose.target = eye + self.pose.axes.z_axis * self.pose.distance;
    }

    fn rotate(&mut self, yaw: f64, pitch: f64) {
        let axes = self.pose.axes;
        // Not over the poles, where right becomes left.
        let angle = axes.z_axis.angle_between(self.up);
        let pitch = (angle + pitch).clamp(POLE, PI - POLE) - angle;
        let pitch = DQuat::from_axis_angle(axes.x_axis, -pitch);
        let yaw = DQuat::from_axis_angle(self.up, -yaw);
        self.pose.axes = orthonormal(DMat3::from_quat(yaw * pitch) * axes);
    }

    /// Moves the scene across the picture; 1 is the picture's height at the target.
    pub fn pan(&mut self, right: f64, down: f64) {
        let height = 2.0 * self.pose.distance * (0.5 * self.pose.field_of_view).tan();
        let axes = self.pose.axes;
        self.pose.target -= (axes.x_axis * right + axes.y_axis * down) * height;
    }

    /// Multiplies the distance to the target.
    pub fn zoom(&mut self, factor: f64) {
        let distance = self.pose.distance * factor;
        if distance.is_normal() {
            self.pose.distance = distance;
        }
    }

    /// Moves the eye and the target.
    ///
    /// # Units
    /// Shares of the distance to the target.
    pub fn fly(&mut self, right: f64, down: f64, forward: f64) {
        self.pose.target += self.pose.axes * DVec3::new(right, down, forward) * self.pose.distance;
    }

    /// What the eye sees, in a picture of this size.
    pub fn camera(&self, width: usize, height: usize) -> Camera {
        let (w, h) = (width as f64, height as f64);
        let focal = 0.5 * h / (0.5 * self.pose.field_of_view).tan();
        let rows = self.pose.axes.transpose().to_cols_array_2d();
        Camera::new(focal, focal, 0.5 * w, 0.5 * h, width, height)
            .placed(rows, self.pose.eye().to_array())
    }
}

/// The nearest rotation, but for rounding.
fn orthonormal(axes: DMat3) -> DMat3 {
    DMat3::from_quat(DQuat::from_mat3(&axes).normalize())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn close(a: [f64; 3], b: [f64; 3]) -> bool {
        (DVec3::from(a) - DVec3::from(b)).length() < 1e-9
    }

    #[test]
    fn an_orbit_keeps_the_target_in_the_middle_and_the_horizon_level() {
        let target = DVec3::new(1.0, 2.0, 3.0);
        let mut eye = Navigator::new(target, 4.0);
        for (yaw, pitch) in [(0.3, 0.2), (-1.0, 9.0), (2.0, -9.0), (0.0, 0.5)] {
            eye.orbit(yaw, pitch);
            let camera = eye.camera(80, 60);
            let (pixel, depth) = camera.project(target.to_array()).expect("in front");
            assert!((pixel[0] - 40.0).abs() < 1e-9 && (pixel[1] - 30.0).abs() < 1e-9);
            assert!((depth - 4.0).abs() < 1e-9);
            // Right stays level, down stays down.
            assert!(camera.rotation[0][1].abs() < 1e-9 && camera.rotation[1][1] > 0.0);
        }
    }

    #[test]
    fn drags_move_the_scene_with_the_hand() {
        let point = [0.0, 0.0, 0.0];
        let seen = |eye: &Navigator| eye.camera(60, 60).project(point).expect("in front").0;
        let mut eye = Navigator::new(DVec3::ZERO, 2.0);
        eye.pan(0.25, -0.1);
        let pixel = seen(&eye);
        assert!((pixel[0] - 45.0).abs() < 1e-9 && (pixel[1] - 24.0).abs() < 1e-9);
        // What is before the target goes with the hand, too.
        let mut eye = Navigator::new(DVec3::new(0.0, 0.0, 0.5), 2.5);
        eye.orbit(0.1, 0.1);
        let pixel = seen(&eye);
        assert!(pixel[0] > 30.0 && pixel[1] > 30.0, "{pixel:?}");
        let mut eye = Navigator::new(DVec3::ZERO, 2.0);
        eye.turn(0.1, 0.1);
        let pixel = seen(&eye);
        assert!(pixel[0] > 30.0 && pixel[1] > 30.0, "{pixel:?}");
        assert!(close(eye.camera(60, 60).position(), [0.0, 0.0, -2.0]));
    }

    #[test]
    fn zoom_and_flight_go_along_the_axis() {
        let mut eye = Navigator::new(DVec3::ZERO, 2.0);
        eye.zoom(0.5);
        assert!(close(eye.camera(9, 9).position(), [0.0, 0.0, -1.0]));
        eye.zoom(0.0);
        assert!(close(eye.camera(9, 9).position(), [0.0, 0.0, -1.0]));
        eye.fly(1.0, 0.0, 2.0);
        assert!(close(eye.camera(9, 9).position(), [1.0, 0.0, 1.0]));
        eye.reset();
        assert!(close(eye.camera(9, 9).position(), [0.0, 0.0, -2.0]));
    }

    /// The picture's middle and its height are those of a camera that is looked through.
    #[test]
    fn looks_as_a_camera_does() {
        let camera = Camera::new(50.0, 50.0, 40.0, 30.0, 80, 60).look_at(
            [3.0, -1.0, 2.0],
            [0.2, 0.1, 0.0],
            [0.0, -1.0, 0.2],
        );
        let mut eye = Navigator::new(DVec3::ZERO, 2.0);
        eye.look_through(&camera, DVec3::new(0.2, 0.1, 0.0));
        let seen = eye.camera(80, 60);
        for point in [[0.2, 0.1, 0.0], [0.5, -0.3, 0.4], [-0.2, 0.6, -0.3]] {
            let (expected, _) = camera.project(point).expect("in front");
            let (got, _) = seen.project(point).expect("in front");
            assert!((got[0] - expected[0]).abs() < 1e-6 && (got[1] - expected[1]).abs() < 1e-6);
        }
        // A focus behind the camera is none.
        eye.look_through(&camera, DVec3::new(9.0, -3.0, 6.0));
        assert!(eye.camera(80, 60).translation.iter().all(|v| v.is_finite()));
    }

    #[test]
    fn up_is_where_it_is_said_to_be() {
        let mut eye = Navigator::new(DVec3::ZERO, 2.0);
        eye.set_up(DVec3::X);
        assert!(close(eye.camera(9, 9).rotation[1], [-1.0, 0.0, 0.0]));
        // Along the axis nothing is upright.
        eye.set_up(DVec3::Z);
        assert!(
            eye.camera(9, 9)
                .rotation
                .as_flattened()
                .iter()
                .all(|v| v.is_finite())
        );
        eye.set_up(DVec3::ZERO);
        assert_eq!(eye.up(), DVec3::Z);
    }
}
