//! The dataset's files beside its images: `transforms*.json` and the points.

use std::fs;
use std::path::{Path, PathBuf};

use serde::Serialize;

use super::schedule::Schedule;
use crate::Error;
use crate::dataset::poses::known::KnownCamera;
use crate::ply::{PointCloud, write_points};

const POINTS: &str = "points3d.ply";

/// A `transforms*.json` in the form of nerfstudio, with a time for each frame.
#[derive(Serialize)]
struct Transforms<'a> {
    camera_model: &'static str,
    #[serde(skip_serializing_if = "Option::is_none")]
    ply_file_path: Option<&'static str>,
    frames: Vec<Frame<'a>>,
}

#[derive(Serialize)]
struct Frame<'a> {
    file_path: String,
    /// Ours, others skip it.
    camera_name: &'a str,
    /// In [0, 1] over the clip.
    time: f64,
    /// In the rig's time; ours, others skip it.
    seconds: f64,
    w: usize,
    h: usize,
    fl_x: f64,
    fl_y: f64,
    cx: f64,
    cy: f64,
    k1: f64,
    k2: f64,
    k3: f64,
    k4: f64,
    p1: f64,
    p2: f64,
    /// Camera to world, OpenGL axes.
    transform_matrix: [[f64; 4]; 4],
}

/// A camera with its frames on disk.
pub(super) struct WrittenCamera<'a> {
    pub(super) name: &'a str,
    /// At the frames' size.
    pub(super) known: &'a KnownCamera,
    /// By frame; `None` where the camera recorded none.
    pub(super) frames: &'a [Option<PathBuf>],
    pub(super) held_out: bool,
}

/// Writes the poses: training and test cameras in a file each, or all of them in one where no camera
/// is held out.
pub(super) fn write_transforms(
    dataset: &Path,
    cameras: &[WrittenCamera],
    schedule: &Schedule,
    has_points: bool,
) -> Result<(), Error> {
    let with_tests = cameras.iter().any(|camera| camera.held_out);
    let files: &[(&str, bool)] = match with_tests {
        true => &[
            ("transforms_train.json", false),
            ("transforms_test.json", true),
        ],
        false => &[("transforms.json", false)],
    };
    for &(name, held_out) in files {
        let wanted = cameras.iter().filter(|camera| camera.held_out == held_out);
        let transforms = Transforms {
            camera_model: "OPENCV",
            ply_file_path: has_points.then_some(POINTS),
            frames: wanted
                .flat_map(|camera| frames(dataset, camera, schedule))
                .collect(),
        };
        let path = dataset.join(name);
        let text =
            serde_json::to_vec_pretty(&transforms).map_err(|e| Error::access(&path)(e.into()))?;
        fs::write(&path, text).map_err(Error::access(&path))?;
    }
    Ok(())
}

fn frames<'a>(
    dataset: &Path,
    written: &WrittenCamera<'a>,
    schedule: &Schedule,
) -> impl Iterator<Item = Frame<'a>> {
    let (name, KnownCamera { camera, distortion }) = (written.name, written.known);
    let n = written.frames.len();
    let recorded = written.frames.iter().enumerate();
    let recorded = recorded.filter_map(|(frame, file)| Some((frame, file.as_ref()?)));
    recorded.map(move |(frame, file)| {
        let inside = file.strip_prefix(dataset).unwrap_or(file);
        Frame {
            file_path: inside.to_string_lossy().replace('\\', "/"),
            camera_name: name,
            time: frame as f64 / n.saturating_sub(1).max(1) as f64,
            seconds: schedule.time(frame),
            w: camera.width,
            h: camera.height,
            fl_x: camera.fx,
            fl_y: camera.fy,
            cx: camera.cx,
            cy: camera.cy,
            k1: distortion.k[0],
            k2: distortion.k[1],
            k3: distortion.k[2],
            k4: distortion.k[3],
            p1: distortion.p[0],
            p2: distortion.p[1],
            transform_matrix: camera_to_world(written.known),
        }
    })
}

/// Columns right, up, backwards and the position.
fn camera_to_world(known: &KnownCamera) -> [[f64; 4]; 4] {
    let [right, down, forward] = known.camera.rotation;
    let position = known.camera.position();
    let row = |axis: usize| [right[axis], -down[axis], -forward[axis], position[axis]];
    [row(0), row(1), row(2), [0.0, 0.0, 0.0, 1.0]]
}

/// Writes the points where readers find them.
pub(super) fn write_cloud(dataset: &Path, points: &PointCloud) -> Result<(), Error> {
    write_points(&dataset.join(POINTS), points)
}
