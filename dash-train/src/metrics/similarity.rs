//! Structural similarity, at one scale and at several.

use rayon::prelude::*;

use super::CHANNELS;

/// Side of the Gaussian window.
const WINDOW: usize = 11;
/// Standard deviation of the window, in pixels.
const SIGMA_PX: f64 = 1.5;
/// (0.01 x range)^2, which stabilises the luminance term.
const C1: f64 = 0.01 * 0.01;
/// (0.03 x range)^2, which stabilises the contrast and structure term.
const C2: f64 = 0.03 * 0.03;
/// Exponents of the scales, finest first.
///
/// # Source
/// Wang, Simoncelli and Bovik, "Multiscale structural similarity", 2003.
const SCALE_WEIGHTS: [f64; 5] = [0.0448, 0.2856, 0.3001, 0.2363, 0.1333];
/// How SSIM is taken, for `metric_settings`.
pub const SSIM_RULE: &str = "11x11 Gaussian window of sigma 1.5 px, zero padding of 5 px, C1 = 0.01^2, C2 = 0.03^2, mean over \
     pixels and channels (as the 3DGS evaluation)";
/// How MS-SSIM is taken, for `metric_settings`.
pub const MS_SSIM_RULE: &str = "5 scales with the weights of Wang et al. 2003, 11x11 Gaussian window of sigma 1.5 px at the \
     positions where it fits, 2x2 means between scales (at odd edges of the pixels that exist), negative terms count as 0, mean over \
     channels; images with a side below 161 px use as many scales as the window fits, weights \
     renormalised, and below 11 px the zero-padded window";

/// Mean structural similarity of two images, in [-1, 1].
///
/// The Gaussian window is 11x11 with a standard deviation of 1.5 pixels; beyond the border are
/// zeros, as in the evaluation of 3DGS.
///
/// # Shapes
/// `a, b [H, W, 3]`.
///
/// # Panics
/// When the images are empty or their sizes are not `width x height`.
///
/// ```
/// use dash_train::metrics::ssim;
///
/// let stripes: Vec<f32> = (0..16 * 16 * 3).map(|k| (k % 7) as f32 / 6.0).collect();
/// assert!((ssim(&stripes, &stripes, 16, 16) - 1.0).abs() < 1e-6);
/// assert!(ssim(&stripes, &[0.5; 16 * 16 * 3], 16, 16) < 0.5);
/// ```
pub fn ssim(a: &[f32], b: &[f32], width: usize, height: usize) -> f64 {
    check_sizes("ssim", a, b, width, height);
    let means: Vec<f64> = (0..CHANNELS)
        .map(|channel| {
            let (a, b) = (plane(a, channel), plane(b, channel));
            similarity(&a, &b, [width, height], Border::Zeros).full
        })
        .collect();
    means.iter().sum::<f64>() / CHANNELS as f64
}

/// Structural similarity over several scales, in [0, 1].
///
/// The product over scales of the mean contrast-structure term (at the coarsest scale: of the whole
/// similarity), each to its weight, per channel; negative terms count as zero. The window is used
/// where it fits. Between scales 2x2 pixels are averaged, at odd edges those that exist. Images too
/// small for five scales (a side below 161 pixels) use [`ms_ssim_scales`] of them with weights that
/// sum to 1 again; with a side below 11 pixels it is [`ssim`], not below zero.
///
/// # Shapes
/// `a, b [H, W, 3]`.
///
/// # Panics
/// When the images are empty or their sizes are not `width x height`.
///
/// # Source
/// Wang, Simoncelli and Bovik 2003; the window's positions and the order of the means are those of
/// `pytorch-msssim` and `tf.image.ssim_multiscale`.
pub fn ms_ssim(a: &[f32], b: &[f32], width: usize, height: usize) -> f64 {
    check_sizes("ms_ssim", a, b, width, height);
    let n_scales = ms_ssim_scales(width, height);
    let border = if width.min(height) < WINDOW {
        Border::Zeros
    } else {
        Border::Excluded
    };
    // All five sum to 1.0001 and are used as published.
    let total_weight: f64 = match n_scales {
        n if n == SCALE_WEIGHTS.len() => 1.0,
        n => SCALE_WEIGHTS[..n].iter().sum(),
    };
    let products: Vec<f64> = (0..CHANNELS)
        .map(|channel| {
            let (mut a, mut b) = (plane(a, channel), plane(b, channel));
            let mut size = [width, height];
            let mut product = 1.0;
            for (scale, weight) in SCALE_WEIGHTS[..n_scales].iter().enumerate() {
                let means = similarity(&a, &b, size, border);
                let is_coarsest = scale + 1 == n_scales;
                let term = if is_coarsest {
                    means.full
                } else {
                    means.contrast
                };
                product *= without_negatives(term).powf(weight / total_weight);
                if !is_coarsest {
                    (a, _) = halved(&a, size);
                    (b, size) = halved(&b, size);
                }
            }
            product
        })
        .collect();
    products.iter().sum::<f64>() / CHANNELS as f64
}

/// The number of scales that [`ms_ssim`] uses for images of this size: 1 to 5.
pub fn ms_ssim_scales(width: usize, height: usize) -> usize {
    let mut side = width.min(height);
    let mut n_scales = 1;
    while n_scales < SCALE_WEIGHTS.len() && side.div_ceil(2) >= WINDOW {
        side = side.div_ceil(2);
        n_scales += 1;
    }
    n_scales
}

