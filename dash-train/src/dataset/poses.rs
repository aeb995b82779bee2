//! The cameras of a folder without its pictures, for folders whose pictures can't be loaded.

use std::fs;
use std::path::Path;

use dash_kernels::Camera;

use super::colmap_model::{MODEL_FOLDERS, model_folder, read_model};
use super::decode::dimensions;
use super::image_files::find_image;
use super::{DatasetError, Layout, blender, n3dv, transforms};

/// Taken where neither the poses nor a picture say how large pictures are.
const UNKNOWN_SIZE: (usize, usize) = (800, 800);

/// The cameras that the poses of a folder name, in their order; `None` for layouts whose poses can't be
/// read apart.
///
/// # Errors
/// As [`load`](super::load), for files of poses only.
pub(crate) fn poses_alone(
    root: &Path,
    layout: Layout,
) -> Result<Option<Vec<Camera>>, DatasetError> {
    if layout == Layout::N3dv {
        of_rows(&root.join(n3dv::POSES_FILE)).map(Some)
    } else if layout == Layout::Blender {
        of_transforms(root).map(Some)
    } else if layout == Layout::Colmap {
        of_model(root)
    } else {
        Ok(None)
    }
}

fn of_rows(path: &Path) -> Result<Vec<Camera>, DatasetError> {
    let bytes = fs::read(path).map_err(DatasetError::io(path))?;
    let rows = super::npy::parse_poses(path, &bytes)?;
    let cameras = rows.iter().enumerate();
    cameras
        .map(|(index, row)| n3dv::camera(path, index, row))
        .collect()
}

fn of_transforms(root: &Path) -> Result<Vec<Camera>, DatasetError> {
    let mut cameras = Vec::new();
    for name in blender::FILES {
        let path = root.join(name);
        if !path.is_file() {
            continue;
        }
        let listed = transforms::parse(&path)?;
        for frame in &listed.frames {
            let file = super::files::confined(root, &frame.file_path, &path)?;
            let size = || {
                let found = find_image(file, &path).and_then(|file| dimensions(&file));
                let by_middle = || listed.size_by_middle(frame).unwrap_or(UNKNOWN_SIZE);
                Ok(found.unwrap_or_else(|_| by_middle()))
            };
            cameras.push(listed.camera(&path, frame, size)?.0);
        }
        break;
    }
    Ok(cameras)
}

fn of_model(root: &Path) -> Result<Option<Vec<Camera>>, DatasetError> {
    let Some(model) = model_folder(root, &MODEL_FOLDERS) else {
        return Ok(None);
    };
    let images = read_model(&model)?.images;
    Ok(Some(images.into_iter().map(|image| image.camera).collect()))
}
