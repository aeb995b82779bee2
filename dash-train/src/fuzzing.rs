//! Doors to every parser for hostile bytes: the plain tests in `tests/hostile.rs` and the fuzz targets
//! in `fuzz/` go through them. Not part of the interface.

use std::fs;
use std::path::Path;

use burn::tensor::Device;
use dash_model::{DynamicScene, read_splats};

pub use crate::dataset::fuzzing::{
    cloud_npz, colmap_cameras_binary, colmap_cameras_text, colmap_images_binary,
    colmap_images_text, colmap_points_binary, colmap_points_text, frame_names, image, image_header,
    nerfies_camera, npy, panoptic_meta, points_npy, points_ply, technicolor, transforms,
};

/// A parser that takes bytes and says whether it accepted them.
#[derive(Clone, Copy)]
pub struct Parser {
    /// What it reads.
    pub name: &'static str,
    /// Parses bytes; readers of files find them in a scratch folder, which is given.
    pub accepts: fn(scratch: &Path, bytes: &[u8]) -> bool,
}

/// Every parser.
pub const PARSERS: &[Parser] = &[
    parser("npy", npy),
    parser("points_npy", points_npy),
    parser("cloud_npz", cloud_npz),
    parser("panoptic_meta", panoptic_meta),
    parser("technicolor", technicolor),
    parser("nerfies_camera", nerfies_camera),
    parser("transforms", transforms),
    parser("frame_names", frame_names),
    parser("colmap_cameras_binary", colmap_cameras_binary),
    parser("colmap_images_binary", colmap_images_binary),
    parser("colmap_points_binary", colmap_points_binary),
    parser("colmap_cameras_text", colmap_cameras_text),
    parser("colmap_images_text", colmap_images_text),
    parser("colmap_points_text", colmap_points_text),
    parser("points_ply", points_ply),
    parser("image_header", image_header),
    parser("image", image),
    parser("splat_ply", splat_ply),
    parser("splat_spz", splat_spz),
    parser("splat_raw", splat_raw),
    parser("splat_glb", splat_glb),
    #[cfg(feature = "fourdgs")]
    parser("splat_4dgs", splat_4dgs),
    parser("cameras_json", cameras_json),
    parser("scene", scene),
    parser("checkpoint_state", checkpoint_state),
    parser("config_toml", config_toml),
];

const fn parser(name: &'static str, accepts: fn(&Path, &[u8]) -> bool) -> Parser {
    Parser { name, accepts }
}

/// Writes the bytes where a reader of files will look for them.
pub(crate) fn placed<T>(
    scratch: &Path,
    name: &str,
    bytes: &[u8],
    read: impl FnOnce(&Path) -> T,
) -> T {
    let path = scratch.join(name);
    fs::write(&path, bytes).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    read(&path)
}

fn splat_ply(scratch: &Path, bytes: &[u8]) -> bool {
    placed(scratch, "a.ply", bytes, |path| read_splats(path).is_ok())
}

fn splat_spz(scratch: &Path, bytes: &[u8]) -> bool {
    placed(scratch, "a.spz", bytes, |path| read_splats(path).is_ok())
}

fn splat_raw(scratch: &Path, bytes: &[u8]) -> bool {
    placed(scratch, "a.splat", bytes, |path| read_splats(path).is_ok())
}

#[cfg(feature = "fourdgs")]
fn splat_4dgs(scratch: &Path, bytes: &[u8]) -> bool {
    placed(scratch, "a.4dgs", bytes, |path| {
        let clip = crate::four_dgs::Motions::read(path);
        clip.map(|clip| clip.rows_at(0.5)).is_ok()
    })
}

fn splat_glb(scratch: &Path, bytes: &[u8]) -> bool {
    placed(scratch, "a.glb", bytes, |path| read_splats(path).is_ok())
}

fn cameras_json(scratch: &Path, bytes: &[u8]) -> bool {
    placed(scratch, "cameras.json", bytes, |path| {
        crate::cameras::read_cameras(path).is_ok()
    })
}

/// The length of `scene.json` in four little-endian bytes, that file, then `scene.safetensors`.
fn scene(scratch: &Path, bytes: &[u8]) -> bool {
    let Some((length, rest)) = bytes.split_first_chunk() else {
        return false;
    };
    let length = u32::from_le_bytes(*length) as usize;
    let (json, tensors) = rest.split_at(length.min(rest.len()));
    placed(scratch, "scene.json", json, |_| {
        placed(scratch, "scene.safetensors", tensors, |_| {
            DynamicScene::load(scratch, &Device::flex()).is_ok()
        })
    })
}

fn checkpoint_state(scratch: &Path, bytes: &[u8]) -> bool {
    placed(scratch, "state.json", bytes, |_| {
        crate::train::checkpoint_config(scratch).is_ok_and(|config| config.validate().is_ok())
    })
}

fn config_toml(scratch: &Path, bytes: &[u8]) -> bool {
    placed(scratch, "config.toml", bytes, |path| {
        crate::train::read_config(path).is_ok()
    })
}
