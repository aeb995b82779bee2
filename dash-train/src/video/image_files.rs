//! PNG and EXR files, and the step from a scratch file to the file.

use std::fs::{self, File};
use std::io::{self, Cursor, Write};
use std::path::Path;

use dash_model::unfinished::Unfinished;
use image::codecs::openexr::OpenExrEncoder;
use image::codecs::png::PngEncoder;
use image::{ExtendedColorType, ImageEncoder, ImageError};

use crate::Error;

/// Writes an 8-bit RGB PNG.
///
/// # Shapes
/// `rgb [H, W, 3]`.
///
/// # Errors
/// When the size is zero or not that of `rgb`, or the file can't be written.
///
/// ```
/// use dash_train::video::write_png;
///
/// let folder = tempfile::tempdir()?;
/// let path = folder.path().join("flag.png");
/// write_png(&path, 2, 1, &[255, 0, 0, 0, 0, 255])?;
/// assert!(write_png(&path, 2, 2, &[255, 0, 0, 0, 0, 255]).is_err(), "two pixels short");
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn write_png(path: &Path, width: usize, height: usize, rgb: &[u8]) -> Result<(), Error> {
    let size = checked_size(path, [width, height], rgb.len(), 3)?;
    write_image(path, |file| {
        PngEncoder::new(file).write_image(rgb, size[0], size[1], ExtendedColorType::Rgb8)
    })
}

/// Writes an RGB OpenEXR with f32 values as they are: nothing is clamped or converted.
///
/// # Shapes
/// `rgb [H, W, 3]`.
///
/// # Errors
/// When the size is zero or not that of `rgb`, or the file can't be written.
pub fn write_exr_rgb(path: &Path, width: usize, height: usize, rgb: &[f32]) -> Result<(), Error> {
    let size = checked_size(path, [width, height], rgb.len(), 3)?;
    let bytes: Vec<u8> = rgb.iter().flat_map(|v| v.to_ne_bytes()).collect();
    write_image(path, |file| {
        OpenExrEncoder::new(file).write_image(&bytes, size[0], size[1], ExtendedColorType::Rgb32F)
    })
}

/// Writes one f32 value per pixel (depth, alpha) as an OpenEXR whose R, G and B are equal.
///
/// # Shapes
/// `plane [H, W]`.
///
/// # Errors
/// When the size is zero or not that of `plane`, or the file can't be written.
pub fn write_exr_plane(
    path: &Path,
    width: usize,
    height: usize,
    plane: &[f32],
) -> Result<(), Error> {
    checked_size(path, [width, height], plane.len(), 1)?;
    let rgb: Vec<f32> = plane.iter().flat_map(|v| [*v; 3]).collect();
    write_exr_rgb(path, width, height, &rgb)
}

/// The size as the encoders want it, if `n_values` fill it.
pub(super) fn checked_size(
    path: &Path,
    [width, height]: [usize; 2],
    n_values: usize,
    channels: usize,
) -> Result<[u32; 2], Error> {
    let expected = width
        .checked_mul(height)
        .and_then(|n| n.checked_mul(channels))
        .filter(|n| *n > 0);
    match (u32::try_from(width), u32::try_from(height)) {
        (Ok(width), Ok(height)) if expected == Some(n_values) => Ok([width, height]),
        _ => Err(Error::invalid(
            path,
            format!("{width} x {height} pixels of {channels} values, at least one"),
            format!("{n_values} values"),
            "give as many values as the size says",
        )),
    }
}

fn write_image(
    path: &Path,
    encode: impl FnOnce(&mut Cursor<Vec<u8>>) -> Result<(), ImageError>,
) -> Result<(), Error> {
    // In memory first: encoders turn what the system says into words.
    let mut encoded = Cursor::new(Vec::new());
    encode(&mut encoded).map_err(|error| Error::ImageEncode {
        path: path.to_path_buf(),
        reason: error.to_string(),
    })?;
    write_whole(path, |file| file.write_all(encoded.get_ref())).map_err(Error::media_write(path))
}

