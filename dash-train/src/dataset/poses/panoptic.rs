//! `train_meta.json` and `test_meta.json` of Dynamic 3D Gaussians: for each time the pictures of all cameras.

use std::path::Path;

use dash_kernels::Camera;
use serde::Deserialize;

use super::intrinsics::{Intrinsics, Wrong};
use super::pose;
use crate::Error;
use crate::files::parse_json;

/// How far the last row of a matrix may be from 0, 0, 0, 1.
const LAST_ROW_TOLERANCE: f64 = 1e-6;

/// The file's fields. Lists are `[times][cameras]`; OpenCV axes, pixels.
#[derive(Debug, Deserialize)]
pub(crate) struct MetaFile {
    w: f64,
    h: f64,
    /// Intrinsic matrices.
    k: Vec<Vec<[[f64; 3]; 3]>>,
    /// World to camera.
    w2c: Vec<Vec<[[f64; 4]; 4]>>,
    /// Pictures below `ims/`.
    #[serde(rename = "fn")]
    names: Vec<Vec<String>>,
    cam_id: Vec<Vec<u64>>,
}

/// A picture that the file lists.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Picture {
    /// Index of its time in the file.
    pub(crate) time: usize,
    /// Number of its camera.
    pub(crate) camera_id: u64,
    /// Its path below `ims/`.
    pub(crate) name: String,
    /// Its camera at the file's size.
    pub(crate) camera: Camera,
}

/// Every picture of a file, time by time.
///
/// # Errors
/// Names `path`: lists of different lengths, an intrinsic matrix with skew, numbers that are not finite, or a pose that is
/// none.
pub(crate) fn parse(path: &Path, bytes: &[u8]) -> Result<Vec<Picture>, Error> {
    let malformed = |expected: &str, found: String| {
        Error::invalid(path, expected, found, "mend the file or write it again")
    };
    let meta: MetaFile = parse_json(bytes).map_err(|e| {
        malformed(
            "JSON with `w`, `h`, and per time and camera `k`, `w2c`, `fn` and `cam_id`",
            e.to_string(),
        )
    })?;
    let n_times = [
        meta.k.len(),
        meta.w2c.len(),
        meta.names.len(),
        meta.cam_id.len(),
    ];
    if n_times.iter().any(|&n| n != n_times[0]) {
        let found = format!("{n_times:?}");
        return Err(malformed(
            "as many times in `k`, `w2c`, `fn` and `cam_id`",
            found,
        ));
    }
    let mut pictures = Vec::new();
    let times = meta
        .k
        .iter()
        .zip(&meta.w2c)
        .zip(meta.names)
        .zip(meta.cam_id);
    for (time, (((k, w2c), names), ids)) in times.enumerate() {
        let n = [k.len(), w2c.len(), names.len(), ids.len()];
        if n.iter().any(|&cameras| cameras != n[0]) {
            return Err(malformed(
                "as many cameras in `k`, `w2c`, `fn` and `cam_id` at each time",
                format!("{n:?} at time {time}"),
            ));
        }
        for (((k, w2c), name), camera_id) in k.iter().zip(w2c).zip(names).zip(ids) {
            let camera = camera([meta.w, meta.h], k, w2c).map_err(|(expected, found)| {
                malformed(
                    expected,
                    format!("{found} at time {time}, camera {camera_id}"),
                )
            })?;
            pictures.push(Picture {
                time,
                camera_id,
                name,
                camera,
            });
        }
    }
    Ok(pictures)
}

fn camera(size: [f64; 2], k: &[[f64; 3]; 3], w2c: &[[f64; 4]; 4]) -> Result<Camera, Wrong> {
    let [[fx, skew, cx], [_, fy, cy], _] = *k;
    let intrinsics = Intrinsics {
        size,
        focal: [fx, fy],
        principal_point: [cx, cy],
        skew,
    };
    let intrinsics = intrinsics.camera()?;
    let last = [0.0, 0.0, 0.0, 1.0].iter().zip(&w2c[3]);
    if !last
        .map(|(a, b)| (a - b).abs())
        .all(|off| off <= LAST_ROW_TOLERANCE)
    {
        let found = format!("a last row of {:?}", w2c[3]);
        return Err(("world-to-camera matrices `w2c`", found));
    }
    let rows = [0, 1, 2].map(|row| [w2c[row][0], w2c[row][1], w2c[row][2]]);
    // From world = R^T (p - t).
    let position = [0, 1, 2].map(|axis| {
        let along = |row: usize| -rows[row][axis] * w2c[row][3];
        along(0) + along(1) + along(2)
    });
    pose::place(intrinsics, rows, position)
        .map_err(|found| ("world-to-camera matrices `w2c`", found))
}
