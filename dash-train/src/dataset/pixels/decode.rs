//! Images from files: PNG and JPEG, whole and of a sensible size.

use std::collections::HashSet;
use std::fs;
use std::io::Cursor;
use std::path::Path;

use image::metadata::Orientation;
use image::{DynamicImage, ImageDecoder, ImageFormat, ImageReader, Limits, Rgb, RgbImage, Rgba};

use super::image::{ImageData, RGBA};
use super::image_size::can_hold_its_pixels;
use super::scale::is_scaled;
use crate::Error;
use crate::files::{refuse_pointer, refuse_pointer_file};

pub(crate) use crate::video::MAX_IMAGE_SIDE;

/// Brightest value of a mask that holds 0 and 1 instead of black and white.
const YES: u16 = 1;
/// Difference of a pixel's channels from which on it has a colour: more than what a JPEG rounds.
const COLOURED: u8 = 24;
/// Most colours of a mask of labelled objects, black among them.
const MOST_LABELS: usize = 256;

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

/// Decodes the mask of an image of the given size; one of the same shape is scaled to it.
pub(crate) fn decode_mask(path: &Path, full_size: (usize, usize)) -> Result<ImageData, Error> {
    let decoded = decode_any(path)?;
    let has_wide_values = decoded.color().bytes_per_pixel() == 2 * decoded.color().channel_count();
    let alpha = alpha_mask(path, &decoded)?;
    let wide = (has_wide_values && alpha.is_none()).then(|| decoded.to_rgb16());
    let decoded = match alpha {
        Some(alpha) => alpha,
        None => decoded.into_rgb8(),
    };
    let found = (decoded.width() as usize, decoded.height() as usize);
    if found != full_size && !is_scaled(full_size, found) {
        return Err(Error::invalid(
            path,
            format!(
                "a mask shaped like the {}x{} of its image",
                full_size.0, full_size.1
            ),
            format!("{}x{}", found.0, found.1),
            "write the mask again or remove it",
        ));
    }
    let (brightest, white) = match wide {
        Some(wide) => (wide.iter().copied().max(), u16::MAX),
        None => (decoded.iter().copied().max().map(u16::from), u8::MAX.into()),
    };
    if brightest == Some(YES) {
        return Err(Error::invalid(
            path,
            format!("a mask in black and white (0 and {white})"),
            format!("values up to {YES}, which are all black"),
            format!("multiply by {white}"),
        ));
    }
    let mut pixels = decoded.into_raw();
    if has_colours(&pixels) {
        of_labels(path, &mut pixels)?;
    }
    let mask = ImageData::from_rgb(found.0, found.1, pixels);
    Ok(mask.nearest(full_size.0, full_size.1))
}

/// The transparency of a mask as grey values, where it says something that colours don't: cut-outs of one colour.
fn alpha_mask(path: &Path, decoded: &DynamicImage) -> Result<Option<RgbImage>, Error> {
    if !decoded.color().has_alpha() {
        return Ok(None);
    }
    let rgba = decoded.to_rgba8();
    let counts = |value: u8| value > 127;
    let says_the_same = |pixel: &Rgba<u8>| counts(pixel[3]) == counts(pixel[0]);
    let is_opaque = rgba.pixels().all(|pixel| pixel[3] == u8::MAX);
    if is_opaque || rgba.pixels().all(says_the_same) {
        return Ok(None);
    }
    let shown = || rgba.pixels().filter(|pixel| pixel[3] > 0);
    let first = shown().next().map(|pixel| [pixel[0], pixel[1], pixel[2]]);
    if shown().any(|pixel| Some([pixel[0], pixel[1], pixel[2]]) != first) {
        // Grey, and black where it is transparent: the colours say it all.
        let is_plain =
            |pixel: &Rgba<u8>| !has_colours(&pixel.0[..3]) && (pixel[3] > 0 || !counts(pixel[0]));
        if rgba.pixels().all(is_plain) {
            return Ok(None);
        }
        return Err(Error::invalid(
            path,
            "a mask in black and white, or one colour that is transparent where pixels don't count",
            "a picture that is transparent in part",
            "write its transparency as a mask (`ffmpeg -i OLD -vf alphaextract NEW`)",
        ));
    }
    let grey = |x, y| Rgb([rgba.get_pixel(x, y)[3]; 3]);
    Ok(Some(RgbImage::from_fn(rgba.width(), rgba.height(), grey)))
}

/// Whether a mask has colours, by more than a JPEG's rounding.
fn has_colours(rgb: &[u8]) -> bool {
    let is_coloured = |pixel: &[u8]| {
        let brightest = pixel.iter().max().copied().unwrap_or(0);
        let darkest = pixel.iter().min().copied().unwrap_or(0);
        brightest - darkest > COLOURED
    };
    rgb.chunks_exact(3).any(is_coloured)
}

