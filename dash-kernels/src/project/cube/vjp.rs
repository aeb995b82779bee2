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

/// The gradient of a scale from that of its logarithm; a scale of zero moves nothing.
#[cube]
fn per_scale(v_log: f32, scale: f32) -> f32 {
    let is_zero = scale == 0.0f32;
    select(is_zero, 0.0f32, v_log / select(is_zero, 1.0f32, scale))
}

#[cube(launch)]
pub(super) fn project_vjp_kernel(
    means: &[f32],
    quats: &[f32],
    scales: &[f32],
    sh_rest: &[f32],
    splats: &[f32],
    v_splats: &[f32],
    v_means: &mut [f32],
    v_quats: &mut [f32],
    v_scales: &mut [f32],
    v_opacities: &mut [f32],
    v_sh_dc: &mut [f32],
    v_sh_rest: &mut [f32],
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
        // v_rows = -2 conic v_conic (conic rows). The conic times the rows are cross products: of a needle, the product
        // of the two cancels to next to nothing, and cross products have components along the Gaussian's own axes.
        let a = splats[at + splats::CONIC_A];
        let b = splats[at + splats::CONIC_B];
        let c = splats[at + splats::CONIC_C];
        let v_a = v_splats[at + splats::CONIC_A];
        let v_b = 0.5f32 * v_splats[at + splats::CONIC_B];
        let v_c = v_splats[at + splats::CONIC_C];
        let normal = f.row0.cross(&f.row1);
        let low_pass = view.low_pass;
        let trace = f.row0.dot(&f.row0) + f.row1.dot(&f.row1);
        let inverse_det = 1.0f32 / (normal.dot(&normal) + low_pass * trace + low_pass * low_pass);
        let across0 = f.row1.cross(&normal);
        let across1 = normal.cross(&f.row0);
        let h0 = across0.plus(&f.row0.scaled(low_pass)).scaled(inverse_det);
        let h1 = across1.plus(&f.row1.scaled(low_pass)).scaled(inverse_det);
        let v_h0 = h0.scaled(v_a).plus(&h1.scaled(v_b));
        let v_h1 = h0.scaled(v_b).plus(&h1.scaled(v_c));
        let v_row0 = v_h0.scaled(-2.0f32 * a).plus(&v_h1.scaled(-2.0f32 * b));
        let v_row1 = v_h0.scaled(-2.0f32 * b).plus(&v_h1.scaled(-2.0f32 * c));
        // By the scales' logarithms.
        let mut v_scale = h0.times(&v_h0).plus(&h1.times(&v_h1)).scaled(-2.0f32);

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
        let through_rows = v_scale.x + v_scale.y + v_scale.z;
        let v_point = Vec3 {
            x: v_ratio_x * inverse_z,
            y: v_ratio_y * inverse_z,
            z: v_splats[at + splats::DEPTH] - (through_ratio + through_rows) * inverse_z,
        };
        let v_colour = clamped_colour_vjp(splats, v_splats, at);
        let v_direction = colour_vjp(
            means,
            sh_rest,
            v_sh_dc,
            v_sh_rest,
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
        let mut v_opacity = v_splats[at + splats::OPACITY];
        if comptime!(form.exp) {
            let value = splats[at + splats::OPACITY];
            v_opacity *= value * (1.0f32 - value);
        } else {
            v_scale.x = per_scale(v_scale.x, f.scale.x);
            v_scale.y = per_scale(v_scale.y, f.scale.y);
            v_scale.z = per_scale(v_scale.z, f.scale.z);
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
