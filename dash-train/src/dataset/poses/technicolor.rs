//! Technicolor's `cameras_parameters.txt`: a line of numbers per camera.

use std::path::Path;

use dash_kernels::Camera;

use super::intrinsics::{check_finite, check_skew};
use super::pose;
use crate::Error;
use crate::dataset::pixels::scale::is_in_the_middle;

/// A column each: focal length, principal point, aspect, skew, quaternion (w, x, y, z), translation.
const COLUMNS: usize = 12;

/// A camera's line.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Row {
    focal: f64,
    principal_point: [f64; 2],
    aspect: f64,
    quaternion: [f64; 4],
    translation: [f64; 3],
    line: usize,
}

/// The lines after the header.
pub(crate) fn parse(path: &Path, text: &str) -> Result<Vec<Row>, Error> {
    let malformed = |found: String| {
        Error::invalid(
            path,
            "a header line, then 12 numbers per camera (focal length, principal point, aspect, \
             skew, quaternion w x y z, translation)",
            found,
            "take the parameters that belong to the undistorted images",
        )
    };
    let numbers = |line: &str| -> Option<Vec<f64>> {
        line.split_ascii_whitespace()
            .map(|field| field.parse().ok())
            .collect()
    };
    let mut rows = Vec::new();
    for (index, text) in text.lines().enumerate() {
        let line = index + 1;
        if text.trim().is_empty() {
            continue;
        }
        let fields = numbers(text);
        if index == 0 {
            if fields.is_some_and(|fields| fields.len() == COLUMNS) {
                return Err(malformed("a camera in the first line".into()));
            }
            continue;
        }
        let fields = fields.ok_or_else(|| malformed(format!("other words in line {line}")))?;
        let &[focal, cu, cv, aspect, skew, qw, qx, qy, qz, tx, ty, tz] = fields.as_slice() else {
            return Err(malformed(format!("{} in line {line}", fields.len())));
        };
        check_skew(skew).map_err(|(expected, found)| {
            let remedy = "undistort the images to a camera without skew";
            Error::invalid(path, expected, format!("{found} in line {line}"), remedy)
        })?;
        check_finite([focal, focal * aspect], [cu, cv])
            .map_err(|(_, found)| malformed(format!("{found}, aspect {aspect} in line {line}")))?;
        rows.push(Row {
            focal,
            principal_point: [cu, cv],
            aspect,
            quaternion: [qw, qx, qy, qz],
            translation: [tx, ty, tz],
            line,
        });
    }
    Ok(rows)
}

impl Row {
    /// The camera at the size of its images, which the file does not state.
    ///
    /// # Errors
    /// When the principal point cannot be of images of that size, or the pose is not finite.
    pub(crate) fn camera(
        &self,
        path: &Path,
        (width, height): (usize, usize),
    ) -> Result<Camera, Error> {
        let malformed = |expected: &str, found: String| {
            Error::invalid(
                path,
                expected,
                format!("{found} in line {}", self.line),
                "mend that camera's line; scale focal length and principal point with the images",
            )
        };
        let [cx, cy] = self.principal_point;
        if !is_in_the_middle([cx, cy], (width, height)) {
            return Err(malformed(
                &format!("a principal point near the middle of the {width}x{height} images"),
                format!("{cx}, {cy}"),
            ));
        }
        let intrinsics = Camera::new(self.focal, self.focal * self.aspect, cx, cy, width, height);
        pose::place_by_quaternion(intrinsics, self.quaternion, self.translation)
            .map_err(|found| malformed("a finite pose", found))
    }
}
