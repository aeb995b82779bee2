//! Structural similarity on the CPU.
//!
//! Bands of rows run in parallel, each streaming through separable blurs. A pixel's arithmetic
//! does not depend on its band, so results are the same for any number of threads. Moments are
//! kept in f64: in f32 `E[x^2] - mean^2` of a constant image is off by more than C2 tolerates.

use std::ops::Range;

use rayon::prelude::*;

use super::blur::Blur;
use super::window::{C1, C2, RADIUS};
use crate::isa::{Kernel, dispatch};

/// Bands per thread, so that a thread that is held up does not hold up the others.
const BANDS_PER_THREAD: usize = 2;
/// Every band also blurs rows above and below it; thinner ones would mostly do that.
const MIN_BAND_ROWS: usize = 4 * RADIUS;

/// `x [H, W, C]`, `y [H, W, C]` -> `[H, W, C]`.
pub fn ssim(x: &[f32], y: &[f32], shape: [usize; 3]) -> Vec<f32> {
    let images = Images { x, y, shape };
    let mut out = vec![0.0; x.len()];
    let rows = band_rows(shape[0]);
    out.par_chunks_mut(rows * images.row_length())
        .enumerate()
        .for_each(|(band, out)| {
            let first_row = band * rows;
            dispatch(ForwardBand {
                images,
                first_row,
                out,
            });
        });
    out
}

/// Gradient of `own` from `v_out`, all `[H, W, C]`; the similarity is symmetric, so the gradient
/// of the other image is had by exchanging the two.
pub fn ssim_vjp(own: &[f32], other: &[f32], v_out: &[f32], shape: [usize; 3]) -> Vec<f32> {
    let images = Images {
        x: own,
        y: other,
        shape,
    };
    let mut v_own = vec![0.0; own.len()];
    let rows = band_rows(shape[0]);
    v_own
        .par_chunks_mut(rows * images.row_length())
        .enumerate()
        .for_each(|(band, v_x)| {
            let first_row = band * rows;
            dispatch(BackwardBand {
                images,
                v_out,
                first_row,
                v_x,
            });
        });
    v_own
}

fn band_rows(height: usize) -> usize {
    height
        .div_ceil(BANDS_PER_THREAD * rayon::current_num_threads())
        .max(MIN_BAND_ROWS)
}

#[derive(Clone, Copy)]
struct Images<'a> {
    x: &'a [f32],
    y: &'a [f32],
    shape: [usize; 3],
}

impl Images<'_> {
    fn row_length(&self) -> usize {
        self.shape[1] * self.shape[2]
    }

    fn row(&self, row: usize) -> Range<usize> {
        row * self.row_length()..(row + 1) * self.row_length()
    }

    fn blur<const M: usize>(&self) -> Blur<M> {
        Blur::new(self.shape[1], self.shape[2])
    }

    /// The image's row, `None` above and below it.
    fn row_in_image(&self, row: isize) -> Option<usize> {
        usize::try_from(row).ok().filter(|&row| row < self.shape[0])
    }

    /// Pushes a row's `x`, `y`, `x^2 + y^2` and `x y`.
    #[inline(always)]
    fn push_moments<'b>(&self, row: isize, blur: &'b mut Blur<4>) -> Option<[&'b [f64]; 4]> {
        let Some(row) = self.row_in_image(row) else {
            return blur.push_zeros();
        };
        let (x, y) = (&self.x[self.row(row)], &self.y[self.row(row)]);
        let [mean_x, mean_y, squares, product] = blur.input();
        let (mean_x, mean_y) = (&mut mean_x[..x.len()], &mut mean_y[..x.len()]);
        let (squares, product) = (&mut squares[..x.len()], &mut product[..x.len()]);
        for i in 0..x.len() {
            let (x, y) = (finite_or_zero(x[i]), finite_or_zero(y[i]));
            mean_x[i] = x;
            mean_y[i] = y;
            squares[i] = x * x + y * y;
            product[i] = x * y;
        }
        blur.push()
    }
}

struct ForwardBand<'a> {
    images: Images<'a>,
    first_row: usize,
    out: &'a mut [f32],
}

