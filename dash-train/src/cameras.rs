//! Cameras to render from: the `cameras.json` of 3DGS, and a path through given cameras.
//!
//! # Map
//! - this file: reading and writing `cameras.json`.
//! - `spiral`: a smooth path in the middle of given cameras.

mod spiral;

pub use spiral::{focus_point, spiral};

use std::io::Write;
use std::path::{Path, PathBuf};

use dash_kernels::Camera;
use glam::DMat3;
use serde::{Deserialize, Serialize};

use crate::dataset::first_bytes::parse_json;

/// The largest image side that is accepted, so that a damaged file can't ask for all memory.
pub const MAX_CAMERA_SIDE: usize = 16_384;
/// The largest deviation of `R R^T` from the identity; files round to a few digits.
const ROTATION_TOLERANCE: f64 = 1e-3;

/// One camera of a `cameras.json`.
#[derive(Debug, Clone, PartialEq)]
pub struct CameraEntry {
    /// The entry's number.
    pub id: u64,
    /// The image's name.
    pub img_name: String,
    /// Pose and intrinsics.
    pub camera: Camera,
    /// Time in [0, 1], when the file gives it.
    pub time: Option<f64>,
}

/// Why a `cameras.json` could not be read or written.
#[derive(Debug, thiserror::Error)]
pub enum CameraFileError {
    /// The operating system refused the file.
    #[error("{}: cannot {action}: {source}; check that it exists and is accessible", .path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What was tried.
        action: &'static str,
        /// The system's reason.
        source: std::io::Error,
    },
    /// The file is not a JSON list with at least one camera.
    #[error(
        "{}: expected a JSON list of cameras (the `cameras.json` of 3DGS), found {found}", .path.display()
    )]
    NotAList {
        /// The file.
        path: PathBuf,
        /// What is there.
        found: String,
    },
    /// One of the cameras can't be used.
    #[error("{}: camera {index}{name}: {what}", .path.display())]
    Entry {
        /// The file.
        path: PathBuf,
        /// The entry's place in the list, from 0.
        index: usize,
        /// Its image's name in parentheses, where it has one.
        name: String,
        /// What was expected and what was found.
        what: String,
    },
}

/// An entry as 3DGS writes it, with our optional fields.
#[derive(Debug, Serialize, Deserialize)]
struct JsonCamera {
    id: u64,
    img_name: String,
    width: usize,
    height: usize,
    position: [f64; 3],
    /// Rows of the rotation from camera to world.
    rotation: [[f64; 3]; 3],
    fx: f64,
    fy: f64,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    cx: Option<f64>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    cy: Option<f64>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    time: Option<f64>,
}

/// Reads a `cameras.json`: `id, img_name, width, height, position, rotation, fx, fy`, the pose from
/// camera to world with OpenCV axes, and optionally `cx, cy` (else the image's centre) and `time`.
/// Further fields are ignored.
///
/// # Errors
/// When the file can't be read, is no list, is empty, or a camera lacks a field, is not finite, has
/// a rotation that is none, or values out of range; the message names the entry.
pub fn read_cameras(path: &Path) -> Result<Vec<CameraEntry>, CameraFileError> {
    let text = std::fs::read(path).map_err(|source| CameraFileError::Io {
        path: path.to_path_buf(),
        action: "read it",
        source,
    })?;
    let not_a_list = |found: String| CameraFileError::NotAList {
        path: path.to_path_buf(),
        found,
    };
    let value: serde_json::Value =
        parse_json(&text).map_err(|error| not_a_list(format!("text that is not JSON: {error}")))?;
    let serde_json::Value::Array(entries) = value else {
        return Err(not_a_list("another kind of JSON value".into()));
    };
    if entries.is_empty() {
        return Err(not_a_list("an empty list".into()));
    }
    entries
        .into_iter()
        .enumerate()
        .map(|(index, entry)| {
            let name = match entry.get("img_name").and_then(|name| name.as_str()) {
                Some(name) => format!(" ({name})"),
                None => String::new(),
            };
            serde_json::from_value(entry)
                .map_err(|error| error.to_string())
                .and_then(checked)
                .map_err(|what| CameraFileError::Entry {
                    path: path.to_path_buf(),
                    index,
                    name,
                    what,
                })
        })
        .collect()
}

