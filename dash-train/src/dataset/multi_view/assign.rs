//! Which of the poses in a file is which camera's, by name.

use std::path::Path;

use super::camera::{Frames, RigCamera, Source};
use crate::Error;
use crate::dataset::poses::colmap::Model;
use crate::files::{self};

/// The indices of the names that mean a camera: its own name, with any folder and extension
/// (`left`, `left.png`, `videos/left.mp4`); or else an image in the camera's folder
/// (`left/0000.png`). Where cameras and frames are both numbers, `0.png` may be a frame of every camera:
/// then the one image in the folder counts.
pub(crate) fn find(source: &Source, names: &[String]) -> Vec<usize> {
    let camera = &*files::one_form(&source.name);
    // Files that Windows wrote have its separators.
    let names: Vec<String> = names
        .iter()
        .map(|name| files::one_form(name).replace('\\', "/"))
        .collect();
    let indices = |means: &dyn Fn(&Path) -> bool| -> Vec<usize> {
        let named = names.iter().enumerate();
        named
            .filter(|(_, name)| means(Path::new(name)))
            .map(|(index, _)| index)
            .collect()
    };
    let own = indices(&|path| {
        files::stem(path) == camera || path.file_name().is_some_and(|name| name == camera)
    });
    if own.len() == 1 {
        return own;
    }
    let in_folder = indices(&|path| {
        let folder = path.parent().and_then(Path::file_name);
        folder.is_some_and(|folder| folder == camera)
    });
    // Folders of one image each may be any other layout's.
    let several_frames = matches!(&source.frames, Frames::Images(images) if images.len() > 1);
    if own.is_empty() || (in_folder.len() == 1 && several_frames) {
        in_folder
    } else {
        own
    }
}

/// For each camera the index of its pose among `names`, which `listed_in` holds.
pub(crate) fn assign(
    sources: &[Source],
    names: &[String],
    listed_in: &Path,
) -> Result<Vec<usize>, Error> {
    let mut assigned = Vec::with_capacity(sources.len());
    let mut missing = Vec::new();
    for source in sources {
        match find(source, names).as_slice() {
            [] => missing.push(source.name.as_str()),
            [index] => assigned.push(*index),
            [first, second, ..] => {
                return Err(Error::invalid(
                    listed_in,
                    format!("one pose for camera {}", source.name),
                    format!("`{}` and `{}`", names[*first], names[*second]),
                    "keep one image per camera, called as the camera is",
                ));
            }
        }
    }
    if !missing.is_empty() {
        let shown: Vec<&str> = names.iter().take(32).map(String::as_str).collect();
        let more = if names.len() > 32 { ", .." } else { "" };
        return Err(Error::invalid(
            listed_in,
            format!("a pose for every camera, {} among them", missing.join(", ")),
            format!("poses of {}{more}", shown.join(", ")),
            "add these poses, rename the images as the cameras are, or remove these cameras",
        ));
    }
    for (index, name) in names.iter().enumerate() {
        if !assigned.contains(&index) {
            tracing::warn!("{}: no camera is called as `{name}`", listed_in.display());
        }
    }
    Ok(assigned)
}

/// Cameras with the poses of a COLMAP model.
pub(crate) fn pose_by_model(sources: Vec<Source>, model: Model) -> Result<Vec<RigCamera>, Error> {
    let names: Vec<String> = model
        .images
        .iter()
        .map(|image| image.name.clone())
        .collect();
    let assigned = assign(&sources, &names, &model.images_file)?;
    let posed = sources.into_iter().zip(assigned).map(|(source, index)| {
        let image = &model.images[index];
        RigCamera {
            source,
            camera: image.camera.clone(),
            distortion: image.distortion,
            posed_by: model.cameras_file.clone(),
        }
    });
    Ok(posed.collect())
}
