//! A rig of the user's own: a video or a folder of frames per camera, and poses by the cameras'
//! names from COLMAP or `transforms.json`.

use std::path::Path;

use super::broken::first_size;
use super::colmap_model::{Model, model_folder, read_model, warn_of_larger};
use super::masks::MASK_FOLDER;
use super::plan::Context;
use super::points::{Models, find_named_points};
use super::sources::{self, FrameFile, Frames, RigCamera, Source, VIDEO_EXTENSIONS};
use super::transforms::{self, Frame, Transforms};
use super::{DatasetError, Parts, files, video};

const VIDEO_FOLDER: &str = "videos";
const IMAGE_FOLDER: &str = "images";
const TRANSFORMS_FILE: &str = "transforms.json";
const MODEL_FOLDERS: [&str; 5] = [
    "sparse/0",
    "sparse",
    "colmap/sparse/0",
    "colmap/sparse",
    "colmap/dense/workspace/sparse",
];

/// Whether the folder has cameras with frames, and a file with poses that are theirs and not those
/// of single images.
pub(super) fn is_rig(root: &Path) -> bool {
    let Ok(cameras) = cameras(root) else {
        return false;
    };
    let transforms = root.join(TRANSFORMS_FILE);
    let names: Option<Vec<String>> = if transforms.is_file() {
        let frames = transforms::parse(&transforms).map(|transforms| transforms.frames);
        frames
            .ok()
            .map(|frames| frames.into_iter().map(|frame| frame.file_path).collect())
    } else {
        let model = model_folder(root, &MODEL_FOLDERS).map(|model| read_model(&model));
        let images = model.and_then(Result::ok).map(|model| model.images);
        images.map(|images| images.into_iter().map(|image| image.name).collect())
    };
    let Some(names) = names else { return false };
    let matches: Vec<usize> = cameras
        .iter()
        .map(|camera| find(camera, &names).len())
        .collect();
    matches.contains(&1) && matches.iter().all(|&n| n <= 1)
}

pub(super) fn read(context: &Context) -> Result<Parts, DatasetError> {
    let root = context.root;
    let sources = cameras(root)?;
    let file = root.join(TRANSFORMS_FILE);
    let mut point_file = None;
    let mut models = Models::Rig;
    let cameras = if file.is_file() {
        // Tools that write this file may turn or scale COLMAP's world.
        models = Models::Own;
        let transforms = transforms::parse(&file)?;
        point_file = transforms.ply_file_path.clone();
        pose_by_transforms(context, sources, &file, &transforms)?
    } else if let Some(sparse) = model_folder(root, &MODEL_FOLDERS) {
        let model = read_model(&sparse)?;
        warn_of_larger(&sparse, &model);
        pose_by_model(sources, model)?
    } else {
        return Err(DatasetError::invalid(
            root,
            format!("{TRANSFORMS_FILE} or a COLMAP model (sparse/0/cameras.bin, ..)"),
            "neither",
            "run COLMAP on one image per camera, called as the camera is",
        ));
    };
    let n_cameras = cameras.len();
    let held_out = context
        .options
        .held_out((0..n_cameras).map(|index| index == 0).collect())?;
    let points = find_named_points(root, (point_file.as_deref(), &file), models)?;
    let (views, n_frames) = sources::load(context, &cameras, &held_out)?;
    Ok(Parts {
        views,
        points,
        n_frames,
        n_cameras,
        stated_span: None,
    })
}

/// The folders of frames, else the videos, in natural order.
fn cameras(root: &Path) -> Result<Vec<Source>, DatasetError> {
    let folders = image_folders(root)?;
    if !folders.is_empty() {
        return Ok(folders);
    }
    let folder = root.join(VIDEO_FOLDER);
    let names = if folder.is_dir() {
        files::list(&folder)?
    } else {
        Vec::new()
    };
    let videos: Vec<Source> = names
        .iter()
        .filter(|name| files::has_extension(name, &VIDEO_EXTENSIONS))
        .map(|name| Source {
            name: files::stem(Path::new(name)),
            path: folder.join(name),
            frames: Frames::Video,
        })
        .collect();
    if videos.is_empty() {
        return Err(DatasetError::invalid(
            root,
            "a video per camera (videos/left.mp4, ..) or a folder of frames (images/left/0000.png, ..)",
            format!("none of these{}", unread_images(root)),
            "put them there, or choose another layout with --layout",
        ));
    }
    if let Some(pair) = videos.windows(2).find(|pair| pair[0].name == pair[1].name) {
        return Err(DatasetError::invalid(
            &folder,
            "one video per camera",
            format!("two called {}", pair[0].name),
            "remove or rename one of them",
        ));
    }
    Ok(videos)
}

