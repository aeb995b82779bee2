//! The photometric loss as plainly as it can be written: what the fast kernels are judged against.

use num_traits::Float;

use crate::ssim::reference::{ssim, ssim_vjp};

/// Loss, mean squared error, and the loss's gradient to the image, `[H, W, C]` each. See
/// [`photometric`](super::photometric).
pub fn photometric<T: Float>(
    image: &[T],
    target: &[T],
    dssim: T,
    shape: [usize; 3],
) -> (T, T, Vec<T>) {
    let n = T::from(image.len()).expect("a float type holds any length, rounded");
    let mean = |values: &mut dyn Iterator<Item = T>| values.fold(T::zero(), |sum, v| sum + v) / n;
    let errors = || image.iter().zip(target).map(|(&x, &y)| x - y);
    let l1 = mean(&mut errors().map(T::abs));
    let mse = mean(&mut errors().map(|d| d * d));
    let similarity = mean(&mut ssim(image, target, shape).into_iter());
    let loss = (T::one() - dssim) * l1 + dssim * (T::one() - similarity);
    let (v_similar, _) = ssim_vjp(image, target, &vec![-dssim / n; image.len()], shape);
    let sign = |d: T| if d == T::zero() { d } else { d.signum() };
    let gradient = errors()
        .zip(v_similar)
        .map(|(d, v)| {
            let v_l1 = (T::one() - dssim) / n * sign(d);
            if d.is_finite() { v_l1 + v } else { v }
        })
        .collect();
    (loss, mse, gradient)
}
