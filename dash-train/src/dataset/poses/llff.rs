//! LLFF poses: rows of `poses_bounds.npy`.

use std::path::Path;

use dash_kernels::Camera;

use super::npy::POSE_COLUMNS;
use super::pose;
use crate::Error;
use crate::dataset::pixels::MAX_IMAGE_SIDE;

/// The camera of one LLFF row: 3x5 of the axes down, right, backwards, the position and
/// (height, width, focal); then the depth bounds.
pub(crate) fn camera(
    path: &Path,
    index: usize,
    row: &[f64; POSE_COLUMNS],
) -> Result<Camera, Error> {
    let malformed = |found: String| {
        Error::invalid(
            path,
            "in every row a finite pose, height, width, focal length and depth bounds",
            format!("{found} in row {index}"),
            "mend or remove that camera's row",
        )
    };
    if !row.iter().all(|v| v.is_finite()) {
        return Err(malformed("NaN or infinity".into()));
    }
    let column = |c: usize| [row[c], row[5 + c], row[10 + c]];
    let [height, width, focal] = column(4);
    let side = |v: f64| v >= 1.0 && v <= f64::from(MAX_IMAGE_SIDE);
    if !(side(height) && side(width) && focal > 0.0) {
        return Err(malformed(format!(
            "height {height}, width {width}, focal length {focal}"
        )));
    }
    let (width, height) = (width.round(), height.round());
    let intrinsics = Camera::new(
        focal,
        focal,
        width / 2.0,
        height / 2.0,
        width as usize,
        height as usize,
    );
    let axes = [column(1), column(0), column(2).map(|v| -v)];
    pose::place(intrinsics, axes, column(3)).map_err(malformed)
}
