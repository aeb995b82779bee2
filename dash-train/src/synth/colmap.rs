//! A binary COLMAP model.

use super::cloud::CloudPoint;
use super::files;
use super::poses::quaternion;
use crate::Error;
use dash_kernels::Camera;
use std::path::Path;

/// COLMAP's number of the model `PINHOLE`.
const PINHOLE: u32 = 1;

/// `cameras.bin` and `images.bin` with an image `camNN.png` per camera.
pub(super) fn write_cameras(root: &Path, cameras: &[Camera]) -> Result<(), Error> {
    let count = (cameras.len() as u64).to_le_bytes();
    let (mut intrinsics, mut images) = (count.to_vec(), count.to_vec());
    for (index, camera) in cameras.iter().enumerate() {
        let id = (index as u32 + 1).to_le_bytes();
        intrinsics.extend(id);
        intrinsics.extend(PINHOLE.to_le_bytes());
        intrinsics.extend((camera.width as u64).to_le_bytes());
        intrinsics.extend((camera.height as u64).to_le_bytes());
        extend(
            &mut intrinsics,
            [camera.fx, camera.fy, camera.cx, camera.cy],
        );
        images.extend(id);
        extend(&mut images, quaternion(camera));
        extend(&mut images, camera.translation);
        images.extend(id);
        images.extend(format!("cam{index:02}.png\0").as_bytes());
        // No observations.
        images.extend(0u64.to_le_bytes());
    }
    files::write_bytes(&root.join("sparse/0/cameras.bin"), &intrinsics)?;
    files::write_bytes(&root.join("sparse/0/images.bin"), &images)
}

/// The bytes of `points3D.bin`, without tracks.
pub(super) fn points(points: &[CloudPoint]) -> Vec<u8> {
    let mut bytes = (points.len() as u64).to_le_bytes().to_vec();
    for (index, point) in points.iter().enumerate() {
        bytes.extend((index as u64 + 1).to_le_bytes());
        extend(&mut bytes, [point.x, point.y, point.z].map(f64::from));
        bytes.extend([point.red, point.green, point.blue]);
        // Reprojection error and length of the track.
        extend(&mut bytes, [0.0]);
        bytes.extend(0u64.to_le_bytes());
    }
    bytes
}

fn extend<const N: usize>(bytes: &mut Vec<u8>, numbers: [f64; N]) {
    bytes.extend(numbers.iter().flat_map(|number| number.to_le_bytes()));
}
