//! The files of the layout of Dynamic 3D Gaussians.

use std::io::Write;
use std::path::Path;

use dash_kernels::Camera;
use npyz::WriterBuilder;
use rawzip::ZipArchiveWriter;
use serde_json::{Value, json};

use super::cloud::CloudPoint;
use super::config::SynthConfig;
use super::files;
use crate::Error;

/// Columns of the cloud: position, colour, label.
const CLOUD_COLUMNS: u64 = 7;
/// The label of what does not move; the tracer's cloud does not tell.
const LABEL: f64 = 0.0;

/// A picture below `ims/`.
pub(super) fn name(camera: usize, frame: usize) -> String {
    format!("{camera}/{frame:06}.png")
}

/// `test_meta.json` with camera 0, and `train_meta.json` with the others.
pub(super) fn write_cameras(
    root: &Path,
    config: &SynthConfig,
    cameras: &[Camera],
) -> Result<(), Error> {
    for (part, indices) in [("test", 0..1), ("train", 1..cameras.len())] {
        let indices: Vec<usize> = indices.collect();
        let at_each_time = |of: &dyn Fn(usize, usize) -> Value| -> Vec<Vec<Value>> {
            let row = |frame| indices.iter().map(|&index| of(index, frame)).collect();
            (0..config.frames).map(row).collect()
        };
        let meta = json!({
            "w": config.width,
            "h": config.height,
            "k": at_each_time(&|index, _| intrinsics(&cameras[index])),
            "w2c": at_each_time(&|index, _| camera_from_world(&cameras[index])),
            "fn": at_each_time(&|index, frame| json!(name(index, frame))),
            "cam_id": at_each_time(&|index, _| json!(index)),
        });
        files::write_json(&root.join(format!("{part}_meta.json")), &meta)?;
    }
    Ok(())
}

fn intrinsics(camera: &Camera) -> Value {
    json!([
        [camera.fx, 0.0, camera.cx],
        [0.0, camera.fy, camera.cy],
        [0.0, 0.0, 1.0]
    ])
}

fn camera_from_world(camera: &Camera) -> Value {
    let row = |axis: usize| {
        let [x, y, z] = camera.rotation[axis];
        [x, y, z, camera.translation[axis]]
    };
    json!([row(0), row(1), row(2), [0.0, 0.0, 0.0, 1.0]])
}

/// `init_pt_cld.npz` with the array `data`.
pub(super) fn cloud(points: &[CloudPoint]) -> Vec<u8> {
    const IN_MEMORY: &str = "writing to memory can't fail";
    let mut npy = Vec::new();
    let mut array = npyz::WriteOptions::new()
        .default_dtype()
        .shape(&[points.len() as u64, CLOUD_COLUMNS])
        .writer(&mut npy)
        .begin_nd()
        .expect(IN_MEMORY);
    let rows = points.iter().flat_map(|point| {
        let position = [point.x, point.y, point.z].map(f64::from);
        let color = [point.red, point.green, point.blue].map(|byte| f64::from(byte) / 255.0);
        position.into_iter().chain(color).chain([LABEL])
    });
    array.extend(rows).expect(IN_MEMORY);
    array.finish().expect(IN_MEMORY);
    let mut zip = Vec::new();
    let mut archive = ZipArchiveWriter::new(&mut zip);
    let (mut entry, config) = archive.new_file("data.npy").start().expect(IN_MEMORY);
    let mut writer = config.wrap(&mut entry);
    writer.write_all(&npy).expect(IN_MEMORY);
    let (_, descriptor) = writer.finish().expect(IN_MEMORY);
    entry.finish(descriptor).expect(IN_MEMORY);
    archive.finish().expect(IN_MEMORY);
    zip
}
