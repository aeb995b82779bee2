//! Needles in two floats: what one says of them is off by pixels at their far ends. The kernels' form of the CPU's.

use cubecl::prelude::*;

use crate::cube::is_finite;
use crate::cube::two_float::TwoFloat;
use crate::splats::{self, NEEDLE};

use super::linear::{Quat, Vec3};
use super::values::{Ellipsoids, Footprint, RowsGradient, ViewConstants};

/// Beyond it the inverse is no normal number.
const MAX_VARIANCE: f32 = 1e37;

/// Three coordinates.
#[derive(CubeType, Clone, Copy)]
struct WideVec3 {
    x: TwoFloat,
    y: TwoFloat,
    z: TwoFloat,
}

#[cube]
impl WideVec3 {
    fn new(hi: &Vec3, lo: &Vec3) -> WideVec3 {
        WideVec3 {
            x: TwoFloat::new(hi.x, lo.x),
            y: TwoFloat::new(hi.y, lo.y),
            z: TwoFloat::new(hi.z, lo.z),
        }
    }

    fn dot(&self, other: &WideVec3, zero: u32) -> TwoFloat {
        let sum = self.x.times(&other.x, zero);
        let sum = sum.plus(&self.y.times(&other.y, zero), zero);
        sum.plus(&self.z.times(&other.z, zero), zero)
    }

    fn scaled(&self, factor: &TwoFloat, zero: u32) -> WideVec3 {
        WideVec3 {
            x: self.x.times(factor, zero),
            y: self.y.times(factor, zero),
            z: self.z.times(factor, zero),
        }
    }

    fn minus(&self, other: &WideVec3, zero: u32) -> WideVec3 {
        WideVec3 {
            x: self.x.minus(&other.x, zero),
            y: self.y.minus(&other.y, zero),
            z: self.z.minus(&other.z, zero),
        }
    }

    fn plus(&self, other: &WideVec3, zero: u32) -> WideVec3 {
        WideVec3 {
            x: self.x.plus(&other.x, zero),
            y: self.y.plus(&other.y, zero),
            z: self.z.plus(&other.z, zero),
        }
    }

    /// Coordinate by coordinate.
    fn times_floats(&self, factors: &Vec3, zero: u32) -> WideVec3 {
        WideVec3 {
            x: self.x.times_float(factors.x, zero),
            y: self.y.times_float(factors.y, zero),
            z: self.z.times_float(factors.z, zero),
        }
    }

    fn rounded(&self) -> Vec3 {
        Vec3 {
            x: self.x.hi,
            y: self.y.hi,
            z: self.z.hi,
        }
    }
}

/// Three columns.
#[derive(CubeType, Clone, Copy)]
struct WideColumns {
    x: WideVec3,
    y: WideVec3,
    z: WideVec3,
}

/// `1 - (a + b) twice`.
#[cube]
fn diagonal(a: &TwoFloat, b: &TwoFloat, twice: &TwoFloat, zero: u32) -> TwoFloat {
    let sum = a.plus(b, zero);
    TwoFloat::new(1.0f32, 0.0f32).minus(&sum.times(twice, zero), zero)
}

/// The rotation of a quaternion of any length.
#[cube]
fn wide_rotation(quat: &Quat, zero: u32) -> WideColumns {
    let (w, x, y, z) = (quat.w, quat.x, quat.y, quat.z);
    let ww = TwoFloat::two_product(w, w, zero);
    let xx = TwoFloat::two_product(x, x, zero);
    let yy = TwoFloat::two_product(y, y, zero);
    let zz = TwoFloat::two_product(z, z, zero);
    let xy = TwoFloat::two_product(x, y, zero);
    let xz = TwoFloat::two_product(x, z, zero);
    let yz = TwoFloat::two_product(y, z, zero);
    let wx = TwoFloat::two_product(w, x, zero);
    let wy = TwoFloat::two_product(w, y, zero);
    let wz = TwoFloat::two_product(w, z, zero);
    let norm = ww.plus(&xx, zero).plus(&yy.plus(&zz, zero), zero);
    let twice = TwoFloat::new(2.0f32, 0.0f32).over(&norm, zero);
    WideColumns {
        x: WideVec3 {
            x: diagonal(&yy, &zz, &twice, zero),
            y: xy.plus(&wz, zero).times(&twice, zero),
            z: xz.minus(&wy, zero).times(&twice, zero),
        },
        y: WideVec3 {
            x: xy.minus(&wz, zero).times(&twice, zero),
            y: diagonal(&xx, &zz, &twice, zero),
            z: yz.plus(&wx, zero).times(&twice, zero),
        },
        z: WideVec3 {
            x: xz.plus(&wy, zero).times(&twice, zero),
            y: yz.minus(&wx, zero).times(&twice, zero),
            z: diagonal(&xx, &yy, &twice, zero),
        },
    }
}

/// The centre's offset from the middle of the picture, and the rows of `J W R S`.
#[derive(CubeType, Clone, Copy)]
struct WideFootprint {
    x: TwoFloat,
    y: TwoFloat,
    row0: WideVec3,
    row1: WideVec3,
}

