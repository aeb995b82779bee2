//! The `transforms*.json` files of NeRF, D-NeRF, instant-ngp and nerfstudio.

mod applied;
mod keys;
mod pinhole;

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};

use dash_kernels::Camera;
use serde::Deserialize;
use serde_json::Value;

pub(crate) use self::applied::Applied;
use self::pinhole::pinhole;
use super::pose;
use crate::Error;
use crate::dataset::pixels::MAX_IMAGE_SIDE;
use crate::dataset::pixels::distortion::Distortion;
use crate::dataset::pixels::scale::{is_in_the_middle, times_larger};
use crate::files::parse_json;

/// How far the last row of a matrix may be from 0, 0, 0, 1.
const LAST_ROW_TOLERANCE: f64 = 1e-6;
/// Keys of frames that may be their time where `time` is none of them.
const LIKE_TIME: [&str; 9] = [
    "timestamp",
    "Time",
    "t",
    "time_id",
    "frame_time",
    "frame",
    "frame_id",
    "frame_index",
    "frame_number",
];

/// One file.
#[derive(Debug, Deserialize)]
pub(crate) struct Transforms {
    #[serde(flatten)]
    shared: Intrinsics,
    pub(crate) frames: Vec<Frame>,
    /// Initial points (nerfstudio).
    pub(crate) ply_file_path: Option<String>,
    /// File paths of the frames to train on (nerfstudio).
    #[serde(default)]
    pub(crate) train_filenames: Vec<String>,
    /// File paths of the frames to hold out.
    #[serde(default)]
    pub(crate) test_filenames: Vec<String>,
    /// The same, which serve where there are none to test.
    #[serde(default)]
    pub(crate) val_filenames: Vec<String>,
    /// Every further key; see `keys.rs`.
    #[serde(flatten)]
    other: BTreeMap<String, Value>,
    /// Whether it was said that intrinsics are scaled.
    #[serde(skip)]
    is_scaling_told: AtomicBool,
}

/// One image's entry.
#[derive(Debug, Deserialize)]
pub(crate) struct Frame {
    pub(crate) file_path: String,
    pub(crate) time: Option<f64>,
    /// The number of the time, in captures without `time`.
    timestep_index: Option<Value>,
    /// The time in seconds in files by `dash prepare`; anything but a number is ignored.
    seconds: Option<Value>,
    /// The picture of the pixels that count (nerfstudio): white where they do.
    mask_path: Option<Value>,
    /// The camera's name in files by `dash prepare`; anything but text is ignored.
    camera_name: Option<Value>,
    /// Camera to world, OpenGL axes, rows; 4x4 or 3x4.
    transform_matrix: Vec<Vec<f64>>,
    #[serde(flatten)]
    own: Intrinsics,
    /// Every further key; see `keys.rs`.
    #[serde(flatten)]
    other: BTreeMap<String, Value>,
}

/// Camera parameters, which stand at the top level, in each frame, or in both (the frame's count).
#[derive(Debug, Clone, Default, Deserialize)]
struct Intrinsics {
    camera_model: Option<String>,
    is_fisheye: Option<bool>,
    camera_angle_x: Option<f64>,
    camera_angle_y: Option<f64>,
    /// Degrees (instant-ngp).
    x_fov: Option<f64>,
    y_fov: Option<f64>,
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
    /// k1, k2, k3, k4, p1, p2 in one list (nerfstudio).
    distortion_params: Option<Vec<f64>>,
}

impl Frame {
    /// The name of the camera, where the file states one.
    pub(crate) fn camera_name(&self) -> Option<&str> {
        self.camera_name.as_ref()?.as_str()
    }

    /// The number of the time, where the file states one.
    pub(crate) fn timestep_index(&self) -> Option<f64> {
        self.timestep_index.as_ref()?.as_f64()
    }

    /// The time in seconds, where the file states one.
    pub(crate) fn seconds(&self) -> Option<f64> {
        self.seconds.as_ref()?.as_f64()
    }

    /// The path of the mask, where the file states one.
    pub(crate) fn mask_path(&self) -> Option<&str> {
        self.mask_path.as_ref()?.as_str()
    }
}

