//! What every value that a splat file can hold means: it is kept, brought to where single precision draws it as its
//! limit, left out since nothing of it can be seen, or refused.
//!
//! | property | infinite | NaN | finite |
//! | --- | --- | --- | --- |
//! | `x y z` | refused | refused | beyond [`FARTHEST`] brought there on the line to the origin |
//! | `f_dc_* f_rest_*` | refused | refused | clamped to ±[`BRIGHTEST`] |
//! | `opacity` | opaque, or left out | refused | clamped to where the sigmoid is 0 or 1 |
//! | `scale_*` | as the largest or the smallest | refused | clamped to [`NARROWEST`] and [`WIDEST`] |
//! | `rot_*` | refused | refused | of any length; zeros are left out, since they are no rotation |

use std::fmt;
use std::path::Path;

use crate::{GaussianRows, ModelError};

/// Coordinates whose squares are still far from overflow.
const FARTHEST: f32 = 1e15;
/// Colour coefficients of which any sum and blend is finite.
const BRIGHTEST: f32 = 1e30;
/// Logits beyond which a sigmoid is 0 or 1 for every use.
const LARGEST_LOGIT: f32 = 50.0;
/// The logarithm of a width that vanishes beside any pixel.
const NARROWEST: f32 = -50.0;
/// Widths beyond so many times the median distance from the origin look alike, and their covariance in pixels would
/// overflow.
const WIDEST: f32 = 1e4;
/// Squared lengths of quaternions that kernels take as they are.
const LENGTHS: std::ops::Range<f64> = 1e-8..1e30;

/// How many of a file's Gaussians were left out, since they draw nothing.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct LeftOut {
    /// Opacity 0: a logit of minus infinity.
    pub invisible: usize,
    /// A quaternion of zeros.
    pub without_rotation: usize,
}

impl LeftOut {
    /// Their number.
    pub fn count(&self) -> usize {
        self.invisible + self.without_rotation
    }
}

impl fmt::Display for LeftOut {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "{} with opacity 0 (a logit of -inf), {} with a rotation of zeros",
            self.invisible, self.without_rotation
        )
    }
}

/// The rows as they are drawn, and what was left out of them.
pub(super) fn settled(
    mut rows: GaussianRows,
    path: &Path,
) -> Result<(GaussianRows, LeftOut), ModelError> {
    check(&rows, path)?;
    let widest = widest(&rows);
    let mut left_out = LeftOut::default();
    let mut kept = Vec::with_capacity(rows.len());
    for row in 0..rows.len() {
        let length_squared: f64 = rows.quats[row].iter().map(|&q| f64::from(q).powi(2)).sum();
        if rows.opacity_logits[row] == f32::NEG_INFINITY {
            left_out.invisible += 1;
            continue;
        }
        if length_squared == 0.0 {
            left_out.without_rotation += 1;
            continue;
        }
        kept.push(row);
        if !LENGTHS.contains(&length_squared) {
            let length = length_squared.sqrt();
            rows.quats[row] = rows.quats[row].map(|q| (f64::from(q) / length) as f32);
        }
        let farthest = rows.means[row]
            .iter()
            .fold(0.0, |far: f32, v| far.max(v.abs()));
        if farthest > FARTHEST {
            rows.means[row] = rows.means[row].map(|v| v / farthest * FARTHEST);
        }
        let logit = &mut rows.opacity_logits[row];
        *logit = logit.clamp(-LARGEST_LOGIT, LARGEST_LOGIT);
        rows.log_scales[row] = rows.log_scales[row].map(|v| v.clamp(NARROWEST, widest));
    }
    let coefficients = rows.sh_dc.as_flattened_mut().iter_mut();
    for value in coefficients.chain(&mut rows.sh_rest) {
        *value = value.clamp(-BRIGHTEST, BRIGHTEST);
    }
    if left_out.count() > 0 {
        rows = rows.gather(&kept);
    }
    Ok((rows, left_out))
}

/// The logarithm of the largest width.
fn widest(rows: &GaussianRows) -> f32 {
    let farthest = |mean: &[f32; 3]| mean.iter().fold(0.0, |far: f32, v| far.max(v.abs()));
    let mut distances: Vec<f32> = rows.means.iter().map(farthest).collect();
    let middle = distances.len() / 2;
    if distances.is_empty() {
        return 0.0;
    }
    let median = *distances.select_nth_unstable_by(middle, f32::total_cmp).1;
    (WIDEST * median.clamp(1.0, FARTHEST)).ln()
}

/// Refuses values that have no limit, with their row and property.
fn check(rows: &GaussianRows, path: &Path) -> Result<(), ModelError> {
    let refused = |row: usize, property: &str, value: f32| {
        ModelError::format(
            path,
            "numbers that can be drawn",
            format!("`{property}` {value} at vertex {row}"),
        )
    };
    let per_channel = rows.sh_rest_width / 3;
    for row in 0..rows.len() {
        let finite = |prefix: &str, values: &[f32]| {
            let found = values.iter().position(|value| !value.is_finite());
            found.map_or(Ok(()), |k| {
                Err(refused(row, &format!("{prefix}{k}"), values[k]))
            })
        };
        let mean = rows.means[row];
        for (axis, value) in ["x", "y", "z"].iter().zip(mean) {
            if !value.is_finite() {
                return Err(refused(row, axis, value));
            }
        }
        finite("rot_", &rows.quats[row])?;
        finite("f_dc_", &rows.sh_dc[row])?;
        let rest = &rows.sh_rest[row * rows.sh_rest_width..][..rows.sh_rest_width];
        if let Some(at) = rest.iter().position(|value| !value.is_finite()) {
            // Rows hold channels next to each other, files one after the other.
            let k = at % 3 * per_channel + at / 3;
            return Err(refused(row, &format!("f_rest_{k}"), rest[at]));
        }
        let scales = rows.log_scales[row];
        if let Some(k) = scales.iter().position(|value| value.is_nan()) {
            return Err(refused(row, &format!("scale_{k}"), scales[k]));
        }
        let logit = rows.opacity_logits[row];
        if logit.is_nan() {
            return Err(refused(row, "opacity", logit));
        }
    }
    Ok(())
}
