//! Views: a camera, a time and an image.

use std::fmt;
use std::ops::Range;
use std::path::PathBuf;
use std::sync::Arc;

use dash_kernels::Camera;
use serde::{Deserialize, Serialize};

use super::DatasetError;
use super::decode::decode_mask;
use super::frames::Pixels;
use super::image::ImageData;
use super::plan::{Lens, without_distortion};

/// What a view is for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Partition {
    /// Optimised against.
    Train,
    /// Only measured.
    Test,
}

impl Partition {
    /// [`Partition::Test`] for a view that is held out.
    pub(super) fn held_out(held_out: bool) -> Self {
        if held_out { Self::Test } else { Self::Train }
    }
}

impl fmt::Display for Partition {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Train => "train",
            Self::Test => "test",
        })
    }
}

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
    /// Memory that the image takes when it is there.
    pub(crate) bytes: u64,
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

/// A mask of what truly moves.
#[derive(Debug, Clone)]
pub(crate) enum MotionMask {
    /// `[H * W]` of 0 and 255.
    Ready(Arc<Vec<u8>>),
    /// Read when it is asked for.
    File(Box<MotionFile>),
}

/// The file of a mask of what truly moves, and what its image was taken with.
#[derive(Debug, Clone)]
pub(crate) struct MotionFile {
    pub(super) path: PathBuf,
    /// At the size of the image as captured.
    pub(super) camera: Camera,
    pub(super) lens: Option<Lens>,
}

impl MotionFile {
    /// The mask on the pixels of the undistorted image, `[H * W]` of 0 and 255.
    fn read(&self, width: usize, height: usize) -> Result<Vec<u8>, DatasetError> {
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
    /// When the image is read only now and is damaged or gone.
    pub fn rgb(&self, background: [f32; 3]) -> Result<Vec<f32>, DatasetError> {
        Ok(self.pixels.get()?.rgb(background))
    }

    /// Some rows of [`rgb`](Self::rgb).
    pub(crate) fn rgb_rows(
        &self,
        background: [f32; 3],
        rows: Range<usize>,
    ) -> Result<Vec<f32>, DatasetError> {
        Ok(self.pixels.get()?.rgb_rows(background, rows))
    }

    /// The image's alpha `[H * W]` in [0, 1]; `None` when it has none.
    ///
    /// # Errors
    /// As [`rgb`](Self::rgb).
    pub fn alpha(&self) -> Result<Option<Vec<f32>>, DatasetError> {
        Ok(self.pixels.get()?.alpha())
    }

    /// Camera and image at a size of which no side is longer than `max_side`.
    pub(crate) fn at_most(
        &self,
        max_side: usize,
        background: [f32; 3],
    ) -> Result<SmallView, DatasetError> {
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

    /// The image over `background` as [`rgb`](Self::rgb) gives it, and which pixels count, `[H * W]` of 1
    /// and 0, `None` where all do.
    ///
    /// # Errors
    /// As [`rgb`](Self::rgb).
    pub fn rgb_and_counted(
        &self,
        background: [f32; 3],
    ) -> Result<(Vec<f32>, Option<Vec<f32>>), DatasetError> {
        let image = self.pixels.get()?;
        let counted = image.counted.as_ref().map(|mask| {
            mask.iter()
                .map(|&counts| f32::from(u8::from(counts > 0)))
                .collect()
        });
        Ok((image.rgb(background), counted))
    }

    /// What `work` makes of the image's bytes `[H * W * 3]`; `None` where it has alpha or pixels that do not count.
    ///
    /// # Errors
    /// As [`rgb`](Self::rgb).
    pub(crate) fn with_plain_rgb<T>(
        &self,
        work: impl FnOnce(&[u8]) -> T,
    ) -> Result<Option<T>, DatasetError> {
        let image = self.pixels.get()?;
        let is_plain = !image.has_alpha() && image.counted.is_none();
        Ok(is_plain.then(|| work(&image.pixels)))
    }

    /// Whether the image has alpha.
    pub fn has_alpha(&self) -> bool {
        self.has_alpha
    }

    /// True motion `[H * W]`, 255 where the colour depends on something that moves, else 0. Only
    /// test views of synthetic scenes have it.
    ///
    /// # Errors
    /// As [`rgb`](Self::rgb).
    pub fn motion_mask(&self) -> Result<Option<Arc<Vec<u8>>>, DatasetError> {
        match &self.motion_mask {
            None => Ok(None),
            Some(MotionMask::Ready(mask)) => Ok(Some(mask.clone())),
            Some(MotionMask::File(file)) => {
                let mask = file.read(self.camera.width, self.camera.height)?;
                Ok(Some(Arc::new(mask)))
            }
        }
    }

    /// Memory that the image takes when it is there.
    pub fn image_bytes(&self) -> u64 {
        self.bytes
    }
}
