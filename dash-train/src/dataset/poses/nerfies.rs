//! One camera file of the Nerfies layout.

use std::path::Path;

use dash_kernels::Camera;
use serde::Deserialize;

use super::intrinsics::Intrinsics;
use super::pose;
use crate::Error;
use crate::dataset::pixels::distortion::Distortion;

/// The file's fields; OpenCV axes and lens model, sizes and focal length in pixels.
#[derive(Debug, Deserialize)]
pub(crate) struct CameraFile {
    /// World-to-camera rotation, rows.
    orientation: [[f64; 3]; 3],
    position: [f64; 3],
    focal_length: f64,
    principal_point: [f64; 2],
    #[serde(default)]
    skew: f64,
    /// Vertical over horizontal focal length.
    pixel_aspect_ratio: Option<f64>,
    #[serde(default)]
    radial_distortion: Vec<f64>,
    #[serde(default)]
    tangential_distortion: Vec<f64>,
    /// The older name of `tangential_distortion`.
    #[serde(default)]
    tangential: Vec<f64>,
    /// Width and height, which some writers state as real numbers.
    image_size: [f64; 2],
}

impl CameraFile {
    /// The camera at the file's image size and its lens; `place` moves the position.
    ///
    /// # Errors
    /// Names `path`: numbers that are not finite, not positive or too many, skew, a principal point
    /// of pictures of another size, or a rotation that is none.
    pub(crate) fn camera(
        &self,
        path: &Path,
        place: impl Fn([f64; 3]) -> [f64; 3],
    ) -> Result<(Camera, Distortion), Error> {
        let malformed = |expected: &str, found: String| {
            Error::invalid(path, expected, found, "mend the file or write it again")
        };
        let aspect = self.pixel_aspect_ratio.unwrap_or(1.0);
        let intrinsics = Intrinsics {
            size: self.image_size,
            focal: [self.focal_length, self.focal_length * aspect],
            principal_point: self.principal_point,
            skew: self.skew,
        };
        let intrinsics = intrinsics
            .camera()
            .map_err(|(expected, found)| malformed(expected, found))?;
        let distortion = self.distortion().ok_or_else(|| {
            malformed("at most 3 radial and 2 tangential coefficients, finite", {
                format!("{self:?}")
            })
        })?;
        let camera = pose::place(intrinsics, self.orientation, place(self.position))
            .map_err(|found| malformed("a world-to-camera rotation and a position", found))?;
        Ok((camera, distortion))
    }

    /// `None` when there are more coefficients than the model has, or one is not finite.
    fn distortion(&self) -> Option<Distortion> {
        let tangential = if self.tangential_distortion.is_empty() {
            &self.tangential
        } else {
            &self.tangential_distortion
        };
        if self.radial_distortion.len() > 3 || tangential.len() > 2 {
            return None;
        }
        let mut distortion = Distortion::default();
        for (out, value) in distortion.k.iter_mut().zip(&self.radial_distortion) {
            *out = *value;
        }
        for (out, value) in distortion.p.iter_mut().zip(tangential) {
            *out = *value;
        }
        distortion.is_finite().then_some(distortion)
    }
}
