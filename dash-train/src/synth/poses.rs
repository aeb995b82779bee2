//! Poses and depth bounds as file formats state them.

use dash_kernels::Camera;
use glam::{DMat3, DQuat};

/// Room left between the bounds and the nearest and farthest surface.
const BOUNDS_MARGIN: f64 = 0.1;

/// World to camera as a quaternion (w, x, y, z).
pub(super) fn quaternion(camera: &Camera) -> [f64; 4] {
    let rows = DMat3::from_cols_array_2d(&camera.rotation);
    let q = DQuat::from_mat3(&rows.transpose());
    [q.w, q.x, q.y, q.z]
}

/// Camera-to-world with OpenGL axes: right, up, backwards.
pub(super) fn opengl_world_from_camera(camera: &Camera) -> [[f64; 4]; 4] {
    let [right, down, forward] = camera.rotation;
    let position = camera.position();
    let row = |axis: usize| [right[axis], -down[axis], -forward[axis], position[axis]];
    [row(0), row(1), row(2), [0.0, 0.0, 0.0, 1.0]]
}

/// Near and far, around the depths that a camera sees.
pub(super) fn bounds([near, far]: [f64; 2]) -> [f64; 2] {
    [near * (1.0 - BOUNDS_MARGIN), far * (1.0 + BOUNDS_MARGIN)]
}
