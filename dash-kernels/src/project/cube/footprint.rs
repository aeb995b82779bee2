//! The projected covariance of one Gaussian, and its gradient.

use cubecl::prelude::*;

use crate::cube::is_finite;
use crate::splats::{self, N_COLUMNS};

use super::linear::{Mat3, Quat, Vec3};
use super::needle::needle_of;
use super::values::{Ellipsoids, Footprint, RowsGradient, ViewConstants};

/// Quaternions with a smaller squared length are culled.
const MIN_QUAT_NORM_SQUARED: f32 = 1e-12;

/// A row of `J W R S` from those of `W R`.
#[cube]
fn projected_row(along: &Vec3, depth: &Vec3, slope: f32, factor: f32, scale: &Vec3) -> Vec3 {
    let row = along.plus(&depth.scaled(-slope));
    row.scaled(factor).times(scale)
}

/// The footprint of Gaussian `i`.
#[cube]
pub(super) fn footprint_of(
    gaussians: &Ellipsoids,
    i: usize,
    view: &ViewConstants,
    #[comptime] exp: bool,
) -> Footprint {
    let mean = Vec3::read(&gaussians.means, i);
    let from_origin = view.relative(&mean);
    let rotated = view.rotation.times_vector(&from_origin);
    let point = rotated.plus(&view.translation);
    let raw_scale = Vec3::read(&gaussians.scales, i);
    let quat = Quat::read(&gaussians.quats, i);
    let norm_squared = quat.dot(&quat);
    let drawn = point.z >= view.near_plane
        && mean.is_finite()
        && raw_scale.is_finite()
        && point.is_finite()
        && is_finite(norm_squared)
        && norm_squared >= MIN_QUAT_NORM_SQUARED;
    let inverse_quat_norm = 1.0f32 / norm_squared.sqrt();
    let unit_quat = quat.scaled(inverse_quat_norm);
    let scale = if comptime!(exp) {
        raw_scale.exponentials()
    } else {
        raw_scale
    };
    let axes = view.rotation.times(&unit_quat.rotation());
    let inverse_z = 1.0f32 / point.z;
    let ratio_x = point.x * inverse_z;
    let ratio_y = point.y * inverse_z;
    let slope_x = f32::min(f32::max(ratio_x, view.lowest_x), view.highest_x);
    let slope_y = f32::min(f32::max(ratio_y, view.lowest_y), view.highest_y);
    let (factor_x, factor_y) = (view.focal_x * inverse_z, view.focal_y * inverse_z);
    let row0 = projected_row(&axes.x, &axes.z, slope_x, factor_x, &scale);
    let row1 = projected_row(&axes.y, &axes.z, slope_y, factor_y, &scale);
    Footprint {
        drawn,
        point,
        ratio_x,
        ratio_y,
        slope_x,
        slope_y,
        unit_quat,
        inverse_quat_norm,
        scale,
        axes,
        row0,
        row1,
    }
}

/// `v_rows = -2 conic v_conic (conic rows)`.
///
/// The conic times the rows are cross products: of a needle, the product of the two cancels to next to nothing, and
/// cross products have components along the Gaussian's own axes.
#[cube]
fn rows_vjp(
    f: &Footprint,
    splats: &[f32],   // [N, C]
    v_splats: &[f32], // [N, C]
    at: usize,
    low_pass: f32,
) -> RowsGradient {
    let a = splats[at + splats::CONIC_A];
    let b = splats[at + splats::CONIC_B];
    let c = splats[at + splats::CONIC_C];
    let v_a = v_splats[at + splats::CONIC_A];
    let v_b = 0.5f32 * v_splats[at + splats::CONIC_B];
    let v_c = v_splats[at + splats::CONIC_C];
    let normal = f.row0.cross(&f.row1);
    let trace = f.row0.dot(&f.row0) + f.row1.dot(&f.row1);
    let inverse_det = 1.0f32 / (normal.dot(&normal) + low_pass * trace + low_pass * low_pass);
    let across0 = f.row1.cross(&normal);
    let across1 = normal.cross(&f.row0);
    let h0 = across0.plus(&f.row0.scaled(low_pass)).scaled(inverse_det);
    let h1 = across1.plus(&f.row1.scaled(low_pass)).scaled(inverse_det);
    let v_h0 = h0.scaled(v_a).plus(&h1.scaled(v_b));
    let v_h1 = h0.scaled(v_b).plus(&h1.scaled(v_c));
    RowsGradient {
        v_row0: v_h0.scaled(-2.0f32 * a).plus(&v_h1.scaled(-2.0f32 * b)),
        v_row1: v_h0.scaled(-2.0f32 * b).plus(&v_h1.scaled(-2.0f32 * c)),
        v_log_scale: h0.times(&v_h0).plus(&h1.times(&v_h1)).scaled(-2.0f32),
    }
}

/// Gradients of what a [`Footprint`] is made of.
#[derive(CubeType, Clone, Copy)]
pub(super) struct FootprintGradient {
    /// Of the mean in camera coordinates.
    pub v_point: Vec3,
    /// Of the unnormalised quaternion.
    pub v_quat: Quat,
    /// Of the scales' logarithms.
    pub v_log_scale: Vec3,
}

/// The pullback of [`footprint_of`]: through the centre, the conic and the depth of splat `i`.
#[cube]
pub(super) fn footprint_vjp(
    gaussians: &Ellipsoids,
    i: usize,
    f: &Footprint,
    splats: &[f32],   // [N, C]
    v_splats: &[f32], // [N, C]
    view: &ViewConstants,
) -> FootprintGradient {
    let at = i * N_COLUMNS;
    let mut rows = rows_vjp(f, splats, v_splats, at, view.low_pass);
    if splats[at + splats::ALONG] > 0.0f32 {
        let more = needle_of(gaussians, i, f, view).vjp(v_splats, at);
        rows.v_row0.add(&more.v_row0);
        rows.v_row1.add(&more.v_row1);
        rows.v_log_scale.add(&more.v_log_scale);
    }
    let v_log_scale = rows.v_log_scale;
    let inverse_z = 1.0f32 / f.point.z;
    let v_unscaled0 = rows.v_row0.times(&f.scale).scaled(view.focal_x * inverse_z);
    let v_unscaled1 = rows.v_row1.times(&f.scale).scaled(view.focal_y * inverse_z);
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
    let through_rows = v_log_scale.x + v_log_scale.y + v_log_scale.z;
    let v_point = Vec3 {
        x: v_ratio_x * inverse_z,
        y: v_ratio_y * inverse_z,
        z: v_splats[at + splats::DEPTH] - (through_ratio + through_rows) * inverse_z,
    };
    let v_rotation = view.rotation.transposed().times(&v_axes);
    let v_unit = f.unit_quat.rotation_vjp(&v_rotation);
    let along = v_unit.dot(&f.unit_quat);
    let norm = f.inverse_quat_norm;
    let v_quat = Quat {
        w: (v_unit.w - along * f.unit_quat.w) * norm,
        x: (v_unit.x - along * f.unit_quat.x) * norm,
        y: (v_unit.y - along * f.unit_quat.y) * norm,
        z: (v_unit.z - along * f.unit_quat.z) * norm,
    };
    FootprintGradient {
        v_point,
        v_quat,
        v_log_scale,
    }
}
