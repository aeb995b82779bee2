//! Images from files: PNG and JPEG, whole and of a sensible size.

use std::fs;
use std::io::Cursor;
use std::path::Path;

use image::metadata::Orientation;
use image::{DynamicImage, ImageDecoder, ImageFormat, ImageReader, Limits};

use super::image::{ImageData, RGBA};
use super::image_size::can_hold_its_pixels;
use crate::Error;
use crate::files::{refuse_pointer, refuse_pointer_file};

pub(crate) use crate::video::MAX_IMAGE_SIDE;

/// An image's width and height from its header.
pub(crate) fn dimensions(path: &Path) -> Result<(usize, usize), Error> {
    let (width, height, _) = header(path)?;
    Ok((width, height))
}

/// An image's width, height and whether it has alpha, from its header.
pub(crate) fn header(path: &Path) -> Result<(usize, usize, bool), Error> {
    let mut reader = ImageReader::open(path)
        .and_then(ImageReader::with_guessed_format)
        .map_err(Error::access(path))?;
    reader.limits(limits());
    let decoder = reader.into_decoder().or_else(|e| {
        refuse_pointer_file(path, "an image")?;
        Err(Error::image_decode(path, e))
    })?;
    let (width, height) = decoder.dimensions();
    let has_alpha = decoder.color_type().has_alpha();
    Ok((width as usize, height as usize, has_alpha))
}

/// A note for errors about an image of the wrong shape: its EXIF orientation turns it by a right angle. Else empty.
pub(crate) fn turned(path: &Path) -> String {
    let n = orientation(path).to_exif();
    // 5 to 8 exchange rows and columns.
    match n {
        5..=8 => format!(" (EXIF orientation {n}: rotate the file)"),
        _ => String::new(),
    }
}

/// How an image is to be turned and mirrored, as its EXIF data say; not at all where they don't.
pub(crate) fn orientation(path: &Path) -> Orientation {
    let stated = || {
        let reader = ImageReader::open(path).and_then(ImageReader::with_guessed_format);
        let mut decoder = reader.ok()?.into_decoder().ok()?;
        decoder.orientation().ok()
    };
    stated().unwrap_or(Orientation::NoTransforms)
}

fn limits() -> Limits {
    let mut limits = Limits::default();
    limits.max_image_width = Some(MAX_IMAGE_SIDE);
    limits.max_image_height = Some(MAX_IMAGE_SIDE);
    limits
}

/// Whether any pixel of an image shows what is behind it; not if the file can't be decoded.
pub(crate) fn is_transparent(path: &Path) -> bool {
    let decoded = decode(path).ok();
    let alpha = decoded.and_then(|image| image.alpha());
    alpha.is_some_and(|alpha| alpha.iter().any(|&alpha| alpha < 1.0))
}

/// Decodes an image file completely, as it is stored.
pub(crate) fn decode(path: &Path) -> Result<ImageData, Error> {
    decode_any(path).map(eight_bit)
}

/// Decodes an image file and turns it upright.
pub(crate) fn decode_upright(path: &Path) -> Result<ImageData, Error> {
    let mut decoded = decode_any(path)?;
    decoded.apply_orientation(orientation(path));
    Ok(eight_bit(decoded))
}

fn eight_bit(decoded: DynamicImage) -> ImageData {
    let (width, height) = (decoded.width() as usize, decoded.height() as usize);
    if decoded.color().has_alpha() {
        let pixels = decoded.into_rgba8().into_raw();
        ImageData {
            width,
            height,
            channels: RGBA,
            pixels,
            counted: None,
        }
    } else {
        ImageData::from_rgb(width, height, decoded.into_rgb8().into_raw())
    }
}

