//! Rigid transforms of objects.

use glam::{DMat3, DVec3};

/// A rigid transform from object to world coordinates.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pose {
    /// Rotation.
    pub rotation: DMat3,
    /// The object's origin in the world.
    pub position: DVec3,
}

impl Pose {
    /// At `position`, turned by `yaw_radians` about the vertical.
    pub fn new(position: DVec3, yaw_radians: f64) -> Self {
        Self {
            rotation: DMat3::from_rotation_y(yaw_radians),
            position,
        }
    }

    /// A world point in the object's coordinates.
    pub fn to_object(&self, point: DVec3) -> DVec3 {
        self.rotation.transpose() * (point - self.position)
    }

    /// First `inner`, then `self`.
    pub fn then_from(&self, inner: &Self) -> Self {
        Self {
            rotation: self.rotation * inner.rotation,
            position: self.position + self.rotation * inner.position,
        }
    }
}
