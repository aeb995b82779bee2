//! The `transforms*.json` files of NeRF, D-NeRF, instant-ngp and nerfstudio.

use std::fs;
use std::path::Path;

use dash_kernels::Camera;
use serde::Deserialize;

use super::decode::MAX_IMAGE_SIDE;
use super::distortion::Distortion;
use super::first_bytes::parse_json;
use super::{DatasetError, pose};

/// One file.
#[derive(Debug, Deserialize)]
pub(super) struct Transforms {
    #[serde(flatten)]
    shared: Intrinsics,
    pub(super) frames: Vec<Frame>,
    /// Initial points (nerfstudio).
    pub(super) ply_file_path: Option<String>,
    /// File paths of the frames to hold out (nerfstudio).
    #[serde(default)]
    pub(super) test_filenames: Vec<String>,
    /// The same, which serve where there are none to test.
    #[serde(default)]
    pub(super) val_filenames: Vec<String>,
}

/// One image's entry.
#[derive(Debug, Deserialize)]
pub(super) struct Frame {
    pub(super) file_path: String,
    pub(super) time: Option<f64>,
    /// The number of the time, in captures without `time`.
    timestep_index: Option<serde_json::Value>,
    /// The picture of the pixels that count (nerfstudio): white where they do.
    mask_path: Option<serde_json::Value>,
    /// The camera's name, where `dash prepare` wrote the file; what others may mean by it is skipped.
    camera_name: Option<serde_json::Value>,
    /// Camera to world, OpenGL axes, rows; 4x4 or 3x4.
    transform_matrix: Vec<Vec<f64>>,
    #[serde(flatten)]
    own: Intrinsics,
}

/// Camera parameters, which stand at the top level, in each frame, or in both (the frame's count).
#[derive(Debug, Clone, Default, Deserialize)]
struct Intrinsics {
    camera_model: Option<String>,
    is_fisheye: Option<bool>,
    camera_angle_x: Option<f64>,
    camera_angle_y: Option<f64>,
    fl_x: Option<f64>,
    fl_y: Option<f64>,
    cx: Option<f64>,
    cy: Option<f64>,
    w: Option<f64>,
    h: Option<f64>,
    k1: Option<f64>,
    k2: Option<f64>,
    k3: Option<f64>,
    k4: Option<f64>,
    p1: Option<f64>,
    p2: Option<f64>,
}

impl Frame {
    /// The name of the camera, where the file states one.
    pub(super) fn camera_name(&self) -> Option<&str> {
        self.camera_name.as_ref()?.as_str()
    }

    /// The number of the time, where the file states one.
    pub(super) fn timestep_index(&self) -> Option<f64> {
        self.timestep_index.as_ref()?.as_f64()
    }

    /// The path of the mask, where the file states one.
    pub(super) fn mask_path(&self) -> Option<&str> {
        self.mask_path.as_ref()?.as_str()
    }
}

/// Reads a file, which may list no frames.
pub(super) fn parse_any(path: &Path) -> Result<Transforms, DatasetError> {
    let bytes = fs::read(path).map_err(DatasetError::io(path))?;
    parse_json(&bytes).map_err(|e| {
        DatasetError::invalid(
            path,
            "JSON with `frames`, each with `file_path` and `transform_matrix`",
            e.to_string(),
            "mend the file or write it again",
        )
    })
}

/// Reads a file with at least one frame.
pub(super) fn parse(path: &Path) -> Result<Transforms, DatasetError> {
    let transforms = parse_any(path)?;
    if transforms.frames.is_empty() {
        return Err(DatasetError::invalid(
            path,
            "at least one frame",
            "none",
            "add frames",
        ));
    }
    Ok(transforms)
}

