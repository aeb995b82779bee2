//! The similarity at a pixel from the window's moments there, for the CPU.

use super::window::{C1, C2};

/// The factors of the similarity at a pixel.
pub(crate) struct Terms {
    mean_x: f64,
    mean_y: f64,
    variance: f64,
    luminance: f64,
    contrast: f64,
    luminance_norm: f64,
    contrast_norm: f64,
}

impl Terms {
    #[inline(always)]
    pub(crate) fn new(mean_x: f64, mean_y: f64, squares: f64, product: f64) -> Self {
        let mean_squares = mean_x * mean_x + mean_y * mean_y;
        let mean_product = mean_x * mean_y;
        let variance = squares - mean_squares;
        Self {
            mean_x,
            mean_y,
            variance,
            luminance: 2.0 * mean_product + C1,
            contrast: 2.0 * (product - mean_product) + C2,
            luminance_norm: mean_squares + C1,
            contrast_norm: variance.max(0.0) + C2,
        }
    }

    #[inline(always)]
    pub(super) fn similarity(&self) -> f64 {
        // Two ratios rather than one of products: those of values near f32::MAX overflow.
        (self.luminance / self.luminance_norm) * (self.contrast / self.contrast_norm)
    }

    /// Gradients of `mean_x`, `squares` and `product`, and the similarity.
    #[inline(always)]
    pub(crate) fn vjp(&self, v: f64) -> [f64; 4] {
        let per_luminance = 1.0 / self.luminance_norm;
        let per_contrast = 1.0 / self.contrast_norm;
        let luminance_ratio = self.luminance * per_luminance;
        let contrast_ratio = self.contrast * per_contrast;
        let similarity = luminance_ratio * contrast_ratio;
        let v_product = 2.0 * v * luminance_ratio * per_contrast;
        let v_squares = if self.variance > 0.0 {
            -v * similarity * per_contrast
        } else {
            0.0
        };
        let v_mean_x =
            2.0 * v * (self.mean_y * contrast_ratio - self.mean_x * similarity) * per_luminance
                - v_product * self.mean_y
                - 2.0 * self.mean_x * v_squares;
        [v_mean_x, v_squares, v_product, similarity]
    }
}

#[inline(always)]
pub(super) fn finite_or_zero(value: f32) -> f64 {
    if value.is_finite() {
        f64::from(value)
    } else {
        0.0
    }
}