/// The ratio, no further than the Jacobian follows.
#[cube]
fn wide_slope(ratio: &TwoFloat, narrow: f32, lowest: &TwoFloat, highest: &TwoFloat) -> TwoFloat {
    let (low, high) = (narrow == lowest.hi, narrow == highest.hi);
    TwoFloat::new(
        select(low, lowest.hi, select(high, highest.hi, ratio.hi)),
        select(low, lowest.lo, select(high, highest.lo, ratio.lo)),
    )
}

/// A row of `J W R S`, from those of the rotation.
#[cube]
fn wide_row(
    along: &WideVec3,
    depth: &WideVec3,
    slope: &TwoFloat,
    focal: &TwoFloat,
    axes: &WideColumns,
    scale: &Vec3,
    zero: u32,
) -> WideVec3 {
    let seen = along.minus(&depth.scaled(slope, zero), zero);
    let seen = seen.scaled(focal, zero);
    let row = WideVec3 {
        x: seen.dot(&axes.x, zero),
        y: seen.dot(&axes.y, zero),
        z: seen.dot(&axes.z, zero),
    };
    row.times_floats(scale, zero)
}

#[cube]
fn wide_footprint(
    gaussians: &Ellipsoids,
    i: usize,
    f: &Footprint,
    view: &ViewConstants,
) -> WideFootprint {
    let rest = &view.rest;
    let zero = rest.zero;
    let mean = Vec3::read(&gaussians.means, i);
    let mean = WideVec3 {
        x: TwoFloat::two_sum(mean.x, -view.origin.x, zero),
        y: TwoFloat::two_sum(mean.y, -view.origin.y, zero),
        z: TwoFloat::two_sum(mean.z, -view.origin.z, zero),
    };
    let w0 = WideVec3::new(&view.rotation.x, &rest.rotation.x);
    let w1 = WideVec3::new(&view.rotation.y, &rest.rotation.y);
    let w2 = WideVec3::new(&view.rotation.z, &rest.rotation.z);
    let rotated = WideVec3 {
        x: w0.dot(&mean, zero),
        y: w1.dot(&mean, zero),
        z: w2.dot(&mean, zero),
    };
    let translation = WideVec3::new(&view.translation, &rest.translation);
    let point = rotated.plus(&translation, zero);
    let ratio_x = point.x.over(&point.z, zero);
    let ratio_y = point.y.over(&point.z, zero);
    let lowest_x = TwoFloat::new(view.lowest_x, rest.lowest_x);
    let lowest_y = TwoFloat::new(view.lowest_y, rest.lowest_y);
    let highest_x = TwoFloat::new(view.highest_x, rest.highest_x);
    let highest_y = TwoFloat::new(view.highest_y, rest.highest_y);
    let slope_x = wide_slope(&ratio_x, f.slope_x, &lowest_x, &highest_x);
    let slope_y = wide_slope(&ratio_y, f.slope_y, &lowest_y, &highest_y);
    let focal_x = TwoFloat::new(view.focal_x, rest.focal_x);
    let focal_y = TwoFloat::new(view.focal_y, rest.focal_y);
    let principal_x = TwoFloat::new(view.principal_x, rest.principal_x);
    let principal_y = TwoFloat::new(view.principal_y, rest.principal_y);
    let axes = wide_rotation(&Quat::read(&gaussians.quats, i), zero);
    // Both rows have this factor: its rounding stretches the axes and does not turn them.
    let scale = f.scale.scaled(1.0f32 / f.point.z);
    let middle_x = TwoFloat::new(-0.5f32 * view.width, 0.0f32);
    let middle_y = TwoFloat::new(-0.5f32 * view.height, 0.0f32);
    let x = ratio_x.times(&focal_x, zero).plus(&principal_x, zero);
    let y = ratio_y.times(&focal_y, zero).plus(&principal_y, zero);
    WideFootprint {
        x: x.plus(&middle_x, zero),
        y: y.plus(&middle_y, zero),
        row0: wide_row(&w0, &w2, &slope_x, &focal_x, &axes, &scale, zero),
        row1: wide_row(&w1, &w2, &slope_y, &focal_y, &axes, &scale, zero),
    }
}

/// A needle's projected covariance in the frame of its axes.
#[derive(CubeType, Clone, Copy)]
pub(super) struct Needle {
    /// The unit vector across the long axis.
    x: f32,
    y: f32,
    /// The product of that vector with the axis' points near the picture, pixels.
    offset: f32,
    /// Variances across and along, px^2.
    variance_across: f32,
    variance_along: f32,
    /// The rows of `J W R S` in the frame.
    row_across: Vec3,
    row_along: Vec3,
}

/// Whether a splat of this trace and determinant needs the frame of its axes.
#[cube]
pub(super) fn is_needle(trace: f32, det: f32) -> bool {
    trace * trace > comptime!(NEEDLE as f32) * det
}

/// `y a - x b`: nearly all of it cancels.
#[cube]
fn cross(x: &TwoFloat, y: &TwoFloat, a: &TwoFloat, b: &TwoFloat, zero: u32) -> f32 {
    let difference = y.times(a, zero).minus(&x.times(b, zero), zero);
    difference.hi
}