/// The folders with images below `images/`, in natural order; none where there is no such folder.
pub(super) fn image_folders(root: &Path) -> Result<Vec<Source>, DatasetError> {
    let folder = root.join(IMAGE_FOLDER);
    let mut sources = Vec::new();
    if !folder.is_dir() {
        return Ok(sources);
    }
    for name in files::list(&folder)? {
        let path = folder.join(&name);
        if !path.is_dir() {
            continue;
        }
        let images = files::list_images(&path)?;
        if !images.is_empty() {
            sources.push(Source {
                name,
                path,
                frames: Frames::Images(FrameFile::by_stems(images)),
            });
        }
    }
    Ok(sources)
}

/// What to add to an error about missing images: those of other formats in the first folder below `images/`.
fn unread_images(root: &Path) -> String {
    let folder = root.join(IMAGE_FOLDER);
    let names = files::list(&folder).unwrap_or_default();
    let mut paths = names.iter().map(|name| folder.join(name));
    let first = paths.find(|path| path.is_dir());
    first.map_or_else(String::new, |path| files::unread_images(&path))
}

/// The indices of the names that mean a camera: its own name, with any folder and extension
/// (`left`, `left.png`, `videos/left.mp4`); or else an image in the camera's folder
/// (`left/0000.png`). Where cameras and frames are both numbers, `0.png` may be a frame of every camera:
/// then the one image in the folder counts.
fn find(source: &Source, names: &[String]) -> Vec<usize> {
    let camera = source.name.as_str();
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
fn assign(
    sources: &[Source],
    names: &[String],
    listed_in: &Path,
) -> Result<Vec<usize>, DatasetError> {
    let mut assigned = Vec::with_capacity(sources.len());
    let mut missing = Vec::new();
    for source in sources {
        match find(source, names).as_slice() {
            [] => missing.push(source.name.as_str()),
            [index] => assigned.push(*index),
            [first, second, ..] => {
                return Err(DatasetError::invalid(
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
        return Err(DatasetError::invalid(
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
pub(super) fn pose_by_model(
    sources: Vec<Source>,
    model: Model,
) -> Result<Vec<RigCamera>, DatasetError> {
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

fn pose_by_transforms(
    context: &Context,
    sources: Vec<Source>,
    file: &Path,
    transforms: &Transforms,
) -> Result<Vec<RigCamera>, DatasetError> {
    let frames = &transforms.frames;
    let names: Vec<String> = frames.iter().map(|frame| frame.file_path.clone()).collect();
    let assigned = assign(&sources, &names, file)?;
    if let Some(told) = unused_masks(transforms) {
        tracing::warn!("{}: {told}", file.display());
    }
    let mut cameras = Vec::with_capacity(sources.len());
    for (source, index) in sources.into_iter().zip(assigned) {
        let size = || match frame_size(context, &source) {
            // Left out later on: any size will do.
            Err(DatasetError::Video { .. }) if context.options.skip_broken => {
                Ok(transforms.size_by_middle(&frames[index]).unwrap_or((1, 1)))
            }
            size => size,
        };
        let (camera, distortion) = transforms.camera(file, &frames[index], size)?;
        if !distortion.is_finite() {
            return Err(DatasetError::invalid(
                file,
                "finite distortion coefficients",
                format!("NaN or infinity in frame `{}`", names[index]),
                "mend that frame's entry",
            ));
        }
        cameras.push(RigCamera {
            source,
            camera,
            distortion,
            posed_by: file.to_path_buf(),
        });
    }
    Ok(cameras)
}

/// What there is to say where poses of cameras name masks, which are of one picture each.
fn unused_masks(transforms: &Transforms) -> Option<String> {
    let masks = transforms.frames.iter().filter_map(Frame::mask_path);
    let n = masks.count();
    (n > 0).then(|| {
        format!(
            "{n} masks named by mask_path are not used, since these poses are of cameras and not of single \
             pictures; {MASK_FOLDER}/CAMERA/FRAME.png is looked for"
        )
    })
}

/// The size of a camera's frames: of an image by its header, of a video by its first frame.
fn frame_size(context: &Context, source: &Source) -> Result<(usize, usize), DatasetError> {
    let size = match &source.frames {
        Frames::Images(images) => {
            let files = images.iter().map(|image| image.file.as_path());
            first_size(context, files).transpose()?
        }
        Frames::Video => Some(video::frame_size(
            &source.path,
            context.options.skip_broken,
        )?),
    };
    size.ok_or_else(|| {
        DatasetError::invalid(&source.path, "at least one frame", "none", "add frames")
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn masks_that_poses_of_cameras_name_are_told() {
        let told = |masks: [&str; 2]| {
            let frames = masks.map(|mask| {
                format!(r#"{{"file_path": "left.png", "transform_matrix": []{mask}}}"#)
            });
            let text = format!(r#"{{"frames": [{}]}}"#, frames.join(","));
            unused_masks(&serde_json::from_str(&text).expect("parses"))
        };
        assert_eq!(told(["", ""]), None);
        let said = told(["", r#", "mask_path": "masks/left.png""#]).expect("one names a mask");
        assert!(
            said.starts_with("1 masks named by mask_path are not used"),
            "{said}"
        );
        assert!(said.contains("masks/CAMERA/FRAME.png"), "{said}");
    }
}