impl Transforms {
    /// The camera of a frame and its lens distortion; `image_size` reads the image's header and is
    /// asked only where the file does not state the size.
    pub(super) fn camera(
        &self,
        path: &Path,
        frame: &Frame,
        image_size: impl FnOnce() -> Result<(usize, usize), DatasetError>,
    ) -> Result<(Camera, Distortion), DatasetError> {
        let malformed = |expected: &str, found: String| {
            DatasetError::invalid(
                path,
                expected,
                format!("{found} in frame `{}`", frame.file_path),
                "mend that frame's entry or the file's top level",
            )
        };
        let (own, shared) = (&frame.own, &self.shared);
        check_model(own, shared).map_err(|found| malformed("a perspective camera model", found))?;
        let (width, height) = match (own.w.or(shared.w), own.h.or(shared.h)) {
            (Some(w), Some(h)) => {
                let side = |v: f64| v.fract() == 0.0 && v >= 1.0 && v <= f64::from(MAX_IMAGE_SIDE);
                if !(side(w) && side(h)) {
                    return Err(malformed(
                        "whole numbers `w` and `h`",
                        format!("{w} and {h}"),
                    ));
                }
                (w as usize, h as usize)
            }
            _ => image_size()?,
        };
        let (w, h) = (width as f64, height as f64);
        let from_angle =
            |angle: Option<f64>, side: f64| angle.map(|a| 0.5 * side / (0.5 * a).tan());
        let focal = |i: &Intrinsics| i.fl_x.or(from_angle(i.camera_angle_x, w));
        let Some(fx) = focal(own).or(focal(shared)) else {
            return Err(malformed("`fl_x` or `camera_angle_x`", "neither".into()));
        };
        let focal_y = |i: &Intrinsics| {
            i.fl_y
                .or(i.fl_x)
                .or(from_angle(i.camera_angle_y, h))
                .or(from_angle(i.camera_angle_x, w))
        };
        let fy = focal_y(own).or(focal_y(shared)).unwrap_or(fx);
        let cx = own.cx.or(shared.cx).unwrap_or(w / 2.0);
        let cy = own.cy.or(shared.cy).unwrap_or(h / 2.0);
        let positive = |v: f64| v > 0.0 && v.is_finite();
        if !(positive(fx) && positive(fy) && cx.is_finite() && cy.is_finite()) {
            let found = format!("focal lengths {fx}, {fy}, principal point {cx}, {cy}");
            return Err(malformed("positive finite intrinsics", found));
        }
        let coefficient = |own: Option<f64>, shared: Option<f64>| own.or(shared).unwrap_or(0.0);
        let distortion = Distortion {
            k: [
                coefficient(own.k1, shared.k1),
                coefficient(own.k2, shared.k2),
                coefficient(own.k3, shared.k3),
                coefficient(own.k4, shared.k4),
            ],
            p: [
                coefficient(own.p1, shared.p1),
                coefficient(own.p2, shared.p2),
            ],
        };
        let intrinsics = Camera::new(fx, fy, cx, cy, width, height);
        let camera = place(intrinsics, &frame.transform_matrix)
            .map_err(|found| malformed("a camera-to-world matrix, 4x4 or 3x4", found))?;
        Ok((camera, distortion))
    }
}

/// Places a camera by a camera-to-world matrix with OpenGL axes (x right, y up, z backwards).
fn place(intrinsics: Camera, matrix: &[Vec<f64>]) -> Result<Camera, String> {
    if !matches!(matrix.len(), 3 | 4) || matrix.iter().any(|row| row.len() != 4) {
        let lengths: Vec<usize> = matrix.iter().take(5).map(Vec::len).collect();
        return Err(format!("{} rows of lengths {lengths:?}", matrix.len()));
    }
    let column = |c: usize| [matrix[0][c], matrix[1][c], matrix[2][c]];
    let axes = [column(0), column(1).map(|v| -v), column(2).map(|v| -v)];
    pose::place(intrinsics, axes, column(3))
}

fn check_model(own: &Intrinsics, shared: &Intrinsics) -> Result<(), String> {
    const PERSPECTIVE: [&str; 6] = [
        "OPENCV",
        "PINHOLE",
        "SIMPLE_PINHOLE",
        "SIMPLE_RADIAL",
        "RADIAL",
        "PERSPECTIVE",
    ];
    if own.is_fisheye.or(shared.is_fisheye) == Some(true) {
        return Err("`is_fisheye`: a fisheye lens, which is not supported".into());
    }
    match own.camera_model.as_ref().or(shared.camera_model.as_ref()) {
        Some(model)
            if !PERSPECTIVE
                .iter()
                .any(|known| known.eq_ignore_ascii_case(model)) =>
        {
            Err(format!(
                "`{model}`, which is not supported (undistort the images first)"
            ))
        }
        _ => Ok(()),
    }
}
