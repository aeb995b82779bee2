//! Cameras to render from: the `cameras.json` of 3DGS, `transforms*.json`, and a path among given cameras.
//!
//! # Map
//! - this file: reads and writes `cameras.json`, and recognises both kinds of files.
//! - `transforms`: the cameras of a `transforms*.json`.
//! - `focus`: the point that cameras look at; `spiral`: a smooth path among given cameras.

mod focus;
mod spiral;
mod transforms;

pub use focus::focus_point;
pub(crate) use focus::{in_one_place, one_place};
pub use spiral::spiral;
pub use transforms::DatasetTerms;

use std::io::Write;
use std::path::Path;

use dash_kernels::Camera;
use glam::DMat3;
use serde::{Deserialize, Serialize, Serializer};
use serde_json::Value;

use crate::Error;
use crate::files::parse_json;
use transforms::TransformsFile;

/// The largest image side that is accepted, so that a damaged file can't ask for all memory.
pub const MAX_CAMERA_SIDE: usize = 16_384;
/// The largest deviation of `R R^T` from the identity; files round to a few digits. Axes as far from
/// perpendicular as those of datasets may be (a cosine of 1e-3) deviate by less.
const ROTATION_TOLERANCE: f64 = 2.5e-3;
/// What failed, for an [`Error::Io`].
const WRITE: &str = "write it";

/// One camera of a file.
#[derive(Debug, Clone, PartialEq)]
pub struct CameraEntry {
    /// The entry's number, else its place in the list.
    pub id: u64,
    /// The image's name, else `cameraNN` by its place.
    pub img_name: String,
    /// Pose and intrinsics.
    pub camera: Camera,
    /// Time in [0, 1], when the file gives it.
    pub time: Option<f64>,
}

/// A file of cameras of either kind.
#[derive(Debug)]
pub struct CameraFile(Kind);

#[derive(Debug)]
enum Kind {
    List(Vec<CameraEntry>),
    Transforms(Box<TransformsFile>),
}

/// An entry as 3DGS writes it, with our optional fields.
#[derive(Debug, Serialize, Deserialize)]
struct JsonCamera {
    id: Option<u64>,
    img_name: Option<String>,
    /// Whole; some write it with a fraction of zero.
    #[serde(serialize_with = "as_whole")]
    width: f64,
    #[serde(serialize_with = "as_whole")]
    height: f64,
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

fn as_whole<S: Serializer>(side: &f64, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.serialize_u64(*side as u64)
}

impl CameraFile {
    /// Reads a `cameras.json` or a `transforms*.json`, whichever the file is.
    ///
    /// A `cameras.json` lists `width, height, position, rotation, fx, fy`, the pose from camera to
    /// world with OpenCV axes, and optionally `id`, `img_name`, `cx, cy` (else the image's centre) and
    /// `time`. A `transforms*.json` is read as that of a dataset. Further fields are ignored.
    ///
    /// # Errors
    /// When the file can't be read, is of neither kind, is empty, or an entry of a list lacks a field,
    /// is not finite, has a rotation that is none, or values out of range; the message names the entry.
    pub fn read(path: &Path) -> Result<Self, Error> {
        let text = std::fs::read(path).map_err(|source| Error::io(path, "read it", source))?;
        let no_cameras = |found: String| {
            let expected = "a JSON list of cameras (the `cameras.json` of 3DGS) or an object with `frames` (a \
                 `transforms.json` of NeRF, D-NeRF, Blender or nerfstudio)";
            Error::invalid(path, expected, found, "name another file")
        };
        let value: Value = parse_json(&text)
            .map_err(|error| no_cameras(format!("text that is not JSON: {error}")))?;
        match value {
            Value::Array(entries) if entries.is_empty() => Err(no_cameras("an empty list".into())),
            Value::Array(entries) => Ok(Self(Kind::List(listed(path, entries)?))),
            Value::Object(fields) if fields.contains_key("frames") => {
                let file = TransformsFile::read(path)?;
                Ok(Self(Kind::Transforms(Box::new(file))))
            }
            Value::Object(_) => Err(no_cameras("an object without `frames`".into())),
            _ => Err(no_cameras("another kind of JSON value".into())),
        }
    }

    /// Whether it is a `transforms*.json`, which is read in the terms of a dataset where there is one.
    pub fn is_transforms(&self) -> bool {
        matches!(self.0, Kind::Transforms(_))
    }

