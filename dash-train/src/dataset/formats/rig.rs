//! A rig of the user's own: a video or a folder of frames per camera, and poses by the cameras'
//! names from COLMAP or `transforms.json`.

use std::path::{Path, PathBuf};

use crate::Error;
use crate::dataset::format::{Capture, Folder, Format, Reader};
use crate::dataset::layout::Layout;
use crate::dataset::loader::Loader;
use crate::dataset::multi_view;
use crate::dataset::multi_view::assign::{assign, find, pose_by_model};
use crate::dataset::multi_view::camera::{Frames, RigCamera, Source};
use crate::dataset::multi_view::folders::{IMAGE_FOLDER, image_folders};
use crate::dataset::pixels::masks::MASK_FOLDER;
use crate::dataset::points::{Models, find_points, points_of_transforms};
use crate::dataset::poses::colmap::{
    Model, RIG_MODEL_FOLDERS, model_folder, read_model, read_model_points, warn_of_larger,
};
use crate::dataset::poses::transforms::{self, Frame, Transforms};
use crate::files::{self, VIDEO_EXTENSIONS};
use crate::video::frame_size as video_size;

const VIDEO_FOLDER: &str = "videos";
const TRANSFORMS_FILE: &str = "transforms.json";

/// A rig of the user's own.
pub(super) struct Rig;

/// A rig's cameras and the file with their poses.
struct RigReader {
    sources: Vec<Source>,
    /// What is said of a video that is not used.
    unused: Option<String>,
    poses: Poses,
}

enum Poses {
    Transforms(PathBuf, Box<Transforms>),
    /// The model and its folder.
    Model(PathBuf, Model),
}

impl Format for Rig {
    fn layout(&self) -> Layout {
        Layout::Rig
    }

    fn recognise(&self, folder: &Folder) -> Result<Option<Box<dyn Reader>>, Error> {
        // A damaged file of poses may be another format's.
        let reader = RigReader::of(folder.root()).ok();
        let reader = reader.filter(RigReader::is_of_cameras);
        Ok(reader.map(|reader| Box::new(reader) as Box<dyn Reader>))
    }

    fn open(&self, folder: &Folder) -> Result<Box<dyn Reader>, Error> {
        Ok(Box::new(RigReader::of(folder.root())?))
    }
}

impl RigReader {
    fn of(root: &Path) -> Result<Self, Error> {
        let (sources, unused) = cameras(root)?;
        let file = root.join(TRANSFORMS_FILE);
        let poses = if file.is_file() {
            let transforms = transforms::parse(&file)?;
            Poses::Transforms(file, Box::new(transforms))
        } else if let Some(sparse) = model_folder(root, &RIG_MODEL_FOLDERS) {
            let model = read_model(&sparse)?;
            Poses::Model(sparse, model)
        } else {
            return Err(Error::invalid(
                root,
                format!("{TRANSFORMS_FILE} or a COLMAP model (sparse/0/cameras.bin, ..)"),
                "neither",
                "run COLMAP on one image per camera, called as the camera is",
            ));
        };
        Ok(Self {
            sources,
            unused,
            poses,
        })
    }

    /// Whether the poses are those of the cameras and not those of single images, which may have times.
    fn is_of_cameras(&self) -> bool {
        if let Poses::Transforms(_, transforms) = &self.poses
            && transforms.has_times()
        {
            return false;
        }
        let names: Vec<String> = match &self.poses {
            Poses::Transforms(_, transforms) => {
                let frames = transforms.frames.iter();
                frames.map(|frame| frame.file_path.clone()).collect()
            }
            Poses::Model(_, model) => {
                let images = model.images.iter();
                images.map(|image| image.name.clone()).collect()
            }
        };
        // A mistake in them is then told as one of a rig.
        let is_video = |name: &String| files::has_extension(name, &VIDEO_EXTENSIONS);
        if names.iter().any(is_video) {
            return true;
        }
        let matches: Vec<usize> = self
            .sources
            .iter()
            .map(|source| find(source, &names).len())
            .collect();
        matches.contains(&1) && matches.iter().all(|&n| n <= 1)
    }
}

impl Reader for RigReader {
    fn read(self: Box<Self>, loader: &Loader) -> Result<Capture, Error> {
        let root = loader.root;
        if let Some(told) = self.unused {
            tracing::warn!("{}: {told}", root.display());
        }
        let (cameras, points) = match self.poses {
            Poses::Transforms(file, transforms) => {
                let cameras = pose_by_transforms(loader, self.sources, &file, &transforms)?;
                // Tools that write this file may turn or scale COLMAP's world.
                (cameras, points_of_transforms(root, &file, &transforms)?)
            }
            Poses::Model(sparse, model) => {
                warn_of_larger(&sparse, &model);
                let cameras = pose_by_model(self.sources, model)?;
                let points = match find_points(root, None, Models::Rig)? {
                    Some(points) => Some(points),
                    None => read_model_points(&sparse)?,
                };
                (cameras, points)
            }
        };
        let n_cameras = cameras.len();
        let suggested = (0..n_cameras).map(|index| index == 0).collect();
        let held_out = loader.options.held_out(suggested)?;
        multi_view::load(loader, &cameras, &held_out, points)
    }
}

