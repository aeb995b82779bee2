//! Images in memory: decoding, resizing by area, compositing.

use std::fmt;
use std::fs;
use std::io::Cursor;
use std::ops::Range;
use std::path::Path;

use image::{DynamicImage, ImageDecoder, ImageFormat, ImageReader, Limits};

use super::DatasetError;
use super::image_size::can_hold_its_pixels;

/// Largest side of an image that is read.
pub(super) const MAX_IMAGE_SIDE: u32 = 16_384;
const RGB: usize = 3;
const RGBA: usize = 4;

/// An 8-bit image, RGB or RGBA with straight (not premultiplied) alpha, row by row.
#[derive(Clone, PartialEq, Eq)]
pub(crate) struct ImageData {
    pub(super) width: usize,
    pub(super) height: usize,
    pub(super) channels: usize,
    pub(super) pixels: Vec<u8>,
    /// For each pixel 255 where it counts, else 0; `None` where all do.
    pub(super) counted: Option<Vec<u8>>,
}

impl fmt::Debug for ImageData {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "ImageData({}x{}x{})",
            self.width, self.height, self.channels
        )
    }
}

impl ImageData {
    /// An RGB image.
    pub(super) fn from_rgb(width: usize, height: usize, pixels: Vec<u8>) -> Self {
        debug_assert_eq!(pixels.len(), width * height * RGB);
        Self {
            width,
            height,
            channels: RGB,
            pixels,
            counted: None,
        }
    }

    pub(super) fn has_alpha(&self) -> bool {
        self.channels == RGBA
    }

    /// `[H, W, 3]` in [0, 1], over `background`.
    pub(super) fn rgb(&self, background: [f32; 3]) -> Vec<f32> {
        self.rgb_rows(background, 0..self.height)
    }

    /// Some rows of [`rgb`](Self::rgb).
    pub(super) fn rgb_rows(&self, background: [f32; 3], rows: Range<usize>) -> Vec<f32> {
        let line = self.width * self.channels;
        let pixels = &self.pixels[rows.start * line..rows.end * line];
        if !self.has_alpha() {
            return pixels.iter().map(|&v| f32::from(v) / 255.0).collect();
        }
        let mut out = Vec::with_capacity(pixels.len() / RGBA * RGB);
        for pixel in pixels.chunks_exact(RGBA) {
            let alpha = f32::from(pixel[RGB]) / 255.0;
            for (&value, behind) in pixel[..RGB].iter().zip(background) {
                out.push(f32::from(value) / 255.0 * alpha + behind * (1.0 - alpha));
            }
        }
        out
    }

    /// `[H, W]` in [0, 1]; `None` for an image without alpha.
    pub(super) fn alpha(&self) -> Option<Vec<f32>> {
        self.has_alpha().then(|| {
            self.pixels
                .chunks_exact(RGBA)
                .map(|p| f32::from(p[RGB]) / 255.0)
                .collect()
        })
    }

    /// The colour channels weighted by alpha, and alpha, of one pixel, in [0, 255].
    pub(super) fn premultiplied(&self, x: usize, y: usize) -> [f32; RGBA] {
        let at = (y * self.width + x) * self.channels;
        let pixel = &self.pixels[at..at + self.channels];
        let alpha = if self.has_alpha() {
            f32::from(pixel[RGB])
        } else {
            255.0
        };
        let weight = alpha / 255.0;
        [
            f32::from(pixel[0]) * weight,
            f32::from(pixel[1]) * weight,
            f32::from(pixel[2]) * weight,
            alpha,
        ]
    }

    /// Appends one premultiplied pixel in this image's channels.
    pub(super) fn push_premultiplied(&mut self, value: [f32; RGBA]) {
        let weight = if value[RGB] > 0.0 {
            255.0 / value[RGB]
        } else {
            0.0
        };
        let round = |v: f32| (v + 0.5).clamp(0.0, 255.0) as u8;
        self.pixels
            .extend(value[..RGB].iter().map(|v| round(v * weight)));
        if self.has_alpha() {
            self.pixels.push(round(value[RGB]));
        }
    }

    /// An image of these channels with room for `width * height` pixels, none of them set.
    pub(super) fn empty_like(&self, width: usize, height: usize) -> Self {
        Self {
            width,
            height,
            channels: self.channels,
            pixels: Vec::with_capacity(width * height * self.channels),
            counted: None,
        }
    }

    /// The image at a smaller size: each pixel is the mean of the area it covers.
    pub(super) fn resized(self, width: usize, height: usize) -> Self {
        if (width, height) == (self.width, self.height) {
            return self;
        }
        let columns = coverage(self.width, width);
        let rows = coverage(self.height, height);
        let mut out = self.empty_like(width, height);
        let mut line = vec![[0.0f32; RGBA]; self.width];
        for covered_rows in &rows {
            line.fill([0.0; RGBA]);
            for &(y, row_weight) in covered_rows {
                for (x, sum) in line.iter_mut().enumerate() {
                    accumulate(sum, self.premultiplied(x, y), row_weight);
                }
            }
            for covered_columns in &columns {
                let mut value = [0.0; RGBA];
                for &(x, column_weight) in covered_columns {
                    accumulate(&mut value, line[x], column_weight);
                }
                out.push_premultiplied(value);
            }
        }
        out
    }

    /// 255 where the first channel is at least half (with `inverted`, less than half), else 0.
    pub(super) fn thresholded(&self, inverted: bool) -> Vec<u8> {
        self.pixels
            .chunks_exact(self.channels)
            .map(|p| if (p[0] > 127) != inverted { 255 } else { 0 })
            .collect()
    }
}

