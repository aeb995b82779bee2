//! Where each layout keeps its files, and the files that hold its cameras.

use super::SynthError;
use super::config::{SynthConfig, SynthLayout};
use super::files;
use super::truth::ViewStats;
use dash_kernels::Camera;
use serde_json::{Value, json};
use std::path::Path;

/// Columns of a row of `poses_bounds.npy`: a 3x5 matrix, near and far.
const POSES_BOUNDS_COLUMNS: usize = 17;
/// Room left between the bounds and the nearest and farthest surface.
const BOUNDS_MARGIN: f64 = 0.1;

impl SynthLayout {
    /// The picture of a camera at a frame, relative to the dataset.
    pub fn image_path(self, camera: usize, frame: usize, frames: usize) -> String {
        match self {
            Self::N3dv => format!("cam{camera:02}/images/{frame:04}.png"),
            Self::Blender => format!("{}.png", blender_stem(camera, frame, frames)),
        }
    }

    /// The truth about what moves in it, relative to the dataset.
    pub fn mask_path(self, camera: usize, frame: usize, frames: usize) -> String {
        match self {
            Self::N3dv => format!("motion_masks/cam{camera:02}/{frame:04}.png"),
            Self::Blender => format!("motion_masks/{}.png", blender_stem(camera, frame, frames)),
        }
    }

    /// The point cloud's file name.
    pub fn cloud_name(self) -> &'static str {
        match self {
            Self::N3dv => "points3D_downsample2.ply",
            Self::Blender => "points3d.ply",
        }
    }

    pub(super) fn write_cameras(
        self,
        root: &Path,
        config: &SynthConfig,
        cameras: &[Camera],
        stats: &[ViewStats],
    ) -> Result<(), SynthError> {
        match self {
            Self::N3dv => {
                let table: Vec<f64> = cameras
                    .iter()
                    .zip(stats)
                    .flat_map(|(camera, stats)| poses_bounds_row(camera, stats.depth_range))
                    .collect();
                let path = root.join("poses_bounds.npy");
                files::write_npy(&path, &table, POSES_BOUNDS_COLUMNS)
            }
            Self::Blender => {
                // Camera 0 is held out; `skip` and `take` keep its index.
                let (test, train) = (0..1, 1..cameras.len());
                for (name, split) in [("test", test), ("train", train)] {
                    let path = root.join(format!("transforms_{name}.json"));
                    files::write_json(&path, &transforms(config, cameras, split))?;
                }
                Ok(())
            }
        }
    }
}

/// `test/r_FRAME` for camera 0; the others follow each other in `train`.
fn blender_stem(camera: usize, frame: usize, frames: usize) -> String {
    match camera {
        0 => format!("test/r_{frame:04}"),
        _ => format!("train/r_{:04}", (camera - 1) * frames + frame),
    }
}

/// A row of `poses_bounds.npy`: camera-to-world with columns down, right, backwards, then the
/// position, then height, width, focal length; near and far.
fn poses_bounds_row(camera: &Camera, [near, far]: [f64; 2]) -> [f64; POSES_BOUNDS_COLUMNS] {
    let [right, down, forward] = camera.rotation;
    let position = camera.position();
    let intrinsics = [camera.height as f64, camera.width as f64, camera.fx];
    let mut row = [0.0; POSES_BOUNDS_COLUMNS];
    for axis in 0..3 {
        row[5 * axis..5 * axis + 5].copy_from_slice(&[
            down[axis],
            right[axis],
            -forward[axis],
            position[axis],
            intrinsics[axis],
        ]);
    }
    row[15] = near * (1.0 - BOUNDS_MARGIN);
    row[16] = far * (1.0 + BOUNDS_MARGIN);
    row
}

/// A D-NeRF camera file for some of the cameras.
fn transforms(config: &SynthConfig, cameras: &[Camera], split: std::ops::Range<usize>) -> Value {
    let camera = &cameras[0];
    let mut frames = Vec::new();
    for index in split {
        for frame in 0..config.frames {
            frames.push(json!({
                "file_path": format!("./{}", blender_stem(index, frame, config.frames)),
                "time": config.time(frame),
                "transform_matrix": opengl_world_from_camera(&cameras[index]),
            }));
        }
    }
    json!({
        "camera_angle_x": 2.0 * (0.5 * camera.width as f64 / camera.fx).atan(),
        "fl_x": camera.fx,
        "fl_y": camera.fy,
        "cx": camera.cx,
        "cy": camera.cy,
        "w": camera.width,
        "h": camera.height,
        "frames": frames,
    })
}

/// Camera-to-world with OpenGL axes: right, up, backwards.
fn opengl_world_from_camera(camera: &Camera) -> [[f64; 4]; 4] {
    let [right, down, forward] = camera.rotation;
    let position = camera.position();
    let row = |axis: usize| [right[axis], -down[axis], -forward[axis], position[axis]];
    [row(0), row(1), row(2), [0.0, 0.0, 0.0, 1.0]]
}
