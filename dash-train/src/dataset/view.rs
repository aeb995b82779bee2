//! Views: a camera, a time and an image; and the step from a listed image to a loaded view.

use std::fmt;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

use dash_kernels::Camera;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::distortion::{Distortion, undistort};
use super::image::{ImageData, decode, decode_mask};
use super::{DatasetError, LoadOptions};

/// Folder with masks of what truly moves, which synthetic scenes carry.
const MOTION_FOLDER: &str = "motion_masks";

/// What a view is for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Split {
    /// Optimised against.
    Train,
    /// Only measured.
    Test,
}

impl Split {
    /// [`Split::Test`] for a view that is held out.
    pub(super) fn held_out(held_out: bool) -> Self {
        if held_out { Self::Test } else { Self::Train }
    }
}

impl fmt::Display for Split {
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
    pub split: Split,
    /// The image's path below the dataset (for `camNN/images/0003.png`: `camNN/0003`), without extension.
    pub name: String,
    pub(crate) image: Arc<ImageData>,
    pub(crate) motion_mask: Option<Arc<Vec<u8>>>,
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
            split: Split::Train,
            name: name.to_string(),
            image: Arc::new(ImageData::from_rgb(width, height, pixels)),
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
        Ok(self.image.rgb(background))
    }

    /// The image's alpha `[H * W]` in [0, 1]; `None` when it has none.
    ///
    /// # Errors
    /// As [`rgb`](Self::rgb).
    pub fn alpha(&self) -> Result<Option<Vec<f32>>, DatasetError> {
        Ok(self.image.alpha())
    }

    /// Whether the image has alpha.
    pub fn has_alpha(&self) -> bool {
        self.image.has_alpha()
    }

    /// True motion `[H * W]`, 255 where the colour depends on something that moves, else 0. Only
    /// test views of synthetic scenes have it.
    pub fn motion_mask(&self) -> Option<&[u8]> {
        self.motion_mask.as_deref().map(Vec::as_slice)
    }

    /// Memory that the image takes.
    pub fn image_bytes(&self) -> u64 {
        self.image.pixels.len() as u64
    }
}

/// A view whose image is still to be decoded.
pub(super) struct PlannedView {
    pub(super) file: PathBuf,
    pub(super) name: String,
    pub(super) camera_name: String,
    pub(super) camera_index: usize,
    pub(super) frame: usize,
    pub(super) time: f32,
    pub(super) split: Split,
    /// The camera at the size that the image must have.
    pub(super) camera: Camera,
    pub(super) lens: Option<Lens>,
}

/// How to undo a lens's distortion.
#[derive(Clone)]
pub(super) struct Lens {
    pub(super) distortion: Distortion,
    /// Intrinsics of the undistorted image; the pose is the view's.
    pub(super) pinhole: Camera,
}

impl Lens {
    /// `None` when there is nothing to undo; errors name `path`.
    pub(super) fn new(
        distortion: Distortion,
        camera: &Camera,
        path: &Path,
    ) -> Result<Option<Self>, DatasetError> {
        if distortion.is_negligible() {
            return Ok(None);
        }
        let pinhole = distortion.pinhole(camera, path)?;
        Ok(Some(Self {
            distortion,
            pinhole,
        }))
    }
}

/// What all layouts' readers are given.
pub(super) struct Context<'a> {
    pub(super) root: &'a Path,
    pub(super) options: &'a LoadOptions,
    loaded_bytes: AtomicU64,
    /// Where views whose images can't be decoded are noted and left out; `None`: they are errors.
    pub(super) broken: Option<Mutex<Vec<DatasetError>>>,
}

impl<'a> Context<'a> {
    pub(super) fn new(root: &'a Path, options: &'a LoadOptions) -> Self {
        Self {
            root,
            options,
            loaded_bytes: AtomicU64::new(0),
            broken: None,
        }
    }

    /// Decodes the images of all planned views in parallel, keeping their order.
    pub(super) fn load_views(&self, planned: Vec<PlannedView>) -> Result<Vec<View>, DatasetError> {
        planned
            .into_par_iter()
            .filter_map(|view| match (decode(&view.file), &self.broken) {
                (Ok(image), _) => Some(self.finish(view, image)),
                (Err(error), Some(broken)) => {
                    let mut broken = broken.lock().unwrap_or_else(PoisonError::into_inner);
                    broken.push(error);
                    None
                }
                (Err(error), None) => Some(Err(error)),
            })
            .collect()
    }

    /// Checks, undistorts and downscales a decoded image, and adds the mask if there is one.
    pub(super) fn finish(&self, view: PlannedView, image: ImageData) -> Result<View, DatasetError> {
        let full_size = (image.width, image.height);
        if full_size != (view.camera.width, view.camera.height) {
            return Err(DatasetError::invalid(
                &view.file,
                format!(
                    "an image of {}x{} pixels",
                    view.camera.width, view.camera.height
                ),
                format!("{}x{}", image.width, image.height),
                "use the images the poses were made for (--downscale makes them smaller on loading)",
            ));
        }
        let (image, camera) = match &view.lens {
            None => (image, view.camera),
            Some(lens) => {
                let flat = undistort(&image, &view.camera, &lens.distortion, &lens.pinhole);
                let (fx, fy) = (lens.pinhole.fx, lens.pinhole.fy);
                (
                    flat,
                    Camera {
                        fx,
                        fy,
                        ..view.camera
                    },
                )
            }
        };
        let shrink = |side: usize| (side as f64 / self.options.downscale).round().max(1.0) as usize;
        let (width, height) = (shrink(image.width), shrink(image.height));
        let image = image.resized(width, height);
        self.charge(image.pixels.len() as u64)?;
        let mask_file = self
            .root
            .join(MOTION_FOLDER)
            .join(format!("{}.png", view.name));
        let mask = (view.split == Split::Test && mask_file.is_file())
            .then(|| decode_mask(&mask_file, full_size, width, height))
            .transpose()?;
        Ok(View {
            camera_name: view.camera_name,
            camera_index: view.camera_index,
            frame: view.frame,
            time: view.time,
            camera: camera.resized(width, height),
            split: view.split,
            name: view.name,
            image: Arc::new(image),
            motion_mask: mask.map(Arc::new),
        })
    }

    fn charge(&self, bytes: u64) -> Result<(), DatasetError> {
        let total = self.loaded_bytes.fetch_add(bytes, Ordering::Relaxed) + bytes;
        if total <= self.options.max_image_bytes {
            return Ok(());
        }
        Err(DatasetError::invalid(
            self.root,
            format!(
                "images that fit {} bytes of memory",
                self.options.max_image_bytes
            ),
            format!("at least {total} bytes"),
            "load smaller images (--downscale) or fewer frames",
        ))
    }
}
