//! Structural similarity as plainly as it can be written: what the fast kernels are judged
//! against.

use num_traits::Float;

use super::window::{C1, C2, RADIUS, TAPS, window};

/// `x [H, W, C]`, `y [H, W, C]` -> `[H, W, C]`. See [`ssim`](super::ssim).
pub fn ssim<T: Float>(x: &[T], y: &[T], shape: [usize; 3]) -> Vec<T> {
    let (x, y) = (finite_or_zero(x), finite_or_zero(y));
    moments(&x, &y, shape)
        .into_iter()
        .map(|m| clamp(m.similarity()))
        .collect()
}

/// Gradients `(v_x, v_y)` from `v_out`, all `[H, W, C]`.
pub fn ssim_vjp<T: Float>(x: &[T], y: &[T], v_out: &[T], shape: [usize; 3]) -> (Vec<T>, Vec<T>) {
    let (x_finite, y_finite) = (finite_or_zero(x), finite_or_zero(y));
    let v_moments: Vec<Moments<T>> = moments(&x_finite, &y_finite, shape)
        .into_iter()
        .zip(finite_or_zero(v_out))
        .map(|(m, v)| m.similarity_vjp(v))
        .collect();
    // A symmetric window with zero padding is its own transpose.
    let pull =
        |part: fn(&Moments<T>) -> T| blur(&v_moments.iter().map(part).collect::<Vec<_>>(), shape);
    let (v_mean_x, v_mean_y) = (pull(|v| v.mean_x), pull(|v| v.mean_y));
    let (v_squares, v_product) = (pull(|v| v.squares), pull(|v| v.product));
    let two = T::one() + T::one();
    let gradient = |own: &[T], own_finite: &[T], other: &[T], v_mean: &[T]| {
        (0..own.len())
            .map(|i| {
                if own[i].is_finite() {
                    v_mean[i] + two * own_finite[i] * v_squares[i] + other[i] * v_product[i]
                } else {
                    T::zero()
                }
            })
            .collect()
    };
    (
        gradient(x, &x_finite, &y_finite, &v_mean_x),
        gradient(y, &y_finite, &x_finite, &v_mean_y),
    )
}

/// Window means around one pixel.
struct Moments<T> {
    mean_x: T,
    mean_y: T,
    /// Of `x^2 + y^2`.
    squares: T,
    /// Of `x y`.
    product: T,
}

impl<T: Float> Moments<T> {
    fn similarity(&self) -> T {
        let [luminance, contrast, luminance_norm, contrast_norm] = self.terms();
        luminance * contrast / (luminance_norm * contrast_norm)
    }

    fn similarity_vjp(&self, v: T) -> Self {
        let [luminance, contrast, luminance_norm, contrast_norm] = self.terms();
        let two = T::one() + T::one();
        let norm = luminance_norm * contrast_norm;
        let similarity = luminance * contrast / norm;
        let v_product = v * two * luminance / norm;
        let v_squares = if self.variance() > T::zero() {
            -v * similarity / contrast_norm
        } else {
            T::zero()
        };
        let v_mean = |own: T, other: T| {
            v * two * (other * contrast / norm - own * similarity / luminance_norm)
                - v_product * other
                - two * own * v_squares
        };
        Self {
            mean_x: v_mean(self.mean_x, self.mean_y),
            mean_y: v_mean(self.mean_y, self.mean_x),
            squares: v_squares,
            product: v_product,
        }
    }

    fn variance(&self) -> T {
        self.squares - self.mean_x * self.mean_x - self.mean_y * self.mean_y
    }

    fn terms(&self) -> [T; 4] {
        let two = T::one() + T::one();
        let means = self.mean_x * self.mean_y;
        [
            two * means + constant(C1),
            two * (self.product - means) + constant(C2),
            self.mean_x * self.mean_x + self.mean_y * self.mean_y + constant(C1),
            self.variance().max(T::zero()) + constant(C2),
        ]
    }
}

fn moments<T: Float>(x: &[T], y: &[T], shape: [usize; 3]) -> Vec<Moments<T>> {
    let pairs = || x.iter().zip(y);
    let mean_x = blur(x, shape);
    let mean_y = blur(y, shape);
    let squares = blur(
        &pairs().map(|(&x, &y)| x * x + y * y).collect::<Vec<_>>(),
        shape,
    );
    let product = blur(&pairs().map(|(&x, &y)| x * y).collect::<Vec<_>>(), shape);
    (0..x.len())
        .map(|i| Moments {
            mean_x: mean_x[i],
            mean_y: mean_y[i],
            squares: squares[i],
            product: product[i],
        })
        .collect()
}

/// The window's mean around every pixel; what lies outside the image counts as zero.
fn blur<T: Float>(image: &[T], [height, width, channels]: [usize; 3]) -> Vec<T> {
    let window = window();
    let mut out = vec![T::zero(); image.len()];
    for (i, out) in out.iter_mut().enumerate() {
        let (row, column) = (i / channels / width, i / channels % width);
        let channel = i % channels;
        for tap_row in 0..TAPS {
            for tap_column in 0..TAPS {
                // Wraps to something huge, and so out of the image, on the far left and top.
                let row = (row + tap_row).wrapping_sub(RADIUS);
                let column = (column + tap_column).wrapping_sub(RADIUS);
                if row < height && column < width {
                    let weight = constant::<T>(window[tap_row] * window[tap_column]);
                    *out = *out + weight * image[(row * width + column) * channels + channel];
                }
            }
        }
    }
    out
}

fn finite_or_zero<T: Float>(image: &[T]) -> Vec<T> {
    let keep = |&value: &T| if value.is_finite() { value } else { T::zero() };
    image.iter().map(keep).collect()
}

fn clamp<T: Float>(similarity: T) -> T {
    similarity.max(-T::one()).min(T::one())
}

fn constant<T: Float>(value: f64) -> T {
    T::from(value).expect("a float type holds any f64, rounded")
}
