//! Points of a COLMAP model with their reprojection errors and track lengths.

use std::path::Path;

use super::binary::{POINT_BYTES, Reader, TRACK_BYTES};
use super::model::read_model_file;
use super::text::{Fields, content};
use crate::Error;

/// A triangulated point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct TrackedPoint {
    /// In the world.
    pub(crate) position: [f64; 3],
    /// sRGB.
    pub(crate) color: [u8; 3],
    /// Mean reprojection error, pixels.
    pub(crate) error: f64,
    /// Track length: the number of images that see it.
    pub(crate) n_images: usize,
}

/// The points of a model's `points3D.bin` or `points3D.txt`, as they are listed.
///
/// # Errors
/// When the file is missing, damaged or truncated.
pub(crate) fn read_tracked_points(model: &Path) -> Result<Vec<TrackedPoint>, Error> {
    Ok(read_model_file(model, "points3D", binary, text)?.1)
}

fn binary(path: &Path, bytes: &[u8]) -> Result<Vec<TrackedPoint>, Error> {
    let mut reader = Reader::new(path, bytes);
    let n = reader.count(POINT_BYTES, "points")?;
    let mut points = Vec::with_capacity(n);
    for _ in 0..n {
        reader.u64("point id")?;
        let position = reader.f64s("point position")?;
        let color = reader.array("point colour")?;
        let error = reader.f64("point error")?;
        let n_images = reader.count(TRACK_BYTES, "track")?;
        reader.take(n_images * TRACK_BYTES, "track")?;
        points.push(TrackedPoint {
            position,
            color,
            error,
            n_images,
        });
    }
    Ok(points)
}

fn text(path: &Path, text: &str) -> Result<Vec<TrackedPoint>, Error> {
    let mut points = Vec::new();
    for (number, line) in content(text) {
        let mut fields = Fields::new(path, number, line);
        fields.next::<u64>("point id")?;
        let position = fields.array("point position")?;
        let color = fields.array("point colour")?;
        let error = fields.next("point error")?;
        // Pairs of an image and one of its features.
        let n_images = fields.rest::<u64>("point track")?.len() / 2;
        points.push(TrackedPoint {
            position,
            color,
            error,
            n_images,
        });
    }
    Ok(points)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// One point seen in two images.
    fn one_point() -> Vec<u8> {
        let mut bytes = 1u64.to_le_bytes().to_vec();
        bytes.extend(7u64.to_le_bytes());
        for v in [1.0f64, -2.0, 3.5] {
            bytes.extend(v.to_le_bytes());
        }
        bytes.extend([9, 8, 7]);
        bytes.extend(0.25f64.to_le_bytes());
        bytes.extend(2u64.to_le_bytes());
        bytes.extend([0; 16]);
        bytes
    }

    #[test]
    fn both_formats_give_the_same_points() {
        let path = Path::new("points3D");
        let from_text =
            text(path, "# made by hand\n7 1 -2 3.5 9 8 7 0.25 1 0 2 0\n").expect("valid");
        assert_eq!(from_text, binary(path, &one_point()).expect("valid"));
        assert_eq!(from_text[0].n_images, 2);
        assert_eq!(from_text[0].error, 0.25);
    }

    #[test]
    fn truncated_and_hostile_files_are_errors() {
        let path = Path::new("points3D.bin");
        let bytes = one_point();
        for end in 0..bytes.len() {
            binary(path, &bytes[..end]).expect_err("truncated");
        }
        let mut many = bytes;
        many[..8].copy_from_slice(&u64::MAX.to_le_bytes());
        binary(path, &many).expect_err("a count beyond the file");
        for bad in [
            "7",
            "7 1 2",
            "7 1 2 3 9 8 7",
            "7 1 2 3 9 8 7 0.1",
            "7 1 2 3 9 8 256 0.1 1 0",
        ] {
            text(path, bad).expect_err(bad);
        }
    }
}