/// Writes a `cameras.json`, whole or not at all: into a scratch file beside it, then renamed.
///
/// # Errors
/// When a camera would be refused by [`read_cameras`], or the file can't be written.
pub fn write_cameras(path: &Path, cameras: &[CameraEntry]) -> Result<(), CameraFileError> {
    let entries = cameras
        .iter()
        .enumerate()
        .map(|(index, entry)| {
            let refused = |what| CameraFileError::Entry {
                path: path.to_path_buf(),
                index,
                name: format!(" ({})", entry.img_name),
                what,
            };
            checked(json_camera(entry)).map_err(refused)?;
            Ok(json_camera(entry))
        })
        .collect::<Result<Vec<_>, CameraFileError>>()?;
    let io_error = |source| CameraFileError::Io {
        path: path.to_path_buf(),
        action: "write it",
        source,
    };
    let mut text = serde_json::to_vec_pretty(&entries).map_err(|e| io_error(e.into()))?;
    text.push(b'\n');
    crate::video::write_whole(path, |file| file.write_all(&text)).map_err(io_error)
}

fn json_camera(entry: &CameraEntry) -> JsonCamera {
    let camera = &entry.camera;
    let mut rotation = [[0.0; 3]; 3];
    for (row, values) in rotation.iter_mut().enumerate() {
        for (col, value) in values.iter_mut().enumerate() {
            *value = camera.rotation[col][row];
        }
    }
    JsonCamera {
        id: entry.id,
        img_name: entry.img_name.clone(),
        width: camera.width,
        height: camera.height,
        position: camera.position(),
        rotation,
        fx: camera.fx,
        fy: camera.fy,
        cx: Some(camera.cx),
        cy: Some(camera.cy),
        time: entry.time,
    }
}

/// The entry, or what is wrong with it.
fn checked(entry: JsonCamera) -> Result<CameraEntry, String> {
    for (name, side) in [("width", entry.width), ("height", entry.height)] {
        if !(1..=MAX_CAMERA_SIDE).contains(&side) {
            return Err(format!(
                "expected `{name}` from 1 to {MAX_CAMERA_SIDE} pixels, found {side}"
            ));
        }
    }
    for (name, focal) in [("fx", entry.fx), ("fy", entry.fy)] {
        if !(focal.is_finite() && focal > 0.0) {
            return Err(format!(
                "expected a positive focal length `{name}` in pixels, found {focal}"
            ));
        }
    }
    let cx = entry.cx.unwrap_or(entry.width as f64 / 2.0);
    let cy = entry.cy.unwrap_or(entry.height as f64 / 2.0);
    if !(cx.is_finite() && cy.is_finite()) {
        return Err(format!(
            "expected a finite principal point, found {cx}, {cy}"
        ));
    }
    if !entry.position.iter().all(|v| v.is_finite()) {
        return Err(format!(
            "expected a finite `position`, found {:?}",
            entry.position
        ));
    }
    if let Some(time) = entry.time
        && !(0.0..=1.0).contains(&time)
    {
        return Err(format!(
            "expected `time` from 0 to 1 over the clip, found {time}; divide by the clip's length"
        ));
    }
    check_rotation(&entry.rotation)?;
    Ok(CameraEntry {
        id: entry.id,
        img_name: entry.img_name,
        camera: Camera::new(entry.fx, entry.fy, cx, cy, entry.width, entry.height)
            .placed(entry.rotation, entry.position),
        time: entry.time,
    })
}

fn check_rotation(rows: &[[f64; 3]; 3]) -> Result<(), String> {
    if !rows.iter().flatten().all(|v| v.is_finite()) {
        return Err(format!("expected a finite `rotation`, found {rows:?}"));
    }
    let matrix = DMat3::from_cols_array_2d(rows);
    let excess = matrix.transpose() * matrix - DMat3::IDENTITY;
    let deviation = excess
        .to_cols_array()
        .into_iter()
        .fold(0.0, |m: f64, v| m.max(v.abs()));
    if deviation > ROTATION_TOLERANCE {
        return Err(format!(
            "expected `rotation` to be a rotation matrix, found one whose rows are not orthonormal \
             (off by {deviation:.2e}); divide out the scale"
        ));
    }
    if matrix.determinant() < 0.0 {
        return Err(
            "expected `rotation` to be a rotation matrix, found a reflection; OpenCV axes are x \
             right, y down, z forward"
                .into(),
        );
    }
    Ok(())
}

#[cfg(test)]
mod tests;
