//! Where each layout keeps its files, and the files that hold its cameras.

use super::cloud::CloudPoint;
use super::colmap;
use super::config::{SynthConfig, SynthLayout};
use super::files;
use super::nerfies;
use super::panoptic;
use super::poses::{bounds, opengl_world_from_camera, quaternion};
use super::truth::ViewStats;
use crate::Error;
use dash_kernels::Camera;
use serde_json::{Value, json};
use std::path::Path;

/// Columns of a row of `poses_bounds.npy`: a 3x5 matrix, near and far.
const POSES_BOUNDS_COLUMNS: usize = 17;

impl SynthLayout {
    /// The picture of a camera at a frame, relative to the dataset.
    pub fn image_path(self, camera: usize, frame: usize, frames: usize) -> String {
        match self {
            Self::N3dv => format!("cam{camera:02}/images/{frame:04}.png"),
            Self::Blender => format!("{}.png", blender_stem(camera, frame, frames)),
            Self::Colmap => format!("images/cam{camera:02}.png"),
            Self::Technicolor => format!("Synth_undist_{frame:05}_{camera:02}.png"),
            Self::Nerfies => format!("rgb/1x/{}.png", nerfies::id(camera, frame)),
            Self::Panoptic => format!("ims/{}", panoptic::name(camera, frame)),
            Self::Rig => format!("images/cam{camera:02}/{frame:04}.png"),
        }
    }

    /// The video of a camera, relative to the dataset, where there are videos.
    pub fn video_path(self, camera: usize) -> String {
        match self {
            Self::Rig => format!("videos/cam{camera:02}.mp4"),
            _ => format!("cam{camera:02}.mp4"),
        }
    }

    /// Its true motion mask, relative to the dataset.
    pub fn mask_path(self, camera: usize, frame: usize, frames: usize) -> String {
        match self {
            Self::N3dv | Self::Rig => format!("motion_masks/cam{camera:02}/{frame:04}.png"),
            Self::Blender => format!("motion_masks/{}.png", blender_stem(camera, frame, frames)),
            Self::Colmap => format!("motion_masks/cam{camera:02}.png"),
            Self::Technicolor => format!("motion_masks/cam{camera:02}/{frame:05}.png"),
            Self::Nerfies => format!("motion_masks/{}.png", nerfies::id(camera, frame)),
            Self::Panoptic => format!("motion_masks/{}", panoptic::name(camera, frame)),
        }
    }

    /// The point cloud's file, relative to the dataset.
    pub fn cloud_name(self) -> &'static str {
        match self {
            Self::N3dv | Self::Technicolor => "points3D_downsample2.ply",
            Self::Blender | Self::Rig => "points3d.ply",
            Self::Colmap => "sparse/0/points3D.bin",
            Self::Nerfies => "points.npy",
            Self::Panoptic => "init_pt_cld.npz",
        }
    }

    pub(super) fn write_cloud(self, root: &Path, points: &[CloudPoint]) -> Result<(), Error> {
        let path = root.join(self.cloud_name());
        match self {
            Self::Colmap => files::write_bytes(&path, &colmap::points(points)),
            Self::Nerfies => {
                // The layout has no colours.
                let positions = points.iter().flat_map(|p| [p.x, p.y, p.z].map(f64::from));
                files::write_npy(&path, &positions.collect::<Vec<_>>(), 3)
            }
            Self::Panoptic => files::write_bytes(&path, &panoptic::cloud(points)),
            _ => files::write_ply(&path, points),
        }
    }

    pub(super) fn write_cameras(
        self,
        root: &Path,
        config: &SynthConfig,
        cameras: &[Camera],
        stats: &[ViewStats],
    ) -> Result<(), Error> {
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
                for (name, indices) in [("test", test), ("train", train)] {
                    let path = root.join(format!("transforms_{name}.json"));
                    files::write_json(&path, &transforms(config, cameras, indices))?;
                }
                Ok(())
            }
            Self::Colmap => colmap::write_cameras(root, cameras),
            Self::Technicolor => {
                let path = root.join("cameras_parameters.txt");
                files::write_bytes(&path, camera_parameters(cameras).as_bytes())
            }
            Self::Nerfies => nerfies::write_cameras(root, config, cameras, stats),
            Self::Panoptic => panoptic::write_cameras(root, config, cameras),
            Self::Rig => files::write_json(&root.join("transforms.json"), &rig(cameras)),
        }
    }
}

/// Technicolor's file: a header, and per camera focal length, principal point, aspect, skew,
/// quaternion and translation (world to camera).
fn camera_parameters(cameras: &[Camera]) -> String {
    let mut text = String::from("f cu cv ar sk qw qx qy qz tx ty tz\n");
    for camera in cameras {
        let intrinsics = [camera.fx, camera.cx, camera.cy, camera.fy / camera.fx, 0.0];
        let pose = quaternion(camera).into_iter().chain(camera.translation);
        let numbers: Vec<String> = intrinsics
            .into_iter()
            .chain(pose)
            .map(|number| number.to_string())
            .collect();
        text += &numbers.join(" ");
        text.push('\n');
    }
    text
}

/// The poses of a rig of videos, by the videos' names.
fn rig(cameras: &[Camera]) -> Value {
    let frames: Vec<Value> = cameras
        .iter()
        .enumerate()
        .map(|(index, camera)| {
            json!({
                "file_path": SynthLayout::Rig.video_path(index),
                "transform_matrix": opengl_world_from_camera(camera),
                "fl_x": camera.fx,
                "fl_y": camera.fy,
                "cx": camera.cx,
                "cy": camera.cy,
                "w": camera.width,
                "h": camera.height,
            })
        })
        .collect();
    json!({ "camera_model": "PINHOLE", "frames": frames })
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
fn poses_bounds_row(camera: &Camera, depth_range: [f64; 2]) -> [f64; POSES_BOUNDS_COLUMNS] {
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
    row[15..].copy_from_slice(&bounds(depth_range));
    row
}

/// A D-NeRF camera file for some of the cameras.
fn transforms(config: &SynthConfig, cameras: &[Camera], indices: std::ops::Range<usize>) -> Value {
    let camera = &cameras[0];
    let mut frames = Vec::new();
    for index in indices {
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