impl Kernel for ForwardBand<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let mut blur = self.images.blur();
        let mut row = self.first_row as isize - RADIUS as isize;
        for out in self.out.chunks_mut(self.images.row_length()) {
            loop {
                let moments = self.images.push_moments(row, &mut blur);
                row += 1;
                if let Some([mean_x, mean_y, squares, product]) = moments {
                    for (i, out) in out.iter_mut().enumerate() {
                        let terms = Terms::new(mean_x[i], mean_y[i], squares[i], product[i]);
                        *out = terms.similarity().clamp(-1.0, 1.0) as f32;
                    }
                    break;
                }
            }
        }
    }
}

struct BackwardBand<'a> {
    images: Images<'a>,
    v_out: &'a [f32],
    first_row: usize,
    v_x: &'a mut [f32],
}

impl Kernel for BackwardBand<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let images = self.images;
        let mut moments_blur = images.blur::<4>();
        let mut gradient_blur = images.blur::<3>();
        let mut pushed_row = self.first_row as isize - 2 * RADIUS as isize;
        for (i, v_x) in self.v_x.chunks_mut(images.row_length()).enumerate() {
            let range = images.row(self.first_row + i);
            let (x, y) = (&images.x[range.clone()], &images.y[range]);
            loop {
                let moments = images.push_moments(pushed_row, &mut moments_blur);
                let moments_row = pushed_row - RADIUS as isize;
                pushed_row += 1;
                let Some(moments) = moments else { continue };
                let gradients = match images.row_in_image(moments_row) {
                    Some(row) => {
                        moments_vjp(moments, &self.v_out[images.row(row)], gradient_blur.input());
                        gradient_blur.push()
                    }
                    None => gradient_blur.push_zeros(),
                };
                let Some([v_mean, v_squares, v_product]) = gradients else {
                    continue;
                };
                for (i, v_x) in v_x.iter_mut().enumerate() {
                    let v = v_mean[i]
                        + 2.0 * f64::from(x[i]) * v_squares[i]
                        + finite_or_zero(y[i]) * v_product[i];
                    *v_x = if x[i].is_finite() { v as f32 } else { 0.0 };
                }
                break;
            }
        }
    }
}

/// Gradients of `mean_x`, `squares` and `product` from that of the similarity, for a row.
#[inline(always)]
fn moments_vjp(moments: [&[f64]; 4], v_out: &[f32], gradients: [&mut [f64]; 3]) {
    let [mean_x, mean_y, squares, product] = moments.map(|row| &row[..v_out.len()]);
    let [v_mean, v_squares, v_product] = gradients.map(|row| &mut row[..v_out.len()]);
    for i in 0..v_out.len() {
        let terms = Terms::new(mean_x[i], mean_y[i], squares[i], product[i]);
        (v_mean[i], v_squares[i], v_product[i]) = terms.vjp(f64::from(v_out[i]));
    }
}

/// The factors of the similarity at a pixel.
struct Terms {
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
    fn new(mean_x: f64, mean_y: f64, squares: f64, product: f64) -> Self {
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
    fn similarity(&self) -> f64 {
        // Two ratios rather than one of products: those of values near f32::MAX overflow.
        (self.luminance / self.luminance_norm) * (self.contrast / self.contrast_norm)
    }

    /// Gradients of `mean_x`, `squares` and `product`.
    #[inline(always)]
    fn vjp(&self, v: f64) -> (f64, f64, f64) {
        let luminance_ratio = self.luminance / self.luminance_norm;
        let contrast_ratio = self.contrast / self.contrast_norm;
        let similarity = luminance_ratio * contrast_ratio;
        let v_product = 2.0 * v * luminance_ratio / self.contrast_norm;
        let v_squares = if self.variance > 0.0 {
            -v * similarity / self.contrast_norm
        } else {
            0.0
        };
        let v_mean_x = 2.0 * v * (self.mean_y * contrast_ratio - self.mean_x * similarity)
            / self.luminance_norm
            - v_product * self.mean_y
            - 2.0 * self.mean_x * v_squares;
        (v_mean_x, v_squares, v_product)
    }
}

#[inline(always)]
fn finite_or_zero(value: f32) -> f64 {
    if value.is_finite() {
        f64::from(value)
    } else {
        0.0
    }
}
