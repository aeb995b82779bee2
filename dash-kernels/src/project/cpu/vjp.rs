//! Gradients of one Gaussian's projection.

use crate::splats::{self, N_COLUMNS, is_finite};

use super::super::sh::sh_basis_vjp;
use super::super::{Activation, Gaussians, View};
use super::linear::{dot, mat_mul, rotation_from_quat_vjp, transpose};
use super::{Footprint, all_finite, clamped_colour_vjp, direction};

/// Gradients of one Gaussian.
pub struct Gradients {
    pub mean: [f32; 3],
    pub quat: [f32; 4],
    pub scale: [f32; 3],
    pub opacity: f32,
}

/// `None` when the Gaussian was culled, or when its gradient is not finite.
#[inline(always)]
pub fn project_one_vjp(
    gaussians: &Gaussians<f32>,
    i: usize,
    view: &View<f32>,
    row: &[f32; N_COLUMNS],
    v_row: &[f32; N_COLUMNS],
) -> Option<Gradients> {
    if row[splats::RADIUS_X] <= 0.0 {
        return None;
    }
    let footprint = Footprint::new(gaussians, i, view)?;
    let (mut v_point, v_axes, mut scale) = footprint_vjp(&footprint, view, row, v_row);
    v_point[2] += v_row[splats::DEPTH];
    let inverse_z = 1.0 / footprint.point[2];
    for k in 0..2 {
        let v_ratio = view.focal[k] * v_row[splats::MEAN_X + k];
        v_point[k] += v_ratio * inverse_z;
        v_point[2] -= v_ratio * footprint.ratio[k] * inverse_z;
    }
    let w = &view.rotation;
    let v_direction = direction_vjp(gaussians, i, view, clamped_colour_vjp(row, v_row));
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
        for (v, s) in scale.iter_mut().zip(footprint.scale) {
            *v *= s;
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

/// Gradients of the mean in camera coordinates, of the axes `W R` and of the (activated) scales,
/// from that of the conic.
#[inline(always)]
fn footprint_vjp(
    f: &Footprint,
    view: &View<f32>,
    row: &[f32; N_COLUMNS],
    v_row: &[f32; N_COLUMNS],
) -> ([f32; 3], [[f32; 3]; 3], [f32; 3]) {
    // v_cov = -conic v_conic conic, written out for symmetric matrices.
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
    let left = [
        [a * v_a + b * v_b, a * v_b + b * v_c],
        [b * v_a + c * v_b, b * v_b + c * v_c],
    ];
    let v_xx = -(left[0][0] * a + left[0][1] * b);
    let v_xy = -(left[0][0] * b + left[0][1] * c);
    let v_yy = -(left[1][0] * b + left[1][1] * c);

    let [g0, g1] = f.rows;
    let v_rows: [[f32; 3]; 2] = [
        std::array::from_fn(|k| 2.0 * (v_xx * g0[k] + v_xy * g1[k])),
        std::array::from_fn(|k| 2.0 * (v_xy * g0[k] + v_yy * g1[k])),
    ];
    let inverse_z = 1.0 / f.point[2];
    let mut v_point = [0.0; 3];
    let mut v_axes = [[0.0; 3]; 3];
    let mut v_scale = [0.0; 3];
    for k in 0..2 {
        let per_depth = view.focal[k] * inverse_z;
        let mut v_slope = 0.0;
        for axis in 0..3 {
            let unscaled = per_depth * (f.axes[k][axis] - f.slope[k] * f.axes[2][axis]);
            v_scale[axis] += v_rows[k][axis] * unscaled;
            let v_unscaled = v_rows[k][axis] * f.scale[axis] * per_depth;
            v_axes[k][axis] += v_unscaled;
            v_axes[2][axis] -= v_unscaled * f.slope[k];
            v_slope -= v_unscaled * f.axes[2][axis];
        }
        v_point[2] -= dot(v_rows[k], f.rows[k]) * inverse_z;
        if f.slope[k] == f.ratio[k] {
            v_point[k] += v_slope * inverse_z;
            v_point[2] -= v_slope * f.slope[k] * inverse_z;
        }
    }
    (v_point, v_axes, v_scale)
}

/// Gradient of the mean through the direction it is seen from.
#[inline(always)]
fn direction_vjp(
    gaussians: &Gaussians<f32>,
    i: usize,
    view: &View<f32>,
    v_colour: [f32; 3],
) -> [f32; 3] {
    if view.sh_degree == 0 {
        return [0.0; 3];
    }
    let n_active = (view.sh_degree + 1) * (view.sh_degree + 1);
    let width = 3 * gaussians.n_coeffs;
    let coeffs = &gaussians.sh_coeffs[i * width..i * width + 3 * n_active];
    let mut v_basis = [0.0; 16];
    for (v, coeffs) in v_basis.iter_mut().zip(coeffs.chunks_exact(3)) {
        *v = v_colour[0] * coeffs[0] + v_colour[1] * coeffs[1] + v_colour[2] * coeffs[2];
    }
    let (direction, distance) = direction(gaussians, i, view);
    let v_direction = sh_basis_vjp(direction, view.sh_degree, &v_basis);
    let along = dot(v_direction, direction);
    std::array::from_fn(|k| (v_direction[k] - along * direction[k]) / distance)
}