/// Turns a mask of labelled objects, a colour each, white where it is not black.
fn of_labels(path: &Path, rgb: &mut [u8]) -> Result<(), Error> {
    let colours: HashSet<&[u8]> = rgb.chunks_exact(3).collect();
    let n = colours.len();
    if n > MOST_LABELS {
        return Err(Error::invalid(
            path,
            format!("a mask in black and white, or black and at most {MOST_LABELS} flat colours"),
            format!("{n} colours"),
            "write the mask as a PNG in black and white",
        ));
    }
    for pixel in rgb.chunks_exact_mut(3) {
        pixel.fill(if pixel == [0; 3] { 0 } else { u8::MAX });
    }
    Ok(())
}

fn decode_any(path: &Path) -> Result<DynamicImage, Error> {
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

    #[test]
    fn masks_are_thresholded_at_half_coverage_and_checked_for_shape() {
        let folder = tempfile::tempdir().expect("temporary folder");
        let path = folder.path().join("m.png");
        let mask = image::GrayImage::from_fn(4, 2, |x, _| {
            image::Luma([if x == 0 || x > 1 { 255 } else { 0 }])
        });
        mask.save(&path).expect("writes");
        let mask = |width, height, inverted| {
            let whole = decode_mask(&path, (4, 2)).expect("reads");
            whole.resized(width, height).thresholded(inverted)
        };
        assert_eq!(mask(4, 2, false)[..4], [255, 0, 255, 255]);
        assert_eq!(mask(4, 2, true)[..4], [0, 255, 0, 0]);
        assert_eq!(mask(2, 1, false), [255, 255]);
        assert_eq!(mask(1, 1, false), [255]);
        // Of another size: the nearest of their pixels.
        let scaled = |size| decode_mask(&path, size).expect("its shape");
        let white = [255, 255, 0, 0, 255, 255, 255, 255];
        assert_eq!(scaled((8, 4)).thresholded(false)[..8], white);
        assert_eq!(scaled((2, 1)).thresholded(false), [0, 255]);
        let error = decode_mask(&path, (4, 6)).expect_err("another shape");
        let error = error.to_string();
        assert!(error.contains("4x6") && error.contains("4x2"), "{error}");
    }

    #[test]
    fn masks_may_be_cut_outs_or_labels() {
        let folder = tempfile::tempdir().expect("temporary folder");
        let path = folder.path().join("m.png");
        let mask = |pixels: [[u8; 4]; 4]| {
            let image = image::RgbaImage::from_fn(4, 1, |x, _| Rgba(pixels[x as usize]));
            image.save(&path).expect("writes");
            decode_mask(&path, (4, 1)).map(|mask| mask.thresholded(false))
        };
        let (white, clear) = ([255; 4], [255, 255, 255, 0]);
        let black = [0, 0, 0, 255];
        let half = mask([white, clear, clear, white]).expect("one colour");
        assert_eq!(half, [255, 0, 0, 255]);
        let both = mask([white, [0; 4], black, white])
            .expect("colour and transparency agree, but for black");
        assert_eq!(both, [255, 0, 0, 255]);
        let dark = mask([black, [0; 4], [0; 4], black]).expect("one colour");
        assert_eq!(dark, [255, 0, 0, 255]);
        let labels = mask([[128, 0, 0, 255], [0, 128, 0, 255], black, [0, 0, 64, 255]]);
        assert_eq!(labels.expect("objects"), [255, 255, 0, 255]);
        let cut_out = mask([[90, 40, 20, 255], [10, 80, 30, 255], clear, clear]);
        let error = cut_out.expect_err("a picture").to_string();
        assert!(
            error.contains("m.png") && error.contains("alphaextract"),
            "{error}"
        );
        let photo = image::RgbImage::from_fn(32, 32, |x, y| Rgb([8 * x as u8, 8 * y as u8, 99]));
        photo.save(&path).expect("writes");
        let error = decode_mask(&path, (32, 32))
            .expect_err("a picture")
            .to_string();
        assert!(error.contains("1024 colours"), "{error}");
    }

    #[test]
    fn masks_of_zeros_and_ones_are_refused_and_black_ones_are_not() {
        let folder = tempfile::tempdir().expect("temporary folder");
        let path = folder.path().join("m.png");
        let write = |one: u8| {
            let mask = image::GrayImage::from_fn(4, 2, |x, _| image::Luma([one * (x % 2) as u8]));
            mask.save(&path).expect("writes");
        };
        write(1);
        let error = decode_mask(&path, (4, 2)).expect_err("labels").to_string();
        for words in [
            "m.png",
            "(0 and 255), found values up to 1",
            "multiply by 255",
        ] {
            assert!(error.contains(words), "{error}");
        }
        let wide = image::ImageBuffer::from_fn(4, 2, |x, _| image::Luma([(x % 2) as u16]));
        wide.save(&path).expect("writes");
        let error = decode_mask(&path, (4, 2)).expect_err("labels").to_string();
        assert!(
            error.contains("(0 and 65535), found values up to 1"),
            "{error}"
        );
        assert!(error.contains("multiply by 65535"), "{error}");
        write(0);
        let black = decode_mask(&path, (4, 2)).expect("reads");
        assert_eq!(black.thresholded(false), [0; 8]);
    }
}