    /// Its cameras, those of a `transforms*.json` without their lens's distortion, as a dataset's are.
    ///
    /// # Errors
    /// When a frame of a `transforms*.json` lacks something or is out of range; the message names it.
    pub fn cameras(self, dataset: Option<&DatasetTerms>) -> Result<Vec<CameraEntry>, Error> {
        match self.0 {
            Kind::List(cameras) => Ok(cameras),
            Kind::Transforms(file) => file.cameras(dataset),
        }
    }
}

/// Reads the cameras of a file that belongs to no dataset.
///
/// # Errors
/// Those of [`CameraFile::read`] and [`CameraFile::cameras`].
pub fn read_cameras(path: &Path) -> Result<Vec<CameraEntry>, Error> {
    CameraFile::read(path)?.cameras(None)
}

/// The entries of a `cameras.json`.
fn listed(path: &Path, entries: Vec<Value>) -> Result<Vec<CameraEntry>, Error> {
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
                .and_then(|entry| checked(index, entry))
                .map_err(|what| Error::Camera {
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
///
/// ```
/// use dash_kernels::Camera;
/// use dash_train::cameras::{CameraEntry, read_cameras, write_cameras};
///
/// let folder = tempfile::tempdir()?;
/// let path = folder.path().join("cameras.json");
/// let camera = Camera::new(80.0, 80.0, 32.0, 24.0, 64, 48);
/// let front = CameraEntry { id: 0, img_name: "front".into(), camera, time: Some(0.5) };
/// write_cameras(&path, &[front])?;
/// assert_eq!(read_cameras(&path)?[0].img_name, "front");
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn write_cameras(path: &Path, cameras: &[CameraEntry]) -> Result<(), Error> {
    let text = cameras_text(path, cameras)?;
    crate::video::write_whole(path, |file| file.write_all(&text))
        .map_err(|source| Error::io(path, WRITE, source))
}

/// What [`write_cameras`] writes to `path`.
pub(crate) fn cameras_text(path: &Path, cameras: &[CameraEntry]) -> Result<Vec<u8>, Error> {
    let entries = cameras
        .iter()
        .enumerate()
        .map(|(index, entry)| {
            let refused = |what| Error::Camera {
                path: path.to_path_buf(),
                index,
                name: format!(" ({})", entry.img_name),
                what,
            };
            checked(index, json_camera(entry)).map_err(refused)?;
            Ok(json_camera(entry))
        })
        .collect::<Result<Vec<_>, Error>>()?;
    let mut text =
        serde_json::to_vec_pretty(&entries).map_err(|e| Error::io(path, WRITE, e.into()))?;
    text.push(b'\n');
    Ok(text)
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
        id: Some(entry.id),
        img_name: Some(entry.img_name.clone()),
        width: camera.width as f64,
        height: camera.height as f64,
        position: camera.position(),
        rotation,
        fx: camera.fx,
        fy: camera.fy,
        cx: Some(camera.cx),
        cy: Some(camera.cy),
        time: entry.time,
    }
}

/// The entry at this place of a list, or what is wrong with it.
fn checked(index: usize, entry: JsonCamera) -> Result<CameraEntry, String> {
    for (name, side) in [("width", entry.width), ("height", entry.height)] {
        let is_whole = side.fract() == 0.0;
        if !(is_whole && (1.0..=MAX_CAMERA_SIDE as f64).contains(&side)) {
            return Err(format!(
                "expected a whole `{name}` from 1 to {MAX_CAMERA_SIDE} pixels, found {side}"
            ));
        }
    }
    let (width, height) = (entry.width as usize, entry.height as usize);
    for (name, focal) in [("fx", entry.fx), ("fy", entry.fy)] {
        if !(focal.is_finite() && focal > 0.0) {
            return Err(format!(
                "expected a positive focal length `{name}` in pixels, found {focal}"
            ));
        }
    }
    let cx = entry.cx.unwrap_or(entry.width / 2.0);
    let cy = entry.cy.unwrap_or(entry.height / 2.0);
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
        id: entry.id.unwrap_or(index as u64),
        img_name: entry
            .img_name
            .unwrap_or_else(|| format!("camera{index:02}")),
        camera: Camera::new(entry.fx, entry.fy, cx, cy, width, height)
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