fn check_sizes(op: &str, a: &[f32], b: &[f32], width: usize, height: usize) {
    let n_values = width * height * CHANNELS;
    assert!(n_values > 0, "{op}: the images are empty");
    assert!(
        a.len() == n_values && b.len() == n_values,
        "{op}: expected {width} x {height} x {CHANNELS} values, found {} and {}",
        a.len(),
        b.len()
    );
}

/// Zero for negative values; NaN stays, which `f64::max` would hide.
fn without_negatives(value: f64) -> f64 {
    if value < 0.0 { 0.0 } else { value }
}

fn plane(image: &[f32], channel: usize) -> Vec<f64> {
    image
        .chunks_exact(CHANNELS)
        .map(|pixel| f64::from(pixel[channel]))
        .collect()
}

/// What the window sees beyond the image.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Border {
    /// Zeros; there is a window on every pixel.
    Zeros,
    /// Nothing; only windows that lie within the image count.
    Excluded,
}

/// Means over the window's positions.
struct Similarity {
    /// Luminance, contrast and structure.
    full: f64,
    /// Contrast and structure.
    contrast: f64,
}

fn similarity(a: &[f64], b: &[f64], size: [usize; 2], border: Border) -> Similarity {
    let product = |x: &[f64], y: &[f64]| x.iter().zip(y).map(|(x, y)| x * y).collect::<Vec<_>>();
    let mean_a = windowed(a, size, border);
    let mean_b = windowed(b, size, border);
    let square_a = windowed(&product(a, a), size, border);
    let square_b = windowed(&product(b, b), size, border);
    let cross = windowed(&product(a, b), size, border);
    let (mut full, mut contrast) = (0.0, 0.0);
    for i in 0..mean_a.len() {
        let (mu_a, mu_b) = (mean_a[i], mean_b[i]);
        // Rounding can make the variance of a constant negative.
        let var_a = (square_a[i] - mu_a * mu_a).max(0.0);
        let var_b = (square_b[i] - mu_b * mu_b).max(0.0);
        let covariance = cross[i] - mu_a * mu_b;
        let structure = ((2.0 * covariance + C2) / (var_a + var_b + C2)).clamp(-1.0, 1.0);
        let luminance = (2.0 * mu_a * mu_b + C1) / (mu_a * mu_a + mu_b * mu_b + C1);
        full += (luminance * structure).clamp(-1.0, 1.0);
        contrast += structure;
    }
    let n = mean_a.len() as f64;
    Similarity {
        full: full / n,
        contrast: contrast / n,
    }
}

/// The separable window's weights, which sum to 1.
fn window() -> [f64; WINDOW] {
    let mut weights = [0.0; WINDOW];
    for (i, weight) in weights.iter_mut().enumerate() {
        let x = i as f64 - (WINDOW / 2) as f64;
        *weight = (-x * x / (2.0 * SIGMA_PX * SIGMA_PX)).exp();
    }
    let sum: f64 = weights.iter().sum();
    weights.map(|weight| weight / sum)
}

/// The plane's mean under the window at every position that `border` allows, rows first.
fn windowed(plane: &[f64], [width, height]: [usize; 2], border: Border) -> Vec<f64> {
    let weights = window();
    let (pad, out_width, out_height) = match border {
        Border::Zeros => (WINDOW / 2, width, height),
        Border::Excluded => (0, width + 1 - WINDOW, height + 1 - WINDOW),
    };
    let mut across = vec![0.0; out_width * height];
    across
        .par_chunks_mut(out_width)
        .zip(plane.par_chunks(width))
        .for_each(|(out, row)| {
            let mut padded = vec![0.0; width + 2 * pad];
            padded[pad..pad + width].copy_from_slice(row);
            for (out, values) in out.iter_mut().zip(padded.windows(WINDOW)) {
                *out = values.iter().zip(&weights).map(|(v, w)| v * w).sum();
            }
        });
    let mut out = vec![0.0; out_width * out_height];
    out.par_chunks_mut(out_width)
        .enumerate()
        .for_each(|(y, out)| {
            for (tap, weight) in weights.iter().enumerate() {
                let Some(row) = (y + tap).checked_sub(pad).filter(|row| *row < height) else {
                    continue;
                };
                for (out, v) in out.iter_mut().zip(&across[row * out_width..]) {
                    *out += weight * v;
                }
            }
        });
    out
}

/// Means over 2x2 pixels, at odd edges over those that exist, and the new size.
fn halved(plane: &[f64], [width, height]: [usize; 2]) -> (Vec<f64>, [usize; 2]) {
    let size = [width.div_ceil(2), height.div_ceil(2)];
    let mut out = Vec::with_capacity(size[0] * size[1]);
    for y in 0..size[1] {
        for x in 0..size[0] {
            let (right, below) = ((2 * x + 1).min(width - 1), (2 * y + 1).min(height - 1));
            let at = |x: usize, y: usize| plane[y * width + x];
            out.push(
                (at(2 * x, 2 * y) + at(right, 2 * y) + at(2 * x, below) + at(right, below)) / 4.0,
            );
        }
    }
    (out, size)
}

#[cfg(test)]
mod tests;
