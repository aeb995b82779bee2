//! What a Gaussian is projected from, and what the projection keeps for its gradient.

use cubecl::prelude::*;

use super::super::View;
use super::linear::{Mat3, Mat3Launch, Quat, Vec3, Vec3Launch};

/// What a [`View`]'s single precision leaves out, as launched.
#[derive(CubeType, CubeLaunch, Clone, Copy)]
pub(super) struct ViewRest {
    pub rotation: Mat3,
    pub translation: Vec3,
    pub focal_x: f32,
    pub focal_y: f32,
    pub principal_x: f32,
    pub principal_y: f32,
    pub lowest_x: f32,
    pub lowest_y: f32,
    pub highest_x: f32,
    pub highest_y: f32,
    /// What no compiler knows to be 0.
    pub zero: u32,
}

/// What `view` leaves out.
pub(super) fn view_rest(view: &View<f32>) -> ViewRestLaunch {
    let rest = |exact: f64, rounded: f32| (exact - f64::from(rounded)) as f32;
    let pair = |exact: [f64; 2], rounded: [f32; 2]| [0, 1].map(|k| rest(exact[k], rounded[k]));
    let vector = |exact: [f64; 3], rounded: [f32; 3]| {
        let [x, y, z] = [0, 1, 2].map(|k| rest(exact[k], rounded[k]));
        Vec3Launch::new(x, y, z)
    };
    let exact = &view.exact;
    let [x, y, z] = [0, 1, 2].map(|r| vector(exact.rotation[r], view.rotation[r]));
    let focal = pair(exact.focal, view.focal);
    let principal = pair(exact.principal, view.principal);
    let lowest = pair(exact.lowest, view.lowest);
    let highest = pair(exact.highest, view.highest);
    ViewRestLaunch::new(
        Mat3Launch::new(x, y, z),
        vector(exact.translation, view.translation),
        focal[0],
        focal[1],
        principal[0],
        principal[1],
        lowest[0],
        lowest[1],
        highest[0],
        highest[1],
        0,
    )
}

/// A [`View`] as launched.
#[derive(CubeType, CubeLaunch, Clone, Copy)]
pub(super) struct ViewConstants {
    pub origin: Vec3,
    pub rotation: Mat3,
    pub translation: Vec3,
    pub position: Vec3,
    pub focal_x: f32,
    pub focal_y: f32,
    pub principal_x: f32,
    pub principal_y: f32,
    pub width: f32,
    pub height: f32,
    pub lowest_x: f32,
    pub lowest_y: f32,
    pub highest_x: f32,
    pub highest_y: f32,
    pub near_plane: f32,
    pub low_pass: f32,
    pub rest: ViewRest,
}

#[cube]
impl ViewConstants {
    /// Vector from the camera's centre.
    pub fn offset(&self, mean: &Vec3) -> Vec3 {
        Vec3 {
            x: mean.x - self.origin.x - self.position.x,
            y: mean.y - self.origin.y - self.position.y,
            z: mean.z - self.origin.z - self.position.z,
        }
    }

    /// Vector from the origin.
    pub fn relative(&self, mean: &Vec3) -> Vec3 {
        Vec3 {
            x: mean.x - self.origin.x,
            y: mean.y - self.origin.y,
            z: mean.z - self.origin.z,
        }
    }
}

/// The Gaussians' inputs but for opacities and colours.
#[derive(CubeType, CubeLaunch)]
pub(super) struct Ellipsoids {
    pub means: Box<[f32]>,  // [N, 3]
    pub quats: Box<[f32]>,  // [N, 4]
    pub scales: Box<[f32]>, // [N, 3]
}

/// The projected covariance and what leads to it.
#[derive(CubeType, Clone, Copy)]
pub(super) struct Footprint {
    /// Whether nothing culls the Gaussian so far; the rest means little where it is false.
    pub drawn: bool,
    /// The mean in camera coordinates.
    pub point: Vec3,
    /// x/z and y/z.
    pub ratio_x: f32,
    pub ratio_y: f32,
    /// The same, no further than the Jacobian follows.
    pub slope_x: f32,
    pub slope_y: f32,
    pub unit_quat: Quat,
    pub inverse_quat_norm: f32,
    pub scale: Vec3,
    /// `W R`: the Gaussian's axes in camera coordinates, as columns.
    pub axes: Mat3,
    /// The rows of `J W R S`.
    pub row0: Vec3,
    pub row1: Vec3,
}

/// Gradients of the rows of `J W R S`.
#[derive(CubeType, Clone, Copy)]
pub(super) struct RowsGradient {
    pub v_row0: Vec3,
    pub v_row1: Vec3,
    /// Through both rows, of the scales' logarithms.
    pub v_log_scale: Vec3,
}
