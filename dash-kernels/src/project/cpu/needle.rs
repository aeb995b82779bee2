//! Needles in double precision: what single precision says of them is off by pixels at their far ends.

use crate::splats::{self, LOW_PASS_PX2, N_COLUMNS, NEEDLE};

use super::super::{Gaussians, View};
use super::footprint::Footprint;
use super::vector;

/// Beyond it the inverse is no normal number.
const MAX_VARIANCE: f32 = 1e37;

/// A needle's projected covariance in the frame of its axes.
pub struct Needle {
    /// The unit vector across the long axis.
    across: [f32; 2],
    /// The product of `across` with the axis' points near the picture, pixels.
    offset: f32,
    /// Variances across and along, px^2.
    variances: [f32; 2],
    /// The rows of `J W R S` in the frame: across, along.
    rows: [[f32; 3]; 2],
}

/// Whether a splat of this trace and determinant needs the frame of its axes.
#[inline(always)]
pub fn is_needle(trace: f32, det: f32) -> bool {
    trace * trace > NEEDLE as f32 * det
}

impl Needle {
    /// Gaussian `i`, whose footprint in single precision is `f`; `None` beyond what single precision can hold.
    #[cold]
    #[inline(never)]
    pub fn new(
        gaussians: &Gaussians<f32>,
        i: usize,
        f: &Footprint,
        view: &View<f32>,
    ) -> Option<Self> {
        let (mean2d, rows) = project_exactly(gaussians, i, f, view);
        let dot = |a: [f64; 3], b: [f64; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
        let [g0, g1] = rows;
        let (half, xy) = (0.5 * (dot(g0, g0) - dot(g1, g1)), dot(g0, g1));
        let more = half.abs() + half.hypot(xy);
        let [x, y] = if half >= 0.0 { [more, xy] } else { [xy, more] };
        let length = x.hypot(y);
        let (x, y) = (x / length, y / length);
        let across_row: [f64; 3] = std::array::from_fn(|k| y * g0[k] - x * g1[k]);
        let along_row: [f64; 3] = std::array::from_fn(|k| x * g0[k] + y * g1[k]);
        let variances = [across_row, along_row].map(|row| (dot(row, row) + LOW_PASS_PX2) as f32);
        // The rounded direction turns about the axis' point next to the middle of the picture, not about the mean.
        let middle = view.size.map(|side| 0.5 * f64::from(side));
        let distance = y * (mean2d[0] - middle[0]) - x * (mean2d[1] - middle[1]);
        let across = [y as f32, -x as f32];
        let at_middle = f64::from(across[0]) * middle[0] + f64::from(across[1]) * middle[1];
        let needle = Self {
            across,
            offset: (at_middle + distance) as f32,
            variances,
            rows: [across_row, along_row].map(|row| row.map(|value| value as f32)),
        };
        let regular = needle.offset.is_finite() && needle.variances[1] < MAX_VARIANCE;
        regular.then_some(needle)
    }

    /// Writes the shape to a packed row; `extent` is the square of the Mahalanobis distance that is drawn.
    pub fn write(&self, row: &mut [f32; N_COLUMNS], extent: f32) {
        let ([x, y], [across, along]) = (self.across, self.variances);
        row[splats::RADIUS_X] = (extent * (across * x * x + along * y * y)).sqrt();
        row[splats::RADIUS_Y] = (extent * (across * y * y + along * x * x)).sqrt();
        let [across, along] = [1.0 / across, 1.0 / along];
        row[splats::CONIC_A] = across * x * x + along * y * y;
        row[splats::CONIC_B] = (across - along) * x * y;
        row[splats::CONIC_C] = across * y * y + along * x * x;
        row[splats::ACROSS_X] = x;
        row[splats::ACROSS_Y] = y;
        row[splats::ACROSS_OFFSET] = self.offset;
        row[splats::ALONG] = along;
    }

    /// Adds the gradients of the rows of `J W R S` and of the scales' logarithms from that of the shape in the frame.
    pub fn add_vjp(
        &self,
        v_row: &[f32; N_COLUMNS],
        v_rows: &mut [[f32; 3]; 2],
        v_log_scale: &mut [f32; 3],
    ) {
        let v_across = v_row[splats::ACROSS_X];
        let v_mixed = 0.5 * v_row[splats::ACROSS_Y];
        let v_along = v_row[splats::ACROSS_OFFSET];
        let ([x, y], [across, along]) = (self.across, self.variances.map(|v| 1.0 / v));
        for k in 0..3 {
            let (h0, h1) = (across * self.rows[0][k], along * self.rows[1][k]);
            let (v_h0, v_h1) = (v_across * h0 + v_mixed * h1, v_mixed * h0 + v_along * h1);
            let (v_row0, v_row1) = (-2.0 * across * v_h0, -2.0 * along * v_h1);
            v_rows[0][k] += x * v_row0 - y * v_row1;
            v_rows[1][k] += y * v_row0 + x * v_row1;
            v_log_scale[k] -= 2.0 * (h0 * v_h0 + h1 * v_h1);
        }
    }
}

/// The centre in the picture and the rows of `J W R S`.
fn project_exactly(
    gaussians: &Gaussians<f32>,
    i: usize,
    f: &Footprint,
    view: &View<f32>,
) -> ([f64; 2], [[f64; 3]; 2]) {
    let exact = &view.exact;
    let mean: [f32; 3] = vector(gaussians.means, i);
    let mean: [f64; 3] = std::array::from_fn(|k| f64::from(mean[k]) - f64::from(view.origin[k]));
    let [w, x, y, z] = vector::<4>(gaussians.quats, i).map(f64::from);
    let twice = 2.0 / (w * w + x * x + y * y + z * z);
    let rotation = [
        [
            1.0 - twice * (y * y + z * z),
            twice * (x * y - w * z),
            twice * (x * z + w * y),
        ],
        [
            twice * (x * y + w * z),
            1.0 - twice * (x * x + z * z),
            twice * (y * z - w * x),
        ],
        [
            twice * (x * z - w * y),
            twice * (y * z + w * x),
            1.0 - twice * (x * x + y * y),
        ],
    ];
    let camera = &exact.rotation;
    let point: [f64; 3] = std::array::from_fn(|r| {
        (0..3).fold(exact.translation[r], |sum, k| sum + camera[r][k] * mean[k])
    });
    let ratio = [point[0] / point[2], point[1] / point[2]];
    let rows = std::array::from_fn(|k| {
        let slope = ratio[k].max(exact.lowest[k]).min(exact.highest[k]);
        let seen: [f64; 3] = std::array::from_fn(|c| camera[k][c] - slope * camera[2][c]);
        let factor = exact.focal[k] / point[2];
        std::array::from_fn(|axis| {
            let along = (0..3).fold(0.0, |sum, r| sum + seen[r] * rotation[r][axis]);
            factor * along * f64::from(f.scale[axis])
        })
    });
    let mean2d = std::array::from_fn(|k| exact.focal[k] * ratio[k] + exact.principal[k]);
    (mean2d, rows)
}
