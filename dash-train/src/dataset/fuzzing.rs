//! Doors to the datasets' parsers; see [`crate::fuzzing`].

use std::path::Path;

use super::pixels::decode as images;
use super::pixels::lens::Lens;
use super::poses::colmap::{ModelCamera, ModelImage};
use super::poses::colmap::{binary, pinhole, place, text};
use super::poses::nerfies::CameraFile;
use super::poses::{
    npy as arrays, npz as archives, panoptic as panoptic_files,
    technicolor as technicolor_parameters, transforms as transforms_files,
};
use crate::Error;
use crate::files::{self, parse_json};
use crate::fuzzing::placed;

/// `poses_bounds.npy`.
pub fn npy(_: &Path, bytes: &[u8]) -> bool {
    arrays::parse_poses(Path::new("poses_bounds.npy"), bytes).is_ok()
}

/// `points.npy` of Nerfies captures.
pub fn points_npy(_: &Path, bytes: &[u8]) -> bool {
    arrays::parse_points(Path::new("points.npy"), bytes).is_ok()
}

/// `init_pt_cld.npz` of captures for Dynamic 3D Gaussians.
pub fn cloud_npz(_: &Path, bytes: &[u8]) -> bool {
    let path = Path::new("init_pt_cld.npz");
    let array = archives::array(path, bytes, "data");
    array.is_ok_and(|array| arrays::parse_cloud(path, &array).is_ok())
}

/// `train_meta.json` of captures for Dynamic 3D Gaussians: its cameras and file names.
pub fn panoptic_meta(_: &Path, bytes: &[u8]) -> bool {
    let path = Path::new("train_meta.json");
    panoptic_files::parse(path, bytes).is_ok_and(|pictures| {
        let mut names = pictures.iter().map(|picture| &picture.name);
        names.all(|name| confined(name, path).is_ok())
    })
}

/// `cameras_parameters.txt` and its cameras.
pub fn technicolor(_: &Path, bytes: &[u8]) -> bool {
    let path = Path::new("cameras_parameters.txt");
    let parsed = std::str::from_utf8(bytes).map(|text| technicolor_parameters::parse(path, text));
    parsed.is_ok_and(|rows| {
        rows.is_ok_and(|rows| rows.iter().all(|row| row.camera(path, (64, 48)).is_ok()))
    })
}

/// A camera of a Nerfies capture, and its lens.
pub fn nerfies_camera(_: &Path, bytes: &[u8]) -> bool {
    let path = Path::new("camera/000001.json");
    parse_json::<CameraFile>(bytes).is_ok_and(|file| {
        file.camera(path, |position| position)
            .and_then(|(camera, distortion)| Lens::new(distortion, &camera, path))
            .is_ok()
    })
}

/// `transforms.json`, its cameras, lenses and file names.
pub fn transforms(scratch: &Path, bytes: &[u8]) -> bool {
    placed(scratch, "transforms.json", bytes, |path| {
        let Ok(transforms) = transforms_files::parse(path) else {
            return false;
        };
        transforms.warn_of_keys(path);
        transforms.frames.iter().all(|frame| {
            transforms
                .camera(path, frame, || Ok((64, 48)))
                .and_then(|(camera, distortion)| Lens::new(distortion, &camera, path))
                .and_then(|_| confined(&frame.file_path, path))
                .is_ok()
        })
    })
}

/// Names of frames, a line each: whether their order is that of plain numbers.
pub fn frame_names(_: &Path, bytes: &[u8]) -> bool {
    let text = String::from_utf8_lossy(bytes);
    let mut names: Vec<&str> = text.lines().collect();
    names.sort_by(|a, b| files::natural_cmp(a, b));
    files::order(&names) == files::Order::Plain
}

fn confined(name: &str, listed_in: &Path) -> Result<(), Error> {
    let root = Path::new("dataset");
    let inside = files::confined(root, name, listed_in)?;
    assert!(
        inside.starts_with(root) && !inside.components().any(|part| part.as_os_str() == ".."),
        "{name:?} leaves the folder as {}",
        inside.display()
    );
    Ok(())
}

fn cameras(parsed: Result<Vec<ModelCamera>, Error>) -> bool {
    let path = Path::new("cameras");
    parsed.is_ok_and(|cameras| {
        cameras.iter().all(|camera| {
            pinhole(camera, path)
                .and_then(|(camera, distortion)| Lens::new(distortion, &camera, path))
                .is_ok()
        })
    })
}

fn model_images(parsed: Result<Vec<ModelImage>, Error>) -> bool {
    let intrinsics = dash_kernels::Camera::new(1.0, 1.0, 0.5, 0.5, 1, 1);
    parsed.is_ok_and(|images| {
        images.iter().all(|image| {
            place(&intrinsics, image).is_ok() && confined(&image.name, Path::new("images")).is_ok()
        })
    })
}

/// `cameras.bin` and its lenses.
pub fn colmap_cameras_binary(_: &Path, bytes: &[u8]) -> bool {
    cameras(binary::cameras(Path::new("cameras.bin"), bytes))
}

/// `images.bin`, its poses and file names.
pub fn colmap_images_binary(_: &Path, bytes: &[u8]) -> bool {
    model_images(binary::images(Path::new("images.bin"), bytes))
}

/// `points3D.bin`.
pub fn colmap_points_binary(_: &Path, bytes: &[u8]) -> bool {
    binary::points(Path::new("points3D.bin"), bytes).is_ok()
}

/// `cameras.txt` and its lenses.
pub fn colmap_cameras_text(_: &Path, bytes: &[u8]) -> bool {
    std::str::from_utf8(bytes)
        .is_ok_and(|text| cameras(text::cameras(Path::new("cameras.txt"), text)))
}

/// `images.txt`, its poses and file names.
pub fn colmap_images_text(_: &Path, bytes: &[u8]) -> bool {
    std::str::from_utf8(bytes)
        .is_ok_and(|text| model_images(text::images(Path::new("images.txt"), text)))
}

/// `points3D.txt`.
pub fn colmap_points_text(_: &Path, bytes: &[u8]) -> bool {
    std::str::from_utf8(bytes)
        .is_ok_and(|text| text::points(Path::new("points3D.txt"), text).is_ok())
}

/// A point cloud's PLY.
pub fn points_ply(_: &Path, bytes: &[u8]) -> bool {
    crate::ply::parse(Path::new("points.ply"), bytes.to_vec()).is_ok()
}

/// An image's size. The name's ending is no help: what the file holds decides.
pub fn image_header(scratch: &Path, bytes: &[u8]) -> bool {
    placed(scratch, "header.png", bytes, |path| {
        images::dimensions(path).is_ok()
    })
}

/// A whole image.
pub fn image(scratch: &Path, bytes: &[u8]) -> bool {
    placed(scratch, "image.png", bytes, |path| {
        images::decode(path).is_ok()
    })
}