/// Reads a file, which may list no frames.
///
/// # Errors
/// When it is damaged, or says something of pixels or poses that can't be followed.
pub(crate) fn parse_any(path: &Path) -> Result<Transforms, Error> {
    let bytes = fs::read(path).map_err(Error::access(path))?;
    let transforms: Transforms = parse_json(&bytes).map_err(|e| {
        Error::invalid(
            path,
            "JSON with `frames`, each with `file_path` and `transform_matrix`",
            e.to_string(),
            "mend the file or write it again",
        )
    })?;
    transforms.check_keys(path)?;
    Ok(transforms)
}

/// Reads a file with at least one frame.
pub(crate) fn parse(path: &Path) -> Result<Transforms, Error> {
    let transforms = parse_any(path)?;
    if transforms.frames.is_empty() {
        return Err(Error::invalid(
            path,
            "at least one frame",
            "none",
            "add frames",
        ));
    }
    Ok(transforms)
}

impl Transforms {
    /// Whether frames are of different times.
    pub(crate) fn has_times(&self) -> bool {
        let times = |frame: &Frame| (frame.time, frame.timestep_index());
        self.frames
            .windows(2)
            .any(|pair| times(&pair[0]) != times(&pair[1]))
    }

    /// A key of frames without `time` that may be meant by it: its numbers differ from frame to frame.
    pub(crate) fn key_like_time(&self) -> Option<&'static str> {
        let number = |frame: &Frame, key: &str| frame.other.get(key).and_then(Value::as_f64);
        let has_time = |frame: &Frame| frame.time.is_some() || frame.timestep_index().is_some();
        let may_be = |key: &&str| {
            let first = self.frames.first().and_then(|frame| number(frame, key));
            let all = || self.frames.iter().map(|frame| number(frame, key));
            first.is_some() && all().all(|n| n.is_some()) && all().any(|n| n != first)
        };
        match self.frames.iter().any(has_time) {
            true => None,
            false => LIKE_TIME.into_iter().find(may_be),
        }
    }

    /// The camera of a frame and its lens distortion; `image_size` reads the image's header and is
    /// asked only where the file does not state the size. Then the principal point says whether the intrinsics
    /// are of pictures of that size, and they are scaled where one factor brings them to it.
    pub(crate) fn camera(
        &self,
        path: &Path,
        frame: &Frame,
        image_size: impl FnOnce() -> Result<(usize, usize), Error>,
    ) -> Result<(Camera, Distortion), Error> {
        let malformed = |expected: &str, found: String| {
            Error::invalid(
                path,
                expected,
                format!("{found} in frame `{}`", frame.file_path),
                "mend that frame's entry or the file's top level",
            )
        };
        let (own, shared) = (&frame.own, &self.shared);
        check_model(own, shared).map_err(|found| malformed("a perspective camera model", found))?;
        let mut times = 1.0;
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
            _ => {
                let size = image_size()?;
                times = self.times_larger(path, frame, size)?;
                size
            }
        };
        // The size of the images that the intrinsics belong to.
        let (w, h) = (width as f64 * times, height as f64 * times);
        let [fx, fy, cx, cy] =
            pinhole(own, shared, [w, h]).map_err(|(expected, found)| malformed(expected, found))?;
        let [fx, fy, cx, cy] = [fx, fy, cx, cy].map(|v| v / times);
        let intrinsics = Camera::new(fx, fy, cx, cy, width, height);
        let camera = place(intrinsics, &frame.transform_matrix)
            .map_err(|found| malformed("a camera-to-world matrix, 4x4 or 3x4", found))?;
        let distortion = distortion(own, shared).map_err(|found| {
            let expected = "`distortion_params` of 6 numbers (k1, k2, k3, k4, p1, p2)";
            malformed(expected, found)
        })?;
        Ok((camera, distortion))
    }

    /// A size of pictures that a frame's intrinsics can be of, by their principal point.
    pub(crate) fn size_by_middle(&self, frame: &Frame) -> Option<(usize, usize)> {
        let [cx, cy] = self.principal_point(frame);
        let side = |at: f64| {
            let side = (2.0 * at).clamp(1.0, f64::from(MAX_IMAGE_SIDE));
            (side as usize).max(1)
        };
        Some((side(cx?), side(cy?)))
    }

    fn principal_point(&self, frame: &Frame) -> [Option<f64>; 2] {
        let (own, shared) = (&frame.own, &self.shared);
        [own.cx.or(shared.cx), own.cy.or(shared.cy)]
    }

    /// How many times larger than pictures of this size those are that a frame's intrinsics are of, for files
    /// that do not state it; said once where it is not 1.
    ///
    /// # Errors
    /// When the principal point can't be of any such pictures.
    fn times_larger(
        &self,
        path: &Path,
        frame: &Frame,
        size @ (width, height): (usize, usize),
    ) -> Result<f64, Error> {
        let stated = self.principal_point(frame);
        if stated == [None, None] {
            return Ok(1.0);
        }
        let cx = stated[0].unwrap_or(width as f64 / 2.0);
        let cy = stated[1].unwrap_or(height as f64 / 2.0);
        match times_larger([cx, cy], size) {
            Some(times) => {
                if times != 1.0 && !self.is_scaling_told.swap(true, Ordering::Relaxed) {
                    tracing::warn!(
                        "{}: no `w` and `h`, and principal points ({cx}, {cy} in frame `{}`) of pictures {times:.3} \
                         times as large as those that are there ({width}x{height}): focal lengths and principal points \
                         are scaled",
                        path.display(),
                        frame.file_path
                    );
                }
                Ok(times)
            }
            None if is_in_the_middle([cx, cy], size) => Ok(1.0),
            None => Err(Error::invalid(
                path,
                format!("a principal point near the middle of the {width}x{height} pictures"),
                format!("{cx}, {cy} in frame `{}`", frame.file_path),
                "state the size that the intrinsics are for as `w` and `h`, or scale them with the pictures",
            )),
        }
    }
}

