//! Frames: how a view's image is made, held in memory or made on demand.
//!
//! A [`Recipe`] says where an image is and what is done to it on loading. Where all images of a
//! dataset fit the memory that they may take, they are made at once ([`Pixels::Ready`]); otherwise
//! a [`FrameStore`] makes them when they are asked for, and ahead of that in the order that the
//! trainer announces. What a frame looks like does not depend on which of the two holds it.

mod batch;
mod memory;
mod store;
#[cfg(test)]
mod tests;

use std::path::{Path, PathBuf};
use std::sync::Arc;

use dash_kernels::Camera;

use super::DatasetError;
use super::decode::{decode, decode_mask, turned};
use super::image::ImageData;
use super::plan::{Lens, without_distortion};
use super::video::{VideoIndex, decode_frames};

pub(super) use batch::{make_all, salvage};
pub(crate) use memory::{bytes_in_words, default_budget};
pub use store::FrameStatistics;
pub(super) use store::FrameStore;

/// Where a view's image is.
#[derive(Debug, Clone)]
pub(super) enum Source {
    /// In a file of its own.
    File(PathBuf),
    /// In a video, in the order of presentation.
    Video {
        video: Arc<VideoIndex>,
        frame: usize,
    },
}

impl Source {
    /// An error that says that this image could not be made.
    pub(super) fn is_missing(&self) -> DatasetError {
        match self {
            Self::File(path) => DatasetError::image(path, "it gave no picture"),
            Self::Video { video, frame } => video.is_missing(*frame),
        }
    }

    /// The file, for messages.
    pub(super) fn path(&self) -> &Path {
        match self {
            Self::File(path) => path,
            Self::Video { video, .. } => video.path(),
        }
    }
}

/// Which pixels of a view count, as a picture beside it says.
#[derive(Debug, Clone)]
pub(super) struct CountedMask {
    pub(super) path: PathBuf,
    /// Whether white marks what does not count.
    pub(super) inverted: bool,
}

/// How a view's image is made.
#[derive(Debug, Clone)]
pub(super) struct Recipe {
    pub(super) source: Source,
    /// The camera at the size that the decoded image must have.
    pub(super) camera: Camera,
    pub(super) lens: Option<Lens>,
    /// Width and height of the result.
    pub(super) size: (usize, usize),
    /// Whether the image has alpha.
    pub(super) has_alpha: bool,
    pub(super) counted: Option<CountedMask>,
}

impl Recipe {
    /// Memory that the result takes.
    pub(super) fn bytes(&self) -> u64 {
        let channels = 3 + u64::from(self.has_alpha) + u64::from(self.counted.is_some());
        self.size.0 as u64 * self.size.1 as u64 * channels
    }

    /// Memory that making it takes besides, at most: the file, the decoded image, lines of sums.
    pub(super) fn working_bytes(&self) -> u64 {
        let pixels = self.camera.width as u64 * self.camera.height as u64;
        pixels * 3 * (3 + u64::from(self.has_alpha))
    }

    /// The image, from its own file; a video's frames are made by [`make_group`].
    pub(super) fn make(&self) -> Result<ImageData, DatasetError> {
        match &self.source {
            Source::File(path) => self.finish(decode(path)?),
            Source::Video { video, frame } => {
                let mut made = None;
                decode_frames(video, *frame..*frame + 1, |_, image| {
                    made = Some(self.finish(image)?);
                    Ok(())
                })?;
                made.ok_or_else(|| video.is_missing(*frame))
            }
        }
    }

    /// Checks, undistorts and downscales a decoded image.
    pub(super) fn finish(&self, image: ImageData) -> Result<ImageData, DatasetError> {
        let full_size = (image.width, image.height);
        check_size(self.source.path(), &self.camera, full_size)?;
        let flat = |image| without_distortion(image, &self.camera, self.lens.as_ref());
        let (width, height) = self.size;
        let mut image = flat(image).resized(width, height);
        if let Some(mask) = &self.counted {
            let decoded = decode_mask(&mask.path, full_size)?;
            image.counted = Some(
                flat(decoded)
                    .resized(width, height)
                    .thresholded(mask.inverted),
            );
        }
        Ok(image)
    }
}

