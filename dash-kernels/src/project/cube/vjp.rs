//! Gradients of one Gaussian's projection.

use cubecl::prelude::*;

use crate::cube::is_finite;
use crate::splats::{self, N_COLUMNS};

use super::Form;
use super::footprint::{Mat3, Quat, Vec3, ViewConstants, footprint_of};
use super::sh::colour_vjp;

/// Gradient of the colour before it was clamped at zero.
#[cube]
fn clamped_colour_vjp(splats: &[f32], v_splats: &[f32], at: usize) -> Vec3 {
    let red = splats[at + splats::RED] > 0.0f32;
    let green = splats[at + splats::GREEN] > 0.0f32;
    let blue = splats[at + splats::BLUE] > 0.0f32;
    Vec3 {
        x: select(red, v_splats[at + splats::RED], 0.0f32),
        y: select(green, v_splats[at + splats::GREEN], 0.0f32),
        z: select(blue, v_splats[at + splats::BLUE], 0.0f32),
    }
}

#[cube(launch)]
pub(super) fn project_vjp_kernel(
    means: &[f32],
    quats: &[f32],
    scales: &[f32],
    sh_coeffs: &[f32],
    splats: &[f32],
    v_splats: &[f32],
    v_means: &mut [f32],
    v_quats: &mut [f32],
    v_scales: &mut [f32],
    v_opacities: &mut [f32],
    v_sh_coeffs: &mut [f32],
    view: ViewConstants,
    n: u32,
    #[comptime] form: Form,
    #[comptime] with_sh_coeffs: bool,
) {
    let i = ABSOLUTE_POS;
    if i >= n as usize {
        terminate!();
    }
    let at = i * N_COLUMNS;
    #[unroll]
    for k in 0..3 {
        v_means[3 * i + k] = 0.0f32;
        v_scales[3 * i + k] = 0.0f32;
    }
    #[unroll]
    for k in 0..4 {
        v_quats[4 * i + k] = 0.0f32;
    }
    v_opacities[i] = 0.0f32;
    if splats[at + splats::RADIUS_X] > 0.0f32 {
        let f = footprint_of(means, quats, scales, i, &view, form.exp);
        // v_cov = -conic v_conic conic, written out for symmetric matrices.
        let a = splats[at + splats::CONIC_A];
        let b = splats[at + splats::CONIC_B];
        let c = splats[at + splats::CONIC_C];
        let v_a = v_splats[at + splats::CONIC_A];
        let v_b = 0.5f32 * v_splats[at + splats::CONIC_B];
        let v_c = v_splats[at + splats::CONIC_C];
        let left_xx = a * v_a + b * v_b;
        let left_xy = a * v_b + b * v_c;
        let left_yx = b * v_a + c * v_b;
        let left_yy = b * v_b + c * v_c;
        let v_xx = -(left_xx * a + left_xy * b);
        let v_xy = -(left_xx * b + left_xy * c);
        let v_yy = -(left_yx * b + left_yy * c);
        let v_row0 = f
            .row0
            .scaled(2.0f32 * v_xx)
            .plus(&f.row1.scaled(2.0f32 * v_xy));
        let v_row1 = f
            .row0
            .scaled(2.0f32 * v_xy)
            .plus(&f.row1.scaled(2.0f32 * v_yy));

        let inverse_z = 1.0f32 / f.point.z;
        let v_unscaled0 = v_row0.times(&f.scale).scaled(view.focal_x * inverse_z);
        let v_unscaled1 = v_row1.times(&f.scale).scaled(view.focal_y * inverse_z);
        let v_slope_x = select(f.slope_x == f.ratio_x, -v_unscaled0.dot(&f.axes.z), 0.0f32);
        let v_slope_y = select(f.slope_y == f.ratio_y, -v_unscaled1.dot(&f.axes.z), 0.0f32);
        let v_third = v_unscaled0
            .scaled(-f.slope_x)
            .plus(&v_unscaled1.scaled(-f.slope_y));
        let v_axes = Mat3 {
            x: v_unscaled0,
            y: v_unscaled1,
            z: v_third,
        };
        let v_ratio_x = view.focal_x * v_splats[at + splats::MEAN_X] + v_slope_x;
        let v_ratio_y = view.focal_y * v_splats[at + splats::MEAN_Y] + v_slope_y;
        let through_ratio = v_ratio_x * f.ratio_x + v_ratio_y * f.ratio_y;
        let through_rows = v_row0.dot(&f.row0) + v_row1.dot(&f.row1);
        let v_point = Vec3 {
            x: v_ratio_x * inverse_z,
            y: v_ratio_y * inverse_z,
            z: v_splats[at + splats::DEPTH] - (through_ratio + through_rows) * inverse_z,
        };
        let v_colour = clamped_colour_vjp(splats, v_splats, at);
        let v_direction = colour_vjp(
            means,
            sh_coeffs,
            v_sh_coeffs,
            i,
            &view,
            &v_colour,
            form.sh_degree,
            form.n_coeffs,
            with_sh_coeffs,
        );
        let rotation = view.rotation();
        let v_mean = rotation
            .transposed_times_vector(&v_point)
            .plus(&v_direction);
        let v_rotation = rotation.transposed().times(&v_axes);
        let v_unit = f.unit_quat.rotation_vjp(&v_rotation);
        let along = v_unit.dot(&f.unit_quat);
        let norm = f.inverse_quat_norm;
        let v_quat = Quat {
            w: (v_unit.w - along * f.unit_quat.w) * norm,
            x: (v_unit.x - along * f.unit_quat.x) * norm,
            y: (v_unit.y - along * f.unit_quat.y) * norm,
            z: (v_unit.z - along * f.unit_quat.z) * norm,
        };
        let mut v_scale = v_row0.times(&f.unscaled0).plus(&v_row1.times(&f.unscaled1));
        let mut v_opacity = v_splats[at + splats::OPACITY];
        if comptime!(form.exp) {
            let value = splats[at + splats::OPACITY];
            v_opacity *= value * (1.0f32 - value);
            v_scale.x *= f.scale.x;
            v_scale.y *= f.scale.y;
            v_scale.z *= f.scale.z;
        }
        let finite = v_mean.is_finite()
            && v_scale.is_finite()
            && is_finite(v_opacity)
            && is_finite(v_quat.w)
            && is_finite(v_quat.x)
            && is_finite(v_quat.y)
            && is_finite(v_quat.z);
        if f.drawn && finite {
            v_means[3 * i] = v_mean.x;
            v_means[3 * i + 1] = v_mean.y;
            v_means[3 * i + 2] = v_mean.z;
            v_scales[3 * i] = v_scale.x;
            v_scales[3 * i + 1] = v_scale.y;
            v_scales[3 * i + 2] = v_scale.z;
            v_quats[4 * i] = v_quat.w;
            v_quats[4 * i + 1] = v_quat.x;
            v_quats[4 * i + 2] = v_quat.y;
            v_quats[4 * i + 3] = v_quat.z;
            v_opacities[i] = v_opacity;
        }
    }
}