/// The coefficients of a frame, each the frame's own or else the file's.
fn distortion(own: &Intrinsics, shared: &Intrinsics) -> Result<Distortion, String> {
    let (own, shared) = (own.coefficients()?, shared.coefficients()?);
    let [k1, k2, k3, k4, p1, p2] =
        std::array::from_fn(|index| own[index].or(shared[index]).unwrap_or(0.0));
    Ok(Distortion {
        k: [k1, k2, k3, k4],
        p: [p1, p2],
    })
}

impl Intrinsics {
    /// k1, k2, k3, k4, p1, p2, from the list or one by one, or what is wrong with them.
    fn coefficients(&self) -> Result<[Option<f64>; 6], String> {
        let single = [self.k1, self.k2, self.k3, self.k4, self.p1, self.p2];
        let list = match self.distortion_params.as_deref() {
            None => return Ok(single),
            // No lens of any kind.
            Some(zeros) if zeros.iter().all(|&value| value == 0.0) => [0.0; 6],
            Some(list) => list
                .try_into()
                .map_err(|_| format!("{} numbers", list.len()))?,
        };
        let differs = |(single, listed): (&Option<f64>, &f64)| single.is_some_and(|v| v != *listed);
        match single.iter().zip(&list).any(differs) {
            true => Err("others than k1 to p2 beside them".into()),
            false => Ok(list.map(Some)),
        }
    }
}

/// Places a camera by a camera-to-world matrix with OpenGL axes (x right, y up, z backwards).
fn place(intrinsics: Camera, matrix: &[Vec<f64>]) -> Result<Camera, String> {
    if !matches!(matrix.len(), 3 | 4) || matrix.iter().any(|row| row.len() != 4) {
        let lengths: Vec<usize> = matrix.iter().take(5).map(Vec::len).collect();
        return Err(format!("{} rows of lengths {lengths:?}", matrix.len()));
    }
    let off = |row: &[f64]| -> f64 {
        let pairs = row.iter().zip([0.0, 0.0, 0.0, 1.0]);
        pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
    };
    if let Some(last) = matrix.get(3).filter(|last| off(last) > LAST_ROW_TOLERANCE) {
        let last_column: Vec<f64> = matrix.iter().map(|row| row[3]).collect();
        let turned = match off(&last_column) <= LAST_ROW_TOLERANCE {
            true => " and a last column of 0, 0, 0, 1: rows and columns are exchanged",
            false => "",
        };
        return Err(format!("a last row of {last:?}{turned}"));
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
