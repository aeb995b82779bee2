//! How a view's image is made: where it is, and what is done to it on loading.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use dash_kernels::Camera;

use crate::Error;
use crate::dataset::pixels::decode::{decode, turned};
use crate::dataset::pixels::decode_mask;
use crate::dataset::pixels::image::ImageData;
use crate::dataset::pixels::lens::{Lens, without_distortion};
use crate::dataset::pixels::masks::CountedMask;
use crate::video::VideoIndex;

/// Whether a transparent picture among opaque ones was told.
static TOLD: AtomicBool = AtomicBool::new(false);

/// Where a view's image is.
#[derive(Debug, Clone)]
pub(crate) enum Source {
    /// In a file of its own.
    File(PathBuf),
    /// In a video, in the order of presentation.
    Video {
        video: Arc<VideoIndex>,
        frame: usize,
    },
}

impl Source {
    /// The error for an image that was not decoded.
    pub(crate) fn is_missing(&self) -> Error {
        match self {
            Self::File(path) => Error::image_decode(path, "it gave no picture"),
            Self::Video { video, frame } => video.is_missing(*frame),
        }
    }

    /// The file, for messages.
    pub(crate) fn path(&self) -> &Path {
        match self {
            Self::File(path) => path,
            Self::Video { video, .. } => video.path(),
        }
    }
}

/// How a view's image is made.
#[derive(Debug, Clone)]
pub(crate) struct Recipe {
    pub(crate) source: Source,
    /// The camera at the size that the decoded image must have.
    pub(crate) camera: Camera,
    pub(crate) lens: Option<Lens>,
    /// Width and height of the result.
    pub(crate) size: (usize, usize),
    /// Whether the image has alpha, and may be transparent.
    pub(crate) has_alpha: bool,
    pub(crate) counted: Option<CountedMask>,
}

impl Recipe {
    /// Memory of the result, bytes.
    pub(crate) fn bytes(&self) -> u64 {
        let channels = 3 + u64::from(self.has_alpha) + u64::from(self.counted.is_some());
        self.size.0 as u64 * self.size.1 as u64 * channels
    }

    /// Most working memory, bytes: the file, the decoded image, lines of sums.
    pub(crate) fn working_bytes(&self) -> u64 {
        let pixels = self.camera.width as u64 * self.camera.height as u64;
        pixels * 3 * (3 + u64::from(self.has_alpha))
    }

    /// The image, from its own file; a video's frames are decoded by group.
    pub(crate) fn make(&self) -> Result<ImageData, Error> {
        match &self.source {
            Source::File(path) => {
                let image = decode(path)?;
                if !self.has_alpha && image.is_transparent() && !TOLD.swap(true, Ordering::Relaxed)
                {
                    tracing::warn!(
                        "{}: transparent in part, and no other picture that was asked is: its transparency is not used",
                        path.display()
                    );
                }
                self.finish(match self.has_alpha {
                    true => image,
                    false => image.without_alpha(),
                })
            }
            Source::Video { video, frame } => {
                let mut made = None;
                video.decode(*frame..*frame + 1, |_, frame| {
                    made = Some(self.finish(frame.into())?);
                    Ok(())
                })?;
                made.ok_or_else(|| video.is_missing(*frame))
            }
        }
    }

    /// Checks, undistorts and downscales a decoded image.
    pub(crate) fn finish(&self, image: ImageData) -> Result<ImageData, Error> {
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
pub(crate) fn check_size(
    path: &Path,
    camera: &Camera,
    (width, height): (usize, usize),
) -> Result<(), Error> {
    let expected = (camera.width, camera.height);
    if expected == (width, height) {
        return Ok(());
    }
    let turned = if expected == (height, width) {
        turned(path)
    } else {
        String::new()
    };
    Err(Error::invalid(
        path,
        format!("an image of {}x{} pixels", expected.0, expected.1),
        format!("{width}x{height}{turned}"),
        "use the images the poses were made for (--downscale makes them smaller on loading)",
    ))
}