/// Refuses an image of another size than the camera's.
pub(super) fn check_size(
    path: &Path,
    camera: &Camera,
    (width, height): (usize, usize),
) -> Result<(), DatasetError> {
    let expected = (camera.width, camera.height);
    if expected == (width, height) {
        return Ok(());
    }
    let turned = if expected == (height, width) {
        turned(path)
    } else {
        String::new()
    };
    Err(DatasetError::invalid(
        path,
        format!("an image of {}x{} pixels", expected.0, expected.1),
        format!("{width}x{height}{turned}"),
        "use the images the poses were made for (--downscale makes them smaller on loading)",
    ))
}

/// The pixels of a view.
#[derive(Debug, Clone)]
pub(crate) enum Pixels {
    /// In memory.
    Ready(Arc<ImageData>),
    /// Made on demand.
    Stored {
        store: Arc<FrameStore>,
        index: usize,
    },
}

impl Pixels {
    /// The place in the store, where they are in one.
    pub(super) fn place(&self) -> Option<usize> {
        match self {
            Self::Ready(_) => None,
            Self::Stored { index, .. } => Some(*index),
        }
    }

    pub(super) fn get(&self) -> Result<Arc<ImageData>, DatasetError> {
        match self {
            Self::Ready(image) => Ok(image.clone()),
            Self::Stored { store, index } => store.get(*index),
        }
    }
}

/// Recipes whose images are decoded together: those of a group of pictures of a video, or one.
pub(super) fn groups(recipes: &[Recipe]) -> Vec<Vec<usize>> {
    let mut groups: Vec<Vec<usize>> = Vec::new();
    let mut open: Option<(*const VideoIndex, usize)> = None;
    for (index, recipe) in recipes.iter().enumerate() {
        let key = match &recipe.source {
            Source::File(_) => None,
            Source::Video { video, frame } => {
                Some((Arc::as_ptr(video), video.group_of(*frame).start))
            }
        };
        match groups.last_mut() {
            Some(group) if key.is_some() && key == open => group.push(index),
            _ => groups.push(vec![index]),
        }
        open = key;
    }
    groups
}

/// Makes the images of a group, one after the other as they are decoded.
pub(super) fn make_group(
    recipes: &[Recipe],
    group: &[usize],
    mut on_image: impl FnMut(usize, ImageData) -> Result<(), DatasetError>,
) -> Result<(), DatasetError> {
    let frames_of_video = |index: usize| match &recipes[index].source {
        Source::File(_) => None,
        Source::Video { video, frame } => Some((video, *frame)),
    };
    let Some((video, first)) = group.first().and_then(|&index| frames_of_video(index)) else {
        return group
            .iter()
            .try_for_each(|&index| on_image(index, recipes[index].make()?));
    };
    let wanted: Vec<(usize, usize)> = group
        .iter()
        .filter_map(|&index| Some((index, frames_of_video(index)?.1)))
        .collect();
    let end = wanted
        .iter()
        .map(|&(_, frame)| frame + 1)
        .max()
        .unwrap_or(first);
    decode_frames(video, first..end, |frame, image| {
        let mut wanting = wanted
            .iter()
            .filter(|(_, wanted)| *wanted == frame)
            .peekable();
        let mut image = Some(image);
        while let Some(&(index, _)) = wanting.next() {
            // The last takes the image itself: more than one is rare.
            let own = match wanting.peek() {
                Some(_) => image.clone(),
                None => image.take(),
            };
            on_image(
                index,
                recipes[index].finish(own.ok_or_else(|| video.is_missing(frame))?)?,
            )?;
        }
        Ok(())
    })
}
