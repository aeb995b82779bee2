//! Views: a camera, a time and an image.

use std::ops::Range;
use std::path::PathBuf;
use std::sync::Arc;

use dash_kernels::Camera;

use super::partition::Partition;
use super::pixels::decode_mask;
use super::pixels::frames::Pixels;
use super::pixels::image::ImageData;
use super::pixels::lens::{Lens, without_distortion};
use crate::Error;

/// One image of a capture. Clones share the image.
#[derive(Debug, Clone)]
pub struct View {
    /// The camera's name: its folder or video, or a number for poses that have none.
    pub camera_name: String,
    /// Index of the camera in the capture; views with one pose share it.
    pub camera_index: usize,
    /// Index of the time among the capture's loaded times.
    pub frame: usize,
    /// Time in [0, 1]; 0 in a static capture.
    pub time: f32,
    /// Pose and intrinsics at the loaded size.
    pub camera: Camera,
    /// Whether it is trained on or held out.
    pub partition: Partition,
    /// The image's path below the dataset (for `camNN/images/0003.png`: `camNN/0003`), without extension.
    pub name: String,
    pub(crate) pixels: Pixels,
    /// Memory of the decoded image.
    pub(crate) bytes: u64,
    /// Size of the file that the image is in; 0 of one that is in none.
    pub(crate) file_bytes: u64,
    pub(crate) has_alpha: bool,
    pub(crate) motion_mask: Option<MotionMask>,
}

/// A view made smaller.
pub(crate) struct SmallView {
    pub(crate) camera: Camera,
    /// `[H * W * 3]` in [0, 1].
    pub(crate) rgb: Vec<f32>,
    /// `[H * W]` in [0, 1].
    pub(crate) alpha: Option<Vec<f32>>,
}

/// The true motion mask of a synthetic view.
#[derive(Debug, Clone)]
pub(crate) enum MotionMask {
    /// `[H * W]` of 0 and 255.
    Ready(Arc<Vec<u8>>),
    /// Read on demand.
    File(Box<MotionFile>),
}

/// The file of a motion mask, with the camera and lens of its image.
#[derive(Debug, Clone)]
pub(crate) struct MotionFile {
    pub(crate) path: PathBuf,
    /// At the size of the image as captured.
    pub(crate) camera: Camera,
    pub(crate) lens: Option<Lens>,
}

impl MotionFile {
    /// The mask on the pixels of the undistorted image, `[H * W]` of 0 and 255.
    fn read(&self, width: usize, height: usize) -> Result<Vec<u8>, Error> {
        let full_size = (self.camera.width, self.camera.height);
        let mask = decode_mask(&self.path, full_size)?;
        let flat = without_distortion(mask, &self.camera, self.lens.as_ref());
        Ok(flat.resized(width, height).thresholded(false))
    }
}

impl View {
    /// A training view of camera 0 and frame 0 from 8-bit pixels `[H * W * 3]`, for data that does
    /// not come from a folder; the public fields say the rest.
    ///
    /// # Panics
    /// When there are not as many pixels as the camera has.
    pub fn from_rgb8(name: &str, camera: Camera, time: f32, pixels: Vec<u8>) -> Self {
        let (width, height) = (camera.width, camera.height);
        assert_eq!(
            pixels.len(),
            width * height * 3,
            "`pixels` must be [H * W * 3]"
        );
        Self {
            camera_name: name.to_string(),
            camera_index: 0,
            frame: 0,
            time,
            camera,
            partition: Partition::Train,
            name: name.to_string(),
            bytes: pixels.len() as u64,
            file_bytes: 0,
            has_alpha: false,
            pixels: Pixels::Ready(Arc::new(ImageData::from_rgb(width, height, pixels))),
            motion_mask: None,
        }
    }

    /// The image over `background`.
    ///
    /// # Shapes
    /// `[H * W * 3]`, rows first, sRGB values in [0, 1].
    ///
    /// # Errors
    /// When an image on demand is damaged or gone.
    pub fn rgb(&self, background: [f32; 3]) -> Result<Vec<f32>, Error> {
        Ok(self.pixels.get()?.rgb(background))
    }

    /// Some rows of [`rgb`](Self::rgb).
    pub(crate) fn rgb_rows(
        &self,
        background: [f32; 3],
        rows: Range<usize>,
    ) -> Result<Vec<f32>, Error> {
        Ok(self.pixels.get()?.rgb_rows(background, rows))
    }

    /// The image's alpha `[H * W]` in [0, 1]; `None` when it has none.
    ///
    /// # Errors
    /// As [`rgb`](Self::rgb).
    pub fn alpha(&self) -> Result<Option<Vec<f32>>, Error> {
        Ok(self.pixels.get()?.alpha())
    }

    /// Camera and image at a size of which no side is longer than `max_side`.
    pub(crate) fn at_most(
        &self,
        max_side: usize,
        background: [f32; 3],
    ) -> Result<SmallView, Error> {
        let image = self.pixels.get()?;
        let (width, height) = (self.camera.width, self.camera.height);
        let longer = width.max(height);
        if longer <= max_side {
            return Ok(SmallView {
                camera: self.camera.clone(),
                rgb: image.rgb(background),
                alpha: image.alpha(),
            });
        }
        let shrink = |side: usize| (side * max_side / longer).max(1);
        let small = ImageData::clone(&image).resized(shrink(width), shrink(height));
        Ok(SmallView {
            camera: self.camera.resized(small.width, small.height),
            rgb: small.rgb(background),
            alpha: small.alpha(),
        })
    }

    /// The image over `background` as by [`rgb`](Self::rgb), and its mask: `[H * W]`, 1 for pixels that count and
    /// 0 for others; `None` where all count.
    ///
    /// # Errors
    /// As [`rgb`](Self::rgb).
    pub fn rgb_and_counted(
        &self,
        background: [f32; 3],
    ) -> Result<(Vec<f32>, Option<Vec<f32>>), Error> {
        let image = self.pixels.get()?;
        let counted = image.counted.as_ref().map(|mask| {
            mask.iter()
                .map(|&counts| f32::from(u8::from(counts > 0)))
                .collect()
        });
        Ok((image.rgb(background), counted))
    }

    /// The result of `work` on the image's bytes `[H * W * 3]`; `None` for an image with alpha or a mask.
    ///
    /// # Errors
    /// As [`rgb`](Self::rgb).
    pub(crate) fn with_plain_rgb<T>(
        &self,
        work: impl FnOnce(&[u8]) -> T,
    ) -> Result<Option<T>, Error> {
        let image = self.pixels.get()?;
        let is_plain = !image.has_alpha() && image.counted.is_none();
        Ok(is_plain.then(|| work(&image.pixels)))
    }

    /// Whether the image has alpha.
    pub fn has_alpha(&self) -> bool {
        self.has_alpha
    }

    /// The true motion mask `[H * W]`: 255 where a moving object affects the colour, else 0. Only test views of
    /// synthetic scenes have one.
    ///
    /// # Errors
    /// As [`rgb`](Self::rgb).
    pub fn motion_mask(&self) -> Result<Option<Arc<Vec<u8>>>, Error> {
        match &self.motion_mask {
            None => Ok(None),
            Some(MotionMask::Ready(mask)) => Ok(Some(mask.clone())),
            Some(MotionMask::File(file)) => {
                let mask = file.read(self.camera.width, self.camera.height)?;
                Ok(Some(Arc::new(mask)))
            }
        }
    }

    /// Memory of the decoded image, bytes.
    pub fn image_bytes(&self) -> u64 {
        self.bytes
    }
}
