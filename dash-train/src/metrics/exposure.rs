//! A picture with the exposure of another.

use rayon::prelude::*;

use super::{CHANNELS, SUM_CHUNK};

/// How `*_corrected` is taken, for `metric_settings`.
pub const CORRECTION_RULE: &str = "PSNR after one gain and one offset per channel and picture, by least squares against the captured \
     picture over all pixels that count: what is lost beyond exposure and white balance, which nobody knows of a held-out camera";

/// Sums over the pixels that count.
#[derive(Debug, Clone, Copy, Default)]
struct Sums {
    n: f64,
    image: f64,
    truth: f64,
    squared: f64,
    product: f64,
}

impl Sums {
    fn add(mut self, image: f32, truth: f32) -> Self {
        let (x, y) = (f64::from(image), f64::from(truth));
        self.n += 1.0;
        self.image += x;
        self.truth += y;
        self.squared += x * x;
        self.product += x * y;
        self
    }

    fn plus(self, other: &Self) -> Self {
        Self {
            n: self.n + other.n,
            image: self.image + other.image,
            truth: self.truth + other.truth,
            squared: self.squared + other.squared,
            product: self.product + other.product,
        }
    }

    /// Gain and offset of the line through the pairs; an image of one colour has no gain.
    fn line(&self) -> [f64; 2] {
        let (x, y) = (self.image / self.n, self.truth / self.n);
        let variance = self.squared / self.n - x * x;
        let covariance = self.product / self.n - x * y;
        let gain = if variance > f64::EPSILON {
            covariance / variance
        } else {
            1.0
        };
        [gain, y - gain * x]
    }
}

/// `image` with the gain and offset of each channel that bring it nearest to `truth`, clamped to [0, 1].
///
/// # Shapes
/// `image, truth [H, W, 3]`; `counted [H, W]` marks the pixels to fit to, all where it is absent.
///
/// # Panics
/// When the sizes don't fit.
pub fn corrected(image: &[f32], truth: &[f32], counted: Option<&[bool]>) -> Vec<f32> {
    assert_eq!(
        image.len(),
        truth.len(),
        "corrected: the images differ in size"
    );
    if let Some(counted) = counted {
        let pixels = image.len() / CHANNELS;
        assert_eq!(counted.len(), pixels, "corrected: the mask's size");
    }
    let counts = |pixel: usize| counted.is_none_or(|counted| counted[pixel]);
    let sums: Vec<[Sums; CHANNELS]> = image
        .par_chunks(SUM_CHUNK * CHANNELS)
        .zip(truth.par_chunks(SUM_CHUNK * CHANNELS))
        .enumerate()
        .map(|(chunk, (image, truth))| {
            let mut sums = [Sums::default(); CHANNELS];
            let pixels = image.chunks(CHANNELS).zip(truth.chunks(CHANNELS));
            for (k, (image, truth)) in pixels.enumerate() {
                if counts(chunk * SUM_CHUNK + k) {
                    for (sum, (x, y)) in sums.iter_mut().zip(image.iter().zip(truth)) {
                        *sum = sum.add(*x, *y);
                    }
                }
            }
            sums
        })
        .collect();
    let lines: [[f64; 2]; CHANNELS] = std::array::from_fn(|channel| {
        let of_channel = sums.iter().map(|sums| sums[channel]);
        of_channel
            .fold(Sums::default(), |total, sum| total.plus(&sum))
            .line()
    });
    let mut out = image.to_vec();
    for pixel in out.chunks_mut(CHANNELS) {
        for (value, [gain, offset]) in pixel.iter_mut().zip(&lines) {
            *value = (gain * f64::from(*value) + offset).clamp(0.0, 1.0) as f32;
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::metrics::psnr;

    fn ramp(n: usize) -> Vec<f32> {
        (0..n * CHANNELS)
            .map(|k| (k * 7 % 101) as f32 / 202.0)
            .collect()
    }

    #[test]
    fn a_gain_and_an_offset_per_channel_cost_nothing() {
        // More than a chunk.
        let truth = ramp(20_011);
        let image: Vec<f32> = truth
            .iter()
            .enumerate()
            .map(|(k, v)| [0.8, 1.1, 0.9][k % CHANNELS] * v + [0.05, 0.0, 0.1][k % CHANNELS])
            .collect();
        assert!(psnr(&image, &truth) < 30.0);
        assert!(psnr(&corrected(&image, &truth, None), &truth) > 90.0);
    }

    #[test]
    fn what_does_not_count_has_no_say_and_is_changed_all_the_same() {
        let truth = ramp(64);
        let mut image: Vec<f32> = truth.iter().map(|v| 0.5 * v).collect();
        let counted: Vec<bool> = (0..64).map(|pixel| pixel >= 8).collect();
        image[..8 * CHANNELS].fill(0.25);
        let found = corrected(&image, &truth, Some(&counted));
        assert!(psnr(&found[8 * CHANNELS..], &truth[8 * CHANNELS..]) > 90.0);
        assert!(found[..8 * CHANNELS].iter().all(|v| (v - 0.5).abs() < 1e-5));
    }

    #[test]
    fn a_picture_of_one_colour_gets_an_offset() {
        let found = corrected(&[0.2; 12], &[0.7; 12], None);
        assert!(found.iter().all(|v| (v - 0.7).abs() < 1e-6), "{found:?}");
    }

    #[test]
    fn nan_stays_nan() {
        let mut image = ramp(4);
        image[0] = f32::NAN;
        assert!(psnr(&corrected(&image, &ramp(4), None), &ramp(4)).is_nan());
    }
}