pub(super) fn decode_any(path: &Path) -> Result<DynamicImage, Error> {
    let bytes = fs::read(path).map_err(Error::access(path))?;
    refuse_pointer(path, &bytes, "an image")?;
    let mut reader = ImageReader::new(Cursor::new(&bytes))
        .with_guessed_format()
        .map_err(Error::access(path))?;
    // The content decides, not the name; other decoders of the image crate stay unused.
    let Some(format @ (ImageFormat::Png | ImageFormat::Jpeg)) = reader.format() else {
        return Err(Error::image_decode(path, "it is neither PNG nor JPEG"));
    };
    if !can_hold_its_pixels(&bytes, format) {
        return Err(Error::image_decode(
            path,
            "its header announces more pixels than a file of its size can hold",
        ));
    }
    if format == ImageFormat::Jpeg && !jpeg_is_complete(&bytes) {
        return Err(Error::image_decode(
            path,
            "the file ends before the image does (truncated)",
        ));
    }
    reader.limits(limits());
    reader.decode().map_err(|e| Error::image_decode(path, e))
}

/// Whether a JPEG's segments reach the end-of-image marker. The decoder fills what is missing of a
/// truncated file with gray and says nothing, which would train the scene towards gray.
fn jpeg_is_complete(bytes: &[u8]) -> bool {
    const END_OF_IMAGE: u8 = 0xD9;
    let mut at = 2;
    loop {
        let Some(marker) = next_marker(bytes, at) else {
            return false;
        };
        let code = bytes[marker + 1];
        at = marker + 2;
        // Restart markers, TEM and a repeated start of image carry no length.
        if code == END_OF_IMAGE {
            return true;
        } else if !matches!(code, 0x01 | 0xD0..=0xD8) {
            let Some(&[high, low]) = bytes.get(at..at + 2) else {
                return false;
            };
            at += usize::from(u16::from_be_bytes([high, low]));
        }
    }
}

/// The position of the next 0xFF that is followed by a marker code.
fn next_marker(bytes: &[u8], from: usize) -> Option<usize> {
    let rest = bytes.get(from..)?;
    let found = rest
        .windows(2)
        .position(|w| w[0] == 0xFF && !matches!(w[1], 0x00 | 0xFF))?;
    Some(from + found)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn encoded(format: ImageFormat) -> Vec<u8> {
        let image = image::RgbImage::from_fn(40, 24, |x, y| {
            image::Rgb([(x * 6) as u8, (y * 10) as u8, (x * y % 251) as u8])
        });
        let mut bytes = Vec::new();
        image
            .write_to(&mut Cursor::new(&mut bytes), format)
            .expect("encodes");
        bytes
    }

    #[test]
    fn truncated_images_are_errors_that_name_the_file() {
        let folder = tempfile::tempdir().expect("temporary folder");
        for (format, name) in [(ImageFormat::Png, "a.png"), (ImageFormat::Jpeg, "a.jpg")] {
            let path = folder.path().join(name);
            let bytes = encoded(format);
            fs::write(&path, &bytes).expect("writes");
            assert_eq!(decode(&path).expect("whole").width, 40);
            // The PNG's last 12 bytes are its empty end chunk.
            let end_of_pixels = if format == ImageFormat::Png {
                bytes.len() - 12
            } else {
                bytes.len()
            };
            for end in 0..end_of_pixels {
                fs::write(&path, &bytes[..end]).expect("writes");
                let error = decode(&path).expect_err("truncated").to_string();
                assert!(error.contains(name), "{error}");
            }
        }
    }

    #[test]
    fn a_header_that_claims_a_huge_image_is_refused() {
        let folder = tempfile::tempdir().expect("temporary folder");
        let path = folder.path().join("bomb.png");
        let mut bytes = encoded(ImageFormat::Png);
        // IHDR: width and height at 16..24, then the checksum over the chunk.
        bytes[16..24].copy_from_slice(&[0x7f, 0xff, 0xff, 0xff, 0x7f, 0xff, 0xff, 0xff]);
        fs::write(&path, &bytes).expect("writes");
        assert!(decode(&path).is_err());
    }
}
