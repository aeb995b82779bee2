//! A Gaussian's footprint in the picture, in single precision.

use crate::splats::is_finite;

use super::super::{Activation, Gaussians, View};
use super::linear::{dot, mat_mul, rotation_from_quat};
use super::{all_finite, from_origin, vector};

/// Quaternions with a smaller squared length are culled.
const MIN_QUAT_NORM_SQUARED: f32 = 1e-12;

/// The projected covariance and what leads to it.
pub struct Footprint {
    pub point: [f32; 3],
    /// x/z and y/z.
    pub ratio: [f32; 2],
    /// The same, no further than the Jacobian follows.
    pub slope: [f32; 2],
    pub unit_quat: [f32; 4],
    pub inverse_quat_norm: f32,
    pub scale: [f32; 3],
    /// `W R`: the Gaussian's axes in camera coordinates, as columns.
    pub axes: [[f32; 3]; 3],
    /// The rows of `J W R S`.
    pub rows: [[f32; 3]; 2],
}

impl Footprint {
    /// `None` when the Gaussian is to be culled before anything is projected.
    #[inline(always)]
    pub fn new(gaussians: &Gaussians<f32>, i: usize, view: &View<f32>) -> Option<Self> {
        let mean = from_origin(gaussians, i, view);
        let w = &view.rotation;
        let point: [f32; 3] = std::array::from_fn(|r| dot(w[r], mean) + view.translation[r]);
        // In the positive form, so that NaN is culled too.
        let in_front = point[2] >= view.near_plane;
        if !in_front {
            return None;
        }
        let quat: [f32; 4] = vector(gaussians.quats, i);
        let raw_scale: [f32; 3] = vector(gaussians.scales, i);
        if !all_finite(&[mean, raw_scale, point]) || !all_finite(&[quat]) {
            return None;
        }
        let norm_squared =
            quat[0] * quat[0] + quat[1] * quat[1] + quat[2] * quat[2] + quat[3] * quat[3];
        if norm_squared < MIN_QUAT_NORM_SQUARED || !is_finite(norm_squared) {
            return None;
        }
        let inverse_quat_norm = 1.0 / norm_squared.sqrt();
        let unit_quat = quat.map(|q| q * inverse_quat_norm);
        let scale = match view.activation {
            Activation::Exp => raw_scale.map(f32::exp),
            Activation::Linear => raw_scale,
        };
        let axes = mat_mul(w, &rotation_from_quat(unit_quat));
        let inverse_z = 1.0 / point[2];
        let ratio = [point[0] * inverse_z, point[1] * inverse_z];
        let slope = [0, 1].map(|k| ratio[k].max(view.lowest[k]).min(view.highest[k]));
        let rows = [0, 1].map(|k| {
            let per_depth = view.focal[k] * inverse_z;
            std::array::from_fn(|axis| {
                per_depth * (axes[k][axis] - slope[k] * axes[2][axis]) * scale[axis]
            })
        });
        Some(Self {
            point,
            ratio,
            slope,
            unit_quat,
            inverse_quat_norm,
            scale,
            axes,
            rows,
        })
    }
}
