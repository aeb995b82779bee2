//! Folders of frames, one for each camera.

use std::path::Path;

use super::camera::{FrameFile, Frames, Source};
use crate::Error;
use crate::files::{self};

/// Folder of the cameras' folders.
pub(crate) const IMAGE_FOLDER: &str = "images";

/// The folders with images below `images/`, in natural order; none where there is no such folder.
pub(crate) fn image_folders(root: &Path) -> Result<Vec<Source>, Error> {
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
