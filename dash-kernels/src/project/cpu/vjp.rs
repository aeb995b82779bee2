//! Gradients of one Gaussian's projection.

use crate::splats::{self, N_COLUMNS, is_finite};

use super::super::{Activation, Gaussians, View};
use super::footprint::Footprint;
use super::linear::{cross, dot, mat_mul, rotation_from_quat_vjp, transpose};
use super::needle::Needle;
use super::{LOW_PASS, all_finite};

/// Gradients of one Gaussian.
pub struct Gradients {
    pub mean: [f32; 3],
    pub quat: [f32; 4],
    pub scale: [f32; 3],
    pub opacity: f32,
}

/// Gradients of a Gaussian that is drawn, where `v_direction` is the mean's gradient through the direction it is seen
/// from; `None` when one is not finite.
#[inline(always)]
pub fn project_one_vjp(
    gaussians: &Gaussians<f32>,
    i: usize,
    view: &View<f32>,
    row: &[f32; N_COLUMNS],
    v_row: &[f32; N_COLUMNS],
    v_direction: [f32; 3],
) -> Option<Gradients> {
    let footprint = Footprint::new(gaussians, i, view)?;
    let needle = match row[splats::ALONG] > 0.0 {
        true => Needle::new(gaussians, i, &footprint, view),
        false => None,
    };
    let (mut v_point, v_axes, mut scale) = footprint_vjp(&footprint, needle, view, row, v_row);
    v_point[2] += v_row[splats::DEPTH];
    let inverse_z = 1.0 / footprint.point[2];
    for k in 0..2 {
        let v_ratio = view.focal[k] * v_row[splats::MEAN_X + k];
        v_point[k] += v_ratio * inverse_z;
        v_point[2] -= v_ratio * footprint.ratio[k] * inverse_z;
    }
    let w = &view.rotation;
    let mean = std::array::from_fn(|k| {
        w[0][k] * v_point[0] + w[1][k] * v_point[1] + w[2][k] * v_point[2] + v_direction[k]
    });
    let v_rotation = mat_mul(&transpose(w), &v_axes);
    let v_unit = rotation_from_quat_vjp(footprint.unit_quat, &v_rotation);
    let unit = footprint.unit_quat;
    let along =
        v_unit[0] * unit[0] + v_unit[1] * unit[1] + v_unit[2] * unit[2] + v_unit[3] * unit[3];
    let quat = std::array::from_fn(|k| (v_unit[k] - along * unit[k]) * footprint.inverse_quat_norm);
    let mut opacity = v_row[splats::OPACITY];
    if view.activation == Activation::Exp {
        let value = row[splats::OPACITY];
        opacity *= value * (1.0 - value);
    } else {
        // A scale of zero moves nothing.
        for (v, s) in scale.iter_mut().zip(footprint.scale) {
            *v = if s == 0.0 { 0.0 } else { *v / s };
        }
    }
    let gradients = Gradients {
        mean,
        quat,
        scale,
        opacity,
    };
    let g = &gradients;
    let finite = all_finite(&[g.mean, g.scale]) && all_finite(&[g.quat]) && is_finite(g.opacity);
    finite.then_some(gradients)
}

/// Gradients of the mean in camera coordinates, of the axes `W R` and of the scales' logarithms,
/// from that of the conic.
#[inline(always)]
fn footprint_vjp(
    f: &Footprint,
    needle: Option<Needle>,
    view: &View<f32>,
    row: &[f32; N_COLUMNS],
    v_row: &[f32; N_COLUMNS],
) -> ([f32; 3], [[f32; 3]; 3], [f32; 3]) {
    let (a, b, c) = (
        row[splats::CONIC_A],
        row[splats::CONIC_B],
        row[splats::CONIC_C],
    );
    let (v_a, v_b, v_c) = (
        v_row[splats::CONIC_A],
        0.5 * v_row[splats::CONIC_B],
        v_row[splats::CONIC_C],
    );
    // v_rows = -2 conic v_conic (conic rows). The conic times the rows are cross products: of a needle, the product of
    // the two cancels to next to nothing, and cross products have components along the Gaussian's own axes.
    let [g0, g1] = f.rows;
    let normal = cross(g0, g1);
    let det = dot(normal, normal) + LOW_PASS * (dot(g0, g0) + dot(g1, g1)) + LOW_PASS * LOW_PASS;
    let (across0, across1) = (cross(g1, normal), cross(normal, g0));
    let inverse_det = 1.0 / det;
    let mut v_rows = [[0.0; 3]; 2];
    let mut v_log_scale = [0.0; 3];
    for k in 0..3 {
        let h0 = (across0[k] + LOW_PASS * g0[k]) * inverse_det;
        let h1 = (across1[k] + LOW_PASS * g1[k]) * inverse_det;
        let (v_h0, v_h1) = (v_a * h0 + v_b * h1, v_b * h0 + v_c * h1);
        v_rows[0][k] = -2.0 * (a * v_h0 + b * v_h1);
        v_rows[1][k] = -2.0 * (b * v_h0 + c * v_h1);
        v_log_scale[k] = -2.0 * (h0 * v_h0 + h1 * v_h1);
    }
    if let Some(needle) = needle {
        needle.add_vjp(v_row, &mut v_rows, &mut v_log_scale);
    }
    let inverse_z = 1.0 / f.point[2];
    let mut v_point = [0.0; 3];
    let mut v_axes = [[0.0; 3]; 3];
    v_point[2] -= (v_log_scale[0] + v_log_scale[1] + v_log_scale[2]) * inverse_z;
    for k in 0..2 {
        let per_depth = view.focal[k] * inverse_z;
        let mut v_slope = 0.0;
        for axis in 0..3 {
            let v_unscaled = v_rows[k][axis] * f.scale[axis] * per_depth;
            v_axes[k][axis] += v_unscaled;
            v_axes[2][axis] -= v_unscaled * f.slope[k];
            v_slope -= v_unscaled * f.axes[2][axis];
        }
        if f.slope[k] == f.ratio[k] {
            v_point[k] += v_slope * inverse_z;
            v_point[2] -= v_slope * f.slope[k] * inverse_z;
        }
    }
    (v_point, v_axes, v_log_scale)
}
