//! Masks from files: black and white, labels in colours, cut-outs.

use std::collections::{BTreeSet, HashSet};
use std::path::Path;

use image::{DynamicImage, Rgb, RgbImage, Rgba};

use super::decode::decode_any;
use super::image::{ImageData, RGB};
use super::scale::is_scaled;
use crate::Error;
use crate::files::has_extension;

/// Brightest value of a mask that holds 0 and 1 instead of black and white.
const YES: u16 = 1;
/// Difference of a pixel's channels from which on it has a colour: more than what a JPEG rounds.
const COLOURED: u8 = 24;
/// Most colours of a mask of labelled objects, black among them.
const MOST_LABELS: usize = 256;
/// Most grey values of such a mask. A soft border has more.
const MOST_GREYS: usize = 16;
/// Most of a mask's values that a soft border alone leaves in the picture.
const MOST_BORDER: f64 = 0.01;
/// Extensions of files in which black is not quite black.
const LOSSY: [&str; 2] = ["jpg", "jpeg"];

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
    let (values, white) = match wide {
        Some(wide) => (wide.into_raw(), u16::MAX),
        None => (
            decoded.iter().map(|&v| u16::from(v)).collect(),
            u8::MAX.into(),
        ),
    };
    let brightest = values.iter().copied().max();
    if brightest == Some(YES) {
        return Err(Error::invalid(
            path,
            format!("a mask in black and white (0 and {white})"),
            format!("values up to {YES}, which are all black"),
            format!("multiply by {white}"),
        ));
    }
    if let Some(found) = brightest.filter(|_| is_dark(path, &values, white)) {
        return Err(Error::invalid(
            path,
            format!("a mask in black and white (0 and {white})"),
            format!("values up to {found}, which all count as black"),
            "make what counts white",
        ));
    }
    let mut pixels = decoded.into_raw();
    if has_colours(&pixels) {
        of_labels(path, &mut pixels)?;
    } else if let Some(labels) = grey_labels(path, &pixels) {
        return Err(Error::invalid(
            path,
            "a mask in black and white (0 and 255)",
            format!("labels: the grey values {labels}"),
            "make what counts white, and the rest black",
        ));
    }
    let mask = ImageData::from_rgb(found.0, found.1, pixels);
    Ok(mask.nearest(full_size.0, full_size.1))
}

fn is_lossy(path: &Path) -> bool {
    has_extension(&path.to_string_lossy(), &LOSSY)
}

/// Whether a mask has no white, and more values that are neither black nor white than a soft border has of what has nearly left
/// the picture. JPEG turns black into values close to it.
fn is_dark(path: &Path, values: &[u16], white: u16) -> bool {
    let black = if is_lossy(path) { white / 16 } else { 0 };
    let n_gray = values.iter().filter(|&&value| value > black).count();
    let has_white = values.iter().any(|&value| value > white / 2);
    !has_white && n_gray as f64 > MOST_BORDER * values.len() as f64
}

/// The grey values of a mask of labels: a few, some of which would count and some not, and none of which is white.
fn grey_labels(path: &Path, rgb: &[u8]) -> Option<String> {
    let grey = rgb.iter().step_by(RGB).copied();
    let values: BTreeSet<u8> = grey.take_while(|&value| value < u8::MAX).collect();
    let has_white = rgb.contains(&u8::MAX);
    let is_few = (3..=MOST_GREYS).contains(&values.len());
    let differ = values.iter().any(|&v| v > 0 && v <= 127) && values.iter().any(|&v| v > 127);
    let is_labels = is_few && differ && !has_white && !is_lossy(path);
    is_labels.then(|| {
        let shown: Vec<String> = values.iter().take(4).map(u8::to_string).collect();
        let more = if values.len() > 4 { ", .." } else { "" };
        format!("{}{more}", shown.join(", "))
    })
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

#[cfg(test)]
mod tests {
    use super::*;

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
