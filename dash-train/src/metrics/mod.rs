//! Image quality against the ground truth, and the accuracy of the static/dynamic decomposition.
//!
//! Everything here is a function on slices: images are `[H, W, 3]`, rows first, sRGB values in
//! [0, 1]; masks and alpha are `[H, W]`. Sums are kept in f64 and in an order that does not depend
//! on the number of threads. A NaN in an image gives a NaN score, never a good one.
//!
//! # Map
//! - this file: PSNR over all pixels and over a mask.
//! - `exposure`: a picture with the exposure of another.
//! - `similarity`: SSIM and MS-SSIM.
//! - `moving`: the moving pixels in the video of a static camera.
//! - `decomposition`: the dynamic set's alpha against the moving pixels.
//! - `lpips`: distances between a network's features, on a device and with weights from files.

mod decomposition;
mod exposure;
pub mod lpips;
mod moving;
mod similarity;

pub use decomposition::{
    DECOMPOSITION_RULE, DYNAMIC_ALPHA_THRESHOLD, DecompositionCounts, decomposition_counts,
};
pub use exposure::{CORRECTION_RULE, corrected};
pub use moving::{MOVING_PIXELS_RULE, MOVING_THRESHOLD, moving_pixels};
pub(crate) use moving::{moving_pixels_by_bands, n_bands};
pub use similarity::{MS_SSIM_RULE, SSIM_RULE, ms_ssim, ms_ssim_scales, ssim};

use rayon::prelude::*;

/// Values per pixel.
const CHANNELS: usize = 3;
/// PSNR of identical images, and the most that any pair can score.
pub const MAX_PSNR: f64 = 100.0;
/// How PSNR is taken, for `metric_settings`.
pub const PSNR_RULE: &str = "peak 1, mean squared error over all pixels that count (all, without a picture in masks/) and \
     channels, at most 100 dB; in SSIM those that don't are black in both pictures; \
     the mean over views is the mean of their decibels";
/// Values summed by one task; fixed, so that sums don't depend on the number of threads.
const SUM_CHUNK: usize = 1 << 14;

/// Peak signal-to-noise ratio of two images, for a peak of 1.
///
/// # Shapes
/// `a, b` of one size `[H, W, 3]`.
///
/// # Units
/// Decibels, at most [`MAX_PSNR`], which is the score of identical images.
///
/// # Panics
/// When the images are empty or differ in size.
///
/// ```
/// use dash_train::metrics::psnr;
///
/// // Every value is off by a tenth.
/// assert!((psnr(&[0.5; 12], &[0.6; 12]) - 20.0).abs() < 1e-3);
/// ```
pub fn psnr(a: &[f32], b: &[f32]) -> f64 {
    assert_eq!(a.len(), b.len(), "psnr: the images differ in size");
    assert!(!a.is_empty(), "psnr: the images are empty");
    let sums: Vec<f64> = a
        .par_chunks(SUM_CHUNK)
        .zip(b.par_chunks(SUM_CHUNK))
        .map(|(a, b)| a.iter().zip(b).map(|(a, b)| squared_error(*a, *b)).sum())
        .collect();
    decibels(sums.iter().sum::<f64>() / a.len() as f64)
}

/// [`psnr`] over the pixels that `mask` marks; `None` when it marks none.
///
/// # Shapes
/// `a, b [H, W, 3], mask [H, W]`.
///
/// # Panics
/// When the sizes don't fit.
pub fn masked_psnr(a: &[f32], b: &[f32], mask: &[bool]) -> Option<f64> {
    assert_eq!(a.len(), b.len(), "masked_psnr: the images differ in size");
    assert_eq!(
        a.len(),
        mask.len() * CHANNELS,
        "masked_psnr: the mask's size is not the images'"
    );
    let sums: Vec<(f64, usize)> = mask
        .par_chunks(SUM_CHUNK)
        .zip(a.par_chunks(SUM_CHUNK * CHANNELS))
        .zip(b.par_chunks(SUM_CHUNK * CHANNELS))
        .map(|((mask, a), b)| {
            let mut sum = (0.0, 0);
            for (pixel, _) in mask.iter().enumerate().filter(|(_, marked)| **marked) {
                for value in pixel * CHANNELS..(pixel + 1) * CHANNELS {
                    sum.0 += squared_error(a[value], b[value]);
                }
                sum.1 += CHANNELS;
            }
            sum
        })
        .collect();
    let n_values: usize = sums.iter().map(|(_, n)| n).sum();
    (n_values > 0).then(|| decibels(sums.iter().map(|(sum, _)| sum).sum::<f64>() / n_values as f64))
}