/// The folders of frames, else the videos, in natural order, and what is said of a video that has no folder among them. Beside
/// videos, folders of one picture each are what the cameras were posed by.
fn cameras(root: &Path) -> Result<(Vec<Source>, Option<String>), Error> {
    let folders = image_folders(root)?;
    let videos = videos(root)?;
    if videos.is_empty() && folders.is_empty() {
        return Err(Error::invalid(
            root,
            "a video per camera (videos/left.mp4, ..) or a folder of frames (images/left/0000.png, ..)",
            format!("none of these{}", unread_images(root)),
            "put them there, or choose another layout with --layout",
        ));
    }
    let is_one =
        |source: &Source| matches!(&source.frames, Frames::Images(images) if images.len() == 1);
    if videos.is_empty() || !folders.iter().all(is_one) {
        let has_frames = |video: &&Source| folders.iter().any(|folder| folder.name == video.name);
        let unused = videos.iter().find(|video| !has_frames(video)).map(|video| {
            format!(
                "{IMAGE_FOLDER} has no folder of frames for {VIDEO_FOLDER}/{}: this camera is not used; extract its frames, \
                 or remove the folders of frames",
                video.name
            )
        });
        return Ok((folders, unused));
    }
    if let Some(pair) = videos.windows(2).find(|pair| pair[0].name == pair[1].name) {
        return Err(Error::invalid(
            &root.join(VIDEO_FOLDER),
            "one video per camera",
            format!("two called {}", pair[0].name),
            "remove or rename one of them",
        ));
    }
    Ok((videos, None))
}

/// The videos, in natural order.
fn videos(root: &Path) -> Result<Vec<Source>, Error> {
    let folder = root.join(VIDEO_FOLDER);
    let names = if folder.is_dir() {
        files::list(&folder)?
    } else {
        Vec::new()
    };
    let names = names.iter();
    let videos = names.filter(|name| files::has_extension(name, &VIDEO_EXTENSIONS));
    let videos = videos.map(|name| Source {
        name: files::stem(Path::new(name)),
        path: folder.join(name),
        frames: Frames::Video,
    });
    Ok(videos.collect())
}

/// A note for errors about missing images: the first camera folder has images of formats that are not read.
fn unread_images(root: &Path) -> String {
    let folder = root.join(IMAGE_FOLDER);
    let names = files::list(&folder).unwrap_or_default();
    let mut paths = names.iter().map(|name| folder.join(name));
    let first = paths.find(|path| path.is_dir());
    first.map_or_else(String::new, |path| files::unread_images(&path))
}

fn pose_by_transforms(
    loader: &Loader,
    sources: Vec<Source>,
    file: &Path,
    transforms: &Transforms,
) -> Result<Vec<RigCamera>, Error> {
    let frames = &transforms.frames;
    let names: Vec<String> = frames.iter().map(|frame| frame.file_path.clone()).collect();
    let assigned = assign(&sources, &names, file)?;
    transforms.warn_of_keys(file);
    if let Some(told) = unused_masks(transforms) {
        tracing::warn!("{}: {told}", file.display());
    }
    let mut cameras = Vec::with_capacity(sources.len());
    for (source, index) in sources.into_iter().zip(assigned) {
        let size = || match frame_size(loader, &source) {
            // The camera is left out later, so any size will do.
            Err(Error::VideoDecode { .. }) if loader.options.skip_broken => {
                Ok(transforms.size_by_middle(&frames[index]).unwrap_or((1, 1)))
            }
            size => size,
        };
        let (camera, distortion) = transforms.camera(file, &frames[index], size)?;
        if !distortion.is_finite() {
            return Err(Error::invalid(
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

/// A warning for poses of cameras that name masks: a mask belongs to one image.
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
fn frame_size(loader: &Loader, source: &Source) -> Result<(usize, usize), Error> {
    let size = match &source.frames {
        Frames::Images(images) => {
            let files = images.iter().map(|image| image.file.as_path());
            loader.broken.first_size(files).transpose()?
        }
        Frames::Video => Some(video_size(&source.path, loader.options.skip_broken)?),
    };
    size.ok_or_else(|| Error::invalid(&source.path, "at least one frame", "none", "add frames"))
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