/// Writes a file whole or not at all.
///
/// # Errors
/// Those of `write` and of the file system; then the file is as it was before.
pub(crate) fn write_whole(
    path: &Path,
    write: impl FnOnce(&mut File) -> io::Result<()>,
) -> io::Result<()> {
    let scratch = Unfinished::file(path)?;
    write(&mut File::options().write(true).open(scratch.path())?)?;
    scratch.finish(|scratch| fs::rename(scratch, path))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn folder() -> tempfile::TempDir {
        tempfile::tempdir().expect("a scratch folder")
    }

    #[test]
    fn a_png_is_read_back() {
        let folder = folder();
        let path = folder.path().join("a.png");
        let rgb: Vec<u8> = (0..5 * 3 * 3).map(|v| v * 5).collect();
        write_png(&path, 5, 3, &rgb).expect("writable");
        write_png(&path, 5, 3, &rgb).expect("replaceable");
        let read = image::open(&path).expect("a PNG").into_rgb8();
        assert_eq!((read.dimensions(), read.into_raw()), ((5, 3), rgb));
        let files = std::fs::read_dir(folder.path()).expect("a folder").count();
        assert_eq!(files, 1, "no scratch file is left");
    }

    #[test]
    fn an_exr_keeps_every_bit() {
        let folder = folder();
        let path = folder.path().join("depth.exr");
        let plane = [0.0, -1.5, 1e-30, 3.25e7, f32::INFINITY, 0.1];
        write_exr_plane(&path, 2, 3, &plane).expect("writable");
        let read = image::open(&path).expect("an EXR").into_rgb32f();
        assert_eq!(read.dimensions(), (2, 3));
        let expected: Vec<f32> = plane.iter().flat_map(|v| [*v; 3]).collect();
        assert_eq!(read.into_raw(), expected);
        let rgb: Vec<f32> = (0..12).map(|v| v as f32 * 0.3 - 1.0).collect();
        write_exr_rgb(&path, 4, 1, &rgb).expect("writable");
        assert_eq!(
            image::open(&path).expect("an EXR").into_rgb32f().into_raw(),
            rgb
        );
    }

    #[test]
    fn sizes_must_fit_and_nothing_is_left_behind() {
        let folder = folder();
        let path = folder.path().join("a.png");
        for (width, height, n) in [(2, 2, 11), (0, 0, 0), (usize::MAX, 2, 6)] {
            let error = write_png(&path, width, height, &vec![0; n]).expect_err("wrong size");
            assert!(error.to_string().contains("a.png: expected"), "{error}");
            assert!(write_exr_plane(&path, width, height, &vec![0.0; n]).is_err());
        }
        assert_eq!(
            std::fs::read_dir(folder.path()).expect("a folder").count(),
            0
        );
    }

    #[test]
    fn a_missing_folder_is_named() {
        let path = folder().path().join("none").join("a.png");
        let error = write_png(&path, 1, 1, &[0; 3])
            .expect_err("no folder")
            .to_string();
        assert!(error.contains("a.png: cannot write it"), "{error}");
    }

    #[test]
    fn a_failed_write_keeps_the_old_file() {
        let folder = folder();
        let path = folder.path().join("a.txt");
        std::fs::write(&path, "old").expect("writable");
        let failed = write_whole(&path, |file| {
            file.write_all(b"new")?;
            Err(io::ErrorKind::StorageFull.into())
        });
        assert!(failed.is_err());
        assert_eq!(std::fs::read_to_string(&path).expect("readable"), "old");
        assert_eq!(
            std::fs::read_dir(folder.path()).expect("a folder").count(),
            1
        );
    }

    #[cfg(unix)]
    #[test]
    fn files_are_as_readable_as_others() {
        use std::os::unix::fs::PermissionsExt;
        let folder = folder();
        let (ours, plain) = (folder.path().join("a.png"), folder.path().join("b"));
        write_png(&ours, 1, 1, &[0; 3]).expect("writable");
        std::fs::write(&plain, "").expect("writable");
        let mode = |path: &Path| {
            std::fs::metadata(path)
                .expect("a file")
                .permissions()
                .mode()
        };
        assert_eq!(mode(&ours), mode(&plain));
    }
}