fn squared_error(a: f32, b: f32) -> f64 {
    let difference = f64::from(a) - f64::from(b);
    difference * difference
}

fn decibels(mean_squared_error: f64) -> f64 {
    let psnr = -10.0 * mean_squared_error.log10();
    // `f64::min` would turn NaN into the best score.
    if psnr > MAX_PSNR { MAX_PSNR } else { psnr }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_uniform_error_of_a_tenth_is_twenty_decibels() {
        let (a, b) = (vec![0.5_f32; 12], vec![0.6_f32; 12]);
        assert!((psnr(&a, &b) - 20.0).abs() < 1e-5, "{}", psnr(&a, &b));
        assert_eq!(psnr(&a, &b), psnr(&b, &a));
    }

    #[test]
    fn one_wrong_value_of_three() {
        // Mean squared error 0.25 / 3: 10 log10(12) dB.
        let got = psnr(&[0.0, 0.5, 1.0], &[0.0, 1.0, 1.0]);
        assert!((got - 10.791812460476248).abs() < 1e-12, "{got}");
    }

    #[test]
    fn identical_and_nearly_identical_images_are_capped_and_nan_is_not() {
        let a = vec![0.25_f32; 30];
        assert_eq!(psnr(&a, &a), MAX_PSNR);
        assert_eq!(psnr(&[0.0; 3], &[1e-6; 3]), MAX_PSNR);
        assert!((psnr(&[0.0; 3], &[1e-4; 3]) - 80.0).abs() < 1e-5);
        assert!(psnr(&[f32::NAN, 0.0, 0.0], &[0.0; 3]).is_nan());
        assert!(masked_psnr(&[f32::NAN, 0.0, 0.0], &[0.0; 3], &[true]).is_some_and(f64::is_nan));
        assert_eq!(psnr(&[0.0; 3], &[f32::INFINITY; 3]), f64::NEG_INFINITY);
    }

    #[test]
    fn the_mask_chooses_the_pixels() {
        let (a, mut b) = (vec![0.0_f32; 6], vec![0.0_f32; 6]);
        b[3..].fill(0.1);
        assert_eq!(masked_psnr(&a, &b, &[true, false]), Some(MAX_PSNR));
        let second = masked_psnr(&a, &b, &[false, true]).expect("one pixel");
        assert!((second - 20.0).abs() < 1e-5, "{second}");
        assert_eq!(masked_psnr(&a, &b, &[false, false]), None);
        assert_eq!(masked_psnr(&a, &b, &[true, true]), Some(psnr(&a, &b)));
    }

    #[test]
    fn chunks_cover_an_image_larger_than_one_of_them() {
        let n_pixels = SUM_CHUNK + 7;
        let a = vec![0.0_f32; n_pixels * CHANNELS];
        let mut b = a.clone();
        b[n_pixels * CHANNELS - 1] = 1.0;
        let expected = 10.0 * ((n_pixels * CHANNELS) as f64).log10();
        assert!((psnr(&a, &b) - expected).abs() < 1e-12);
        let masked = masked_psnr(&a, &b, &vec![true; n_pixels]).expect("all pixels");
        assert!((masked - expected).abs() < 1e-12);
    }

    #[test]
    #[should_panic(expected = "differ in size")]
    fn sizes_must_agree() {
        psnr(&[0.0; 3], &[0.0; 6]);
    }
}
