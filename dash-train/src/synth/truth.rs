//! The exact truth about a rendered clip, for `truth.json`.

use super::config::{SceneKind, SynthConfig};
use super::pose::Pose;
use super::scene::Scene;
use dash_kernels::Camera;
use serde::{Deserialize, Serialize};

/// How the masks are made, for readers of `truth.json`.
pub const MASK_RULE: &str = "255 where a moving object is the nearest surface in at least half of \
    the pixel's 4x4 samples, else 0";

/// The contents of `truth.json`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Truth {
    /// Which scene.
    pub scene: SceneKind,
    /// Its seed.
    pub seed: u64,
    /// Number of frames.
    pub frames: usize,
    /// Time of each frame, in [0, 1].
    pub times: Vec<f64>,
    /// What the masks mean.
    pub mask_rule: String,
    /// Share of moving pixels over all views.
    pub moving_share: f64,
    /// The cameras, camera 0 first.
    pub cameras: Vec<CameraTruth>,
    /// The objects.
    pub objects: Vec<ObjectTruth>,
}

/// A camera, exactly: OpenCV axes, pixel centres at +0.5.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CameraTruth {
    /// `cam00` and so on.
    pub name: String,
    /// Picture width in pixels.
    pub width: usize,
    /// Picture height in pixels.
    pub height: usize,
    /// Horizontal focal length in pixels.
    pub fx: f64,
    /// Vertical focal length in pixels.
    pub fy: f64,
    /// Principal point from the left edge, in pixels.
    pub cx: f64,
    /// Principal point from the top edge, in pixels.
    pub cy: f64,
    /// World to camera: a rotation and, in the last column, a translation in metres.
    pub camera_from_world: [[f64; 4]; 3],
    /// Share of moving pixels over the camera's frames.
    pub moving_share: f64,
    /// The mask of each frame, relative to the dataset.
    pub masks: Vec<String>,
}

/// An object and whether it moves.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ObjectTruth {
    /// Its name.
    pub name: String,
    /// Whether it moves during the clip.
    pub moving: bool,
    /// World from object, of each frame; empty if it rests.
    pub world_from_object: Vec<[[f64; 4]; 3]>,
}

/// What rendering a camera's frames showed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct ViewStats {
    /// Mean share of moving pixels.
    pub moving_share: f64,
    /// Nearest and farthest depth, in metres.
    pub depth_range: [f64; 2],
}

impl Truth {
    pub(super) fn new(
        config: &SynthConfig,
        scene: &Scene,
        cameras: &[Camera],
        stats: &[ViewStats],
    ) -> Self {
        let times: Vec<f64> = (0..config.frames).map(|frame| config.time(frame)).collect();
        let layout = config.layout;
        let cameras = cameras
            .iter()
            .zip(stats)
            .enumerate()
            .map(|(index, (camera, stats))| CameraTruth {
                name: format!("cam{index:02}"),
                width: camera.width,
                height: camera.height,
                fx: camera.fx,
                fy: camera.fy,
                cx: camera.cx,
                cy: camera.cy,
                camera_from_world: rows(&camera.rotation, &camera.translation),
                moving_share: stats.moving_share,
                masks: (0..config.frames)
                    .map(|frame| layout.mask_path(index, frame, config.frames))
                    .collect(),
            })
            .collect();
        let instants: Vec<_> = times.iter().map(|&time| scene.at(time)).collect();
        let objects = scene
            .objects
            .iter()
            .enumerate()
            .map(|(index, object)| {
                let moving = scene.moves(object);
                let poses = instants.iter().filter(|_| moving);
                ObjectTruth {
                    name: object.name.clone(),
                    moving,
                    world_from_object: poses.map(|i| pose_rows(&i.posed[index].pose)).collect(),
                }
            })
            .collect();
        Self {
            scene: config.scene,
            seed: config.seed,
            frames: config.frames,
            times,
            mask_rule: MASK_RULE.to_owned(),
            moving_share: stats.iter().map(|s| s.moving_share).sum::<f64>()
                / stats.len().max(1) as f64,
            cameras,
            objects,
        }
    }
}

fn pose_rows(pose: &Pose) -> [[f64; 4]; 3] {
    let rotation = pose.rotation.transpose().to_cols_array_2d();
    rows(&rotation, &pose.position.to_array())
}

/// A row-major rotation with a translation as last column.
fn rows(rotation: &[[f64; 3]; 3], translation: &[f64; 3]) -> [[f64; 4]; 3] {
    std::array::from_fn(|i| {
        let [a, b, c] = rotation[i];
        [a, b, c, translation[i]]
    })
}
