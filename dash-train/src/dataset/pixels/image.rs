//! Images in memory: resizing by area, compositing. `decode.rs` reads them.

use std::fmt;
use std::ops::Range;

use crate::video::VideoFrame;

pub(crate) const RGB: usize = 3;
pub(crate) const RGBA: usize = 4;

/// An 8-bit image, RGB or RGBA with straight (not premultiplied) alpha, row by row.
#[derive(Clone, PartialEq, Eq)]
pub(crate) struct ImageData {
    pub(crate) width: usize,
    pub(crate) height: usize,
    pub(crate) channels: usize,
    pub(crate) pixels: Vec<u8>,
    /// For each pixel 255 where it counts, else 0; `None` where all do.
    pub(crate) counted: Option<Vec<u8>>,
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

impl From<VideoFrame> for ImageData {
    fn from(frame: VideoFrame) -> Self {
        Self::from_rgb(frame.width, frame.height, frame.rgb)
    }
}

impl ImageData {
    /// An RGB image.
    pub(crate) fn from_rgb(width: usize, height: usize, pixels: Vec<u8>) -> Self {
        debug_assert_eq!(pixels.len(), width * height * RGB);
        Self {
            width,
            height,
            channels: RGB,
            pixels,
            counted: None,
        }
    }

    pub(crate) fn has_alpha(&self) -> bool {
        self.channels == RGBA
    }

    /// Whether a pixel is transparent, in part at least.
    pub(crate) fn is_transparent(&self) -> bool {
        self.has_alpha() && self.pixels.chunks_exact(RGBA).any(|p| p[RGB] < u8::MAX)
    }

    /// The colours alone.
    pub(crate) fn without_alpha(self) -> Self {
        if !self.has_alpha() {
            return self;
        }
        let pixels = self.pixels.chunks_exact(RGBA);
        let pixels = pixels.flat_map(|p| p[..RGB].iter().copied()).collect();
        Self {
            channels: RGB,
            pixels,
            ..self
        }
    }

    /// `[H, W, 3]` in [0, 1], over `background`.
    pub(crate) fn rgb(&self, background: [f32; 3]) -> Vec<f32> {
        self.rgb_rows(background, 0..self.height)
    }

    /// Some rows of [`rgb`](Self::rgb).
    pub(crate) fn rgb_rows(&self, background: [f32; 3], rows: Range<usize>) -> Vec<f32> {
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
    pub(crate) fn alpha(&self) -> Option<Vec<f32>> {
        self.has_alpha().then(|| {
            self.pixels
                .chunks_exact(RGBA)
                .map(|p| f32::from(p[RGB]) / 255.0)
                .collect()
        })
    }

    /// The colour channels weighted by alpha, and alpha, of one pixel, in [0, 255].
    pub(crate) fn premultiplied(&self, x: usize, y: usize) -> [f32; RGBA] {
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
    pub(crate) fn push_premultiplied(&mut self, value: [f32; RGBA]) {
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
    pub(crate) fn empty_like(&self, width: usize, height: usize) -> Self {
        Self {
            width,
            height,
            channels: self.channels,
            pixels: Vec::with_capacity(width * height * self.channels),
            counted: None,
        }
    }

    /// The image at a smaller size: each pixel is the mean of the area it covers.
    pub(crate) fn resized(self, width: usize, height: usize) -> Self {
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

    /// The image at another size: each pixel is the one that lies under its centre.
    pub(crate) fn nearest(self, width: usize, height: usize) -> Self {
        if (width, height) == (self.width, self.height) {
            return self;
        }
        let under = |at: usize, from: usize, to: usize| (2 * at + 1) * from / (2 * to);
        let mut out = self.empty_like(width, height);
        for y in 0..height {
            let row = under(y, self.height, height) * self.width;
            for x in 0..width {
                let at = (row + under(x, self.width, width)) * self.channels;
                let pixel = &self.pixels[at..at + self.channels];
                out.pixels.extend_from_slice(pixel);
            }
        }
        out
    }

    /// 255 where the first channel is at least half (with `inverted`, less than half), else 0.
    pub(crate) fn thresholded(&self, inverted: bool) -> Vec<u8> {
        self.pixels
            .chunks_exact(self.channels)
            .map(|p| if (p[0] > 127) != inverted { 255 } else { 0 })
            .collect()
    }
}

pub(crate) fn accumulate(sum: &mut [f32; RGBA], value: [f32; RGBA], weight: f32) {
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

#[cfg(test)]
mod tests {
    use super::*;

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
    fn the_nearest_pixel_is_the_one_under_the_centre() {
        let rgb = |shades: &[u8]| -> Vec<u8> {
            let pixels = shades.iter().flat_map(|&shade| [shade; 3]);
            pixels.collect()
        };
        let image = ImageData::from_rgb(3, 1, rgb(&[1, 2, 3]));
        let at = |width, height| image.clone().nearest(width, height).pixels;
        assert_eq!(at(6, 2), rgb(&[1, 1, 2, 2, 3, 3]).repeat(2));
        assert_eq!(at(1, 1), rgb(&[2]));
        assert_eq!(at(3, 1), image.pixels);
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
}
