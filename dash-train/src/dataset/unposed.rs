//! Warnings: images without a pose, and several frames per camera in a folder that is read as static.

use std::collections::HashSet;
use std::path::{Path, PathBuf};

use super::loader::Loader;
use super::multi_view::camera::Frames;
use super::multi_view::folders::{IMAGE_FOLDER, image_folders};
use crate::files;

/// Warns if `images/` has more images than the `posed` ones.
pub(crate) fn warn_of_more(
    loader: &Loader,
    listed_in: &Path,
    posed: &HashSet<PathBuf>,
    is_static: bool,
) {
    let folder = loader.root.join(IMAGE_FOLDER);
    if is_static
        && loader.options.layout.is_none()
        && let Some(n_frames) = frames_per_camera(loader.root)
    {
        tracing::warn!(
            "{}: {n_frames} frames per camera; read as static; keep one pose per camera in {}, or use \
             --layout rig",
            folder.display(),
            listed_in.display()
        );
    }
    let (without, first) = without_pose(&folder, posed);
    if let Some(first) = first {
        tracing::warn!(
            "{}: no pose for {without} of {} images, such as {}: they are not used",
            listed_in.display(),
            without + posed.len(),
            first.display()
        );
    }
}

/// The number of frames per camera, if `images/` has several cameras' folders with the same frame numbers.
fn frames_per_camera(root: &Path) -> Option<usize> {
    let cameras = image_folders(root).ok()?;
    let numbers = |frames: &Frames| -> Option<Vec<u64>> {
        match frames {
            Frames::Images(images) => images.iter().map(|image| image.number()).collect(),
            Frames::Video => None,
        }
    };
    let mut cameras = cameras.iter().map(|camera| numbers(&camera.frames));
    let first = cameras.next()??;
    let others: Vec<_> = cameras.collect();
    let several = first.len() > 1 && !others.is_empty();
    (several && others.iter().all(|other| other.as_ref() == Some(&first))).then_some(first.len())
}

/// The number of images without a pose in the folders of the `posed` ones below `folder`, and the first of them.
fn without_pose(folder: &Path, posed: &HashSet<PathBuf>) -> (usize, Option<PathBuf>) {
    let mut folders: Vec<&Path> = posed.iter().filter_map(|path| path.parent()).collect();
    folders.retain(|parent| parent.starts_with(folder));
    folders.sort_unstable();
    folders.dedup();
    let listed = folders
        .into_iter()
        .filter_map(|f| files::list_images(f).ok());
    let mut without = listed.flatten().filter(|image| !posed.contains(image));
    let first = without.next();
    (usize::from(first.is_some()) + without.count(), first)
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    #[test]
    fn frames_per_camera_and_images_without_a_pose_are_counted() {
        let root = tempfile::tempdir().expect("temporary folder");
        let folder = root.path().join(IMAGE_FOLDER);
        let write = |name: &str| {
            let path = folder.join(name);
            fs::create_dir_all(path.parent().expect("a folder")).expect("folders");
            fs::write(&path, "").expect("writes");
            path
        };
        let first = write("left/0.png");
        write("left/1.png");
        write("right/0.png");
        assert_eq!(frames_per_camera(root.path()), None);
        let last = write("right/1.png");
        assert_eq!(frames_per_camera(root.path()), Some(2));
        // Folders without any posed image may hold anything.
        write("depth/0.png");
        assert_eq!(frames_per_camera(root.path()), None);
        let second = folder.join("left/1.png");
        let counted = |folder: &Path, posed: [&PathBuf; 2]| {
            without_pose(folder, &posed.map(PathBuf::clone).into())
        };
        let found = counted(&folder, [&first, &last]);
        assert_eq!(found, (2, Some(second.clone())));
        assert_eq!(counted(&folder, [&first, &second]), (0, None));
        // Only what lies in `images/` is counted.
        let found = counted(&folder.join("right"), [&first, &first]);
        assert_eq!(found, (0, None));
    }
}