pub(super) fn accumulate(sum: &mut [f32; RGBA], value: [f32; RGBA], weight: f32) {
    for (s, v) in sum.iter_mut().zip(value) {
        *s += v * weight;
    }
}

/// For each of `to` equal parts of `from` pixels: the pixels it touches and their shares (sum 1).
fn coverage(from: usize, to: usize) -> Vec<Vec<(usize, f32)>> {
    let step = from as f64 / to as f64;
    let part = |index: usize| {
        let (start, end) = (index as f64 * step, (index + 1) as f64 * step);
        let pixels = start as usize..(end.ceil() as usize).min(from);
        pixels
            .map(|pixel| {
                let overlap = end.min(pixel as f64 + 1.0) - start.max(pixel as f64);
                (pixel, (overlap / step) as f32)
            })
            .collect()
    };
    (0..to).map(part).collect()
}

/// An image's width and height from its header.
pub(crate) fn dimensions(path: &Path) -> Result<(usize, usize), DatasetError> {
    let (width, height, _) = header(path)?;
    Ok((width, height))
}

/// An image's width, height and whether it has alpha, from its header.
pub(super) fn header(path: &Path) -> Result<(usize, usize, bool), DatasetError> {
    let mut reader = ImageReader::open(path)
        .and_then(ImageReader::with_guessed_format)
        .map_err(DatasetError::io(path))?;
    reader.limits(limits());
    let decoder = reader
        .into_decoder()
        .map_err(|e| DatasetError::image(path, e))?;
    let (width, height) = decoder.dimensions();
    let has_alpha = decoder.color_type().has_alpha();
    Ok((width as usize, height as usize, has_alpha))
}

fn limits() -> Limits {
    let mut limits = Limits::default();
    limits.max_image_width = Some(MAX_IMAGE_SIDE);
    limits.max_image_height = Some(MAX_IMAGE_SIDE);
    limits
}

/// Decodes an image file completely.
pub(super) fn decode(path: &Path) -> Result<ImageData, DatasetError> {
    let decoded = decode_any(path)?;
    let (width, height) = (decoded.width() as usize, decoded.height() as usize);
    Ok(if decoded.color().has_alpha() {
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
    })
}

/// Decodes a mask of an image of the given size.
pub(super) fn decode_mask(
    path: &Path,
    full_size: (usize, usize),
) -> Result<ImageData, DatasetError> {
    let decoded = decode_any(path)?.into_rgb8();
    let found = (decoded.width() as usize, decoded.height() as usize);
    if found != full_size {
        return Err(DatasetError::invalid(
            path,
            format!("a mask of the image's size {}x{}", full_size.0, full_size.1),
            format!("{}x{}", found.0, found.1),
            "write the mask again or remove it",
        ));
    }
    Ok(ImageData::from_rgb(found.0, found.1, decoded.into_raw()))
}

fn decode_any(path: &Path) -> Result<DynamicImage, DatasetError> {
    let bytes = fs::read(path).map_err(DatasetError::io(path))?;
    let mut reader = ImageReader::new(Cursor::new(&bytes))
        .with_guessed_format()
        .map_err(DatasetError::io(path))?;
    // What the file holds decides, not its name; other decoders of the image crate stay out of reach.
    let Some(format @ (ImageFormat::Png | ImageFormat::Jpeg)) = reader.format() else {
        return Err(DatasetError::image(path, "it is neither PNG nor JPEG"));
    };
    if !can_hold_its_pixels(&bytes, format) {
        return Err(DatasetError::image(
            path,
            "its header announces more pixels than a file of its size can hold",
        ));
    }
    if format == ImageFormat::Jpeg && !jpeg_is_complete(&bytes) {
        return Err(DatasetError::image(
            path,
            "the file ends before the image does (truncated)",
        ));
    }
    reader.limits(limits());
    reader.decode().map_err(|e| DatasetError::image(path, e))
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
    fn halving_averages_four_pixels() {
        let pixels = (0..4 * 2).flat_map(|i| [i * 10, 255 - i, 7]).collect();
        let half = ImageData::from_rgb(4, 2, pixels).resized(2, 1);
        // Pixels 0, 1, 4, 5 and 2, 3, 6, 7.
        assert_eq!(half.pixels, [25, 253, 7, 45, 251, 7]);
    }

    #[test]
    fn fractional_shares_sum_to_one_and_keep_the_mean() {
        for (from, to) in [(5, 3), (1014, 254), (7, 7), (3, 1)] {
            for part in coverage(from, to) {
                let sum: f32 = part.iter().map(|p| p.1).sum();
                assert!((sum - 1.0).abs() < 1e-5, "{from} -> {to}: {sum}");
            }
        }
        // 3 -> 2: (1 * a + 0.5 * b) / 1.5.
        let image = ImageData::from_rgb(
            3,
            1,
            vec![30; 3]
                .into_iter()
                .chain([90; 3])
                .chain([0; 3])
                .collect(),
        );
        assert_eq!(image.resized(2, 1).pixels, [50, 50, 50, 30, 30, 30]);
    }

    #[test]
    fn transparent_pixels_do_not_bleed() {
        let image = ImageData {
            width: 2,
            height: 1,
            channels: 4,
            pixels: vec![200, 100, 50, 255, 9, 9, 9, 0],
            counted: None,
        };
        assert_eq!(image.rgb([1.0, 0.0, 0.5])[3..], [1.0, 0.0, 0.5]);
        let half = image.resized(1, 1);
        assert_eq!(half.pixels, [200, 100, 50, 128]);
        assert_eq!(half.alpha().expect("alpha"), [128.0 / 255.0]);
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
    fn masks_are_thresholded_at_half_coverage_and_checked_for_size() {
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
        assert!(decode_mask(&path, (8, 4)).is_err());
    }
}