/// The needle of Gaussian `i`, whose footprint is `f`.
#[cube]
pub(super) fn needle_of(
    gaussians: &Ellipsoids,
    i: usize,
    f: &Footprint,
    view: &ViewConstants,
) -> Needle {
    let zero = view.rest.zero;
    let wide = wide_footprint(gaussians, i, f, view);
    let (g0, g1) = (wide.row0.rounded(), wide.row1.rounded());
    // The long axis roughly, in units that do not overflow.
    let unit = 1.0f32 / (g0.dot(&g0) + g1.dot(&g1));
    let half = 0.5f32 * (g0.dot(&g0) - g1.dot(&g1)) * unit;
    let xy = g0.dot(&g1) * unit;
    let more = half.abs() + (half * half + xy * xy).sqrt();
    let flat = half >= 0.0f32;
    let (x, y) = (select(flat, more, xy), select(flat, xy, more));
    // The covariance times that is the long axis: what is off shrinks by the ratio of the variances.
    let shares = wide.row0.times_floats(&Vec3 { x, y: x, z: x }, zero);
    let shares = shares.plus(&wide.row1.times_floats(&Vec3 { x: y, y, z: y }, zero), zero);
    let long_x = shares.dot(&wide.row0, zero);
    let long_y = shares.dot(&wide.row1, zero);
    let (unit_x, unit_y) = (long_x.hi * unit, long_y.hi * unit);
    let length = unit / (unit_x * unit_x + unit_y * unit_y).sqrt();
    let (x, y) = (long_x.hi * length, long_y.hi * length);
    let across = Vec3 {
        x: cross(&long_x, &long_y, &wide.row0.x, &wide.row1.x, zero),
        y: cross(&long_x, &long_y, &wide.row0.y, &wide.row1.y, zero),
        z: cross(&long_x, &long_y, &wide.row0.z, &wide.row1.z, zero),
    };
    let row_across = across.scaled(length);
    let row_along = g0.scaled(x).plus(&g1.scaled(y));
    let distance = cross(&long_x, &long_y, &wide.x, &wide.y, zero) * length;
    Needle {
        x: y,
        y: -x,
        offset: y * (0.5f32 * view.width) - x * (0.5f32 * view.height) + distance,
        variance_across: row_across.dot(&row_across) + view.low_pass,
        variance_along: row_along.dot(&row_along) + view.low_pass,
        row_across,
        row_along,
    }
}

#[cube]
impl Needle {
    /// Writes the shape to a packed row, unless it is beyond what single precision can hold; `extent` is the square of
    /// the Mahalanobis distance that is drawn.
    pub fn write(
        &self,
        row: &mut Array<f32>, // [C]
        extent: f32,
    ) {
        let (xx, xy, yy) = (self.x * self.x, self.x * self.y, self.y * self.y);
        let (across, along) = (1.0f32 / self.variance_across, 1.0f32 / self.variance_along);
        if is_finite(self.offset) && is_finite(across) && self.variance_along < MAX_VARIANCE {
            row[splats::CONIC_A] = across * xx + along * yy;
            row[splats::CONIC_B] = (across - along) * xy;
            row[splats::CONIC_C] = across * yy + along * xx;
            let variance_x = self.variance_across * xx + self.variance_along * yy;
            let variance_y = self.variance_across * yy + self.variance_along * xx;
            row[splats::RADIUS_X] = (extent * variance_x).sqrt();
            row[splats::RADIUS_Y] = (extent * variance_y).sqrt();
            row[splats::ACROSS_X] = self.x;
            row[splats::ACROSS_Y] = self.y;
            row[splats::ACROSS_OFFSET] = self.offset;
            row[splats::ALONG] = along;
        }
    }

    /// Gradients of the rows of `J W R S` from that of the shape in the frame, which starts at `at`.
    pub fn vjp(
        &self,
        v_splats: &[f32], // [N, C]
        at: usize,
    ) -> RowsGradient {
        let v_across = v_splats[at + splats::ACROSS_X];
        let v_mixed = 0.5f32 * v_splats[at + splats::ACROSS_Y];
        let v_along = v_splats[at + splats::ACROSS_OFFSET];
        let (across, along) = (1.0f32 / self.variance_across, 1.0f32 / self.variance_along);
        let h0 = self.row_across.scaled(across);
        let h1 = self.row_along.scaled(along);
        let v_h0 = h0.scaled(v_across).plus(&h1.scaled(v_mixed));
        let v_h1 = h0.scaled(v_mixed).plus(&h1.scaled(v_along));
        let v_row_across = v_h0.scaled(-2.0f32 * across);
        let v_row_along = v_h1.scaled(-2.0f32 * along);
        RowsGradient {
            v_row0: v_row_across
                .scaled(self.x)
                .plus(&v_row_along.scaled(-self.y)),
            v_row1: v_row_across
                .scaled(self.y)
                .plus(&v_row_along.scaled(self.x)),
            v_log_scale: h0.times(&v_h0).plus(&h1.times(&v_h1)).scaled(-2.0f32),
        }
    }
}
