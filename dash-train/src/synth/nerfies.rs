//! The JSON files of the Nerfies layout.

use super::config::SynthConfig;
use super::files;
use super::poses::bounds;
use super::truth::ViewStats;
use crate::Error;
use dash_kernels::Camera;
use serde_json::{Map, Value, json};
use std::path::Path;

/// What a picture is called.
pub(super) fn id(camera: usize, frame: usize) -> String {
    format!("{camera:02}_{frame:05}")
}

/// `camera/ID.json` for every picture, the lists of ids, and the scene's scale, which is 1.
pub(super) fn write_cameras(
    root: &Path,
    config: &SynthConfig,
    cameras: &[Camera],
    stats: &[ViewStats],
) -> Result<(), Error> {
    let mut ids: Vec<String> = Vec::new();
    let mut metadata = Map::new();
    for (index, camera) in cameras.iter().enumerate() {
        let file = camera_file(camera);
        for frame in 0..config.frames {
            let id = id(index, frame);
            files::write_json(&root.join(format!("camera/{id}.json")), &file)?;
            let entry = json!({
                "warp_id": frame, "time_id": frame, "appearance_id": frame, "camera_id": index
            });
            metadata.insert(id.clone(), entry);
            ids.push(id);
        }
    }
    files::write_json(&root.join("metadata.json"), &metadata)?;
    // Camera 0 is held out.
    let (val_ids, train_ids) = ids.split_at(config.frames);
    let lists = json!({
        "count": ids.len(),
        "num_exemplars": train_ids.len(),
        "ids": ids,
        "train_ids": train_ids,
        "val_ids": val_ids,
    });
    files::write_json(&root.join("dataset.json"), &lists)?;
    let depths = stats.iter().map(|stats| stats.depth_range);
    let [near, far] = bounds(depths.fold([f64::INFINITY, 0.0], |a, b| {
        [a[0].min(b[0]), a[1].max(b[1])]
    }));
    let scene = json!({
        "scale": 1.0,
        "center": [0.0, 0.0, 0.0],
        "near": near,
        "far": far,
    });
    files::write_json(&root.join("scene.json"), &scene)
}

fn camera_file(camera: &Camera) -> Value {
    json!({
        "orientation": camera.rotation,
        "position": camera.position(),
        "focal_length": camera.fx,
        "principal_point": [camera.cx, camera.cy],
        "skew": 0.0,
        "pixel_aspect_ratio": camera.fy / camera.fx,
        "radial_distortion": [0.0, 0.0, 0.0],
        "tangential_distortion": [0.0, 0.0],
        "image_size": [camera.width, camera.height],
    })
}
