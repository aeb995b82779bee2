//! Lens distortion to undo on loading.

use std::path::Path;

use dash_kernels::Camera;

use super::distortion::{Distortion, undistort};
use super::image::ImageData;
use crate::Error;

/// How to undo a lens's distortion.
#[derive(Debug, Clone)]
pub(crate) struct Lens {
    pub(crate) distortion: Distortion,
    /// Intrinsics of the undistorted image; the pose is the view's.
    pub(crate) pinhole: Camera,
}

impl Lens {
    /// `None` when there is nothing to undo; errors name `path`.
    pub(crate) fn new(
        distortion: Distortion,
        camera: &Camera,
        path: &Path,
    ) -> Result<Option<Self>, Error> {
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

/// The image of `camera` without the distortion of its lens.
pub(crate) fn without_distortion(
    image: ImageData,
    camera: &Camera,
    lens: Option<&Lens>,
) -> ImageData {
    match lens {
        None => image,
        Some(lens) => undistort(&image, camera, &lens.distortion, &lens.pinhole),
    }
}
