//! COLMAP's binary model files.

use std::path::Path;

use super::rows::{ModelCamera, ModelImage, parameter_names};
use crate::Error;
use crate::ply::PointCloud;

/// Smallest size of one entry of each file, with an empty name and no observations.
const CAMERA_BYTES: usize = 24;
const IMAGE_BYTES: usize = 4 + 7 * 8 + 4 + 1 + 8;
pub(crate) const POINT_BYTES: usize = 8 + 3 * 8 + 3 + 8 + 8;
const OBSERVATION_BYTES: usize = 24;
pub(crate) const TRACK_BYTES: usize = 8;

pub(crate) fn cameras(path: &Path, bytes: &[u8]) -> Result<Vec<ModelCamera>, Error> {
    let mut reader = Reader::new(path, bytes);
    let n = reader.count(CAMERA_BYTES, "cameras")?;
    let mut cameras = Vec::with_capacity(n);
    for _ in 0..n {
        let id = reader.u32("camera id")?;
        let model = reader.u32("camera model")?;
        let (width, height) = (reader.u64("width")?, reader.u64("height")?);
        let Some((model, names)) = parameter_names(model) else {
            return Err(Error::invalid(
                path,
                "a camera model among SIMPLE_PINHOLE, PINHOLE, SIMPLE_RADIAL, RADIAL, OPENCV and \
                 FULL_OPENCV",
                format!(
                    "a lens model that is not supported, camera model {model}, for camera {id}"
                ),
                "undistort the images with COLMAP (`colmap image_undistorter`)",
            ));
        };
        let mut parameters = Vec::with_capacity(names);
        for _ in 0..names {
            parameters.push(reader.f64("camera parameters")?);
        }
        cameras.push(ModelCamera {
            id,
            model: model.to_string(),
            width,
            height,
            parameters,
        });
    }
    Ok(cameras)
}

pub(crate) fn images(path: &Path, bytes: &[u8]) -> Result<Vec<ModelImage>, Error> {
    let mut reader = Reader::new(path, bytes);
    let n = reader.count(IMAGE_BYTES, "images")?;
    let mut images = Vec::with_capacity(n);
    for _ in 0..n {
        let image = reader.image()?;
        let observations = reader.count(OBSERVATION_BYTES, "observations")?;
        reader.take(observations * OBSERVATION_BYTES, "observations")?;
        images.push(image);
    }
    Ok(images)
}

/// The points, and how many were not finite and left out.
pub(crate) fn points(path: &Path, bytes: &[u8]) -> Result<(PointCloud, usize), Error> {
    let mut reader = Reader::new(path, bytes);
    let n = reader.count(POINT_BYTES, "points")?;
    let mut points = PointCloud::default();
    let mut dropped = 0;
    for _ in 0..n {
        reader.u64("point id")?;
        let position = reader.f64s("point position")?;
        let color = reader.array("point colour")?;
        reader.f64("point error")?;
        let track = reader.count(TRACK_BYTES, "track")?;
        reader.take(track * TRACK_BYTES, "track")?;
        if !points.push_finite(position, color) {
            dropped += 1;
        }
    }
    Ok((points, dropped))
}

/// Little-endian numbers from a byte slice, with errors instead of reads past its end.
pub(crate) struct Reader<'a> {
    path: &'a Path,
    rest: &'a [u8],
    length: usize,
}

impl<'a> Reader<'a> {
    pub(crate) fn new(path: &'a Path, bytes: &'a [u8]) -> Self {
        Self {
            path,
            rest: bytes,
            length: bytes.len(),
        }
    }

    fn malformed(&self, found: String) -> Error {
        Error::invalid(
            self.path,
            "a complete COLMAP binary file",
            format!("{found} at byte {}", self.length - self.rest.len()),
            "export the model again (`colmap model_converter`)",
        )
    }

    pub(crate) fn take(&mut self, n: usize, what: &str) -> Result<&'a [u8], Error> {
        let Some((taken, rest)) = self.rest.split_at_checked(n) else {
            return Err(self.malformed(format!("the end of the file within {what}")));
        };
        self.rest = rest;
        Ok(taken)
    }

    pub(crate) fn array<const N: usize>(&mut self, what: &str) -> Result<[u8; N], Error> {
        let mut bytes = [0; N];
        bytes.copy_from_slice(self.take(N, what)?);
        Ok(bytes)
    }

    pub(crate) fn u32(&mut self, what: &str) -> Result<u32, Error> {
        self.array(what).map(u32::from_le_bytes)
    }

    pub(crate) fn u64(&mut self, what: &str) -> Result<u64, Error> {
        self.array(what).map(u64::from_le_bytes)
    }

    pub(crate) fn f64(&mut self, what: &str) -> Result<f64, Error> {
        self.array(what).map(f64::from_le_bytes)
    }

    pub(crate) fn f64s<const N: usize>(&mut self, what: &str) -> Result<[f64; N], Error> {
        let mut values = [0.0; N];
        for value in &mut values {
            *value = self.f64(what)?;
        }
        Ok(values)
    }

    /// A count of entries of at least `entry_bytes` each, which the rest of the file must hold.
    pub(crate) fn count(&mut self, entry_bytes: usize, what: &str) -> Result<usize, Error> {
        let n = self.u64(what)?;
        match usize::try_from(n) {
            Ok(n) if n <= self.rest.len() / entry_bytes => Ok(n),
            _ => Err(self.malformed(format!("{n} {what} announced, more than fit in the file"))),
        }
    }

    /// An image's entry up to its observations.
    pub(crate) fn image(&mut self) -> Result<ModelImage, Error> {
        self.u32("image id")?;
        let quaternion = self.f64s("image rotation")?;
        let translation = self.f64s("image translation")?;
        let camera_id = self.u32("image camera")?;
        let Some(end) = self.rest.iter().position(|&c| c == 0) else {
            return Err(self.malformed("an image name without end".into()));
        };
        let name = self.take(end + 1, "image name")?;
        let Ok(name) = std::str::from_utf8(&name[..end]) else {
            return Err(self.malformed("an image name that is not UTF-8".into()));
        };
        Ok(ModelImage {
            quaternion,
            translation,
            camera_id,
            name: name.to_string(),
        })
    }
}
