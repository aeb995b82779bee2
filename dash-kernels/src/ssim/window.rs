//! The SSIM window and the formula on local moments, shared by the reference and the kernels.

/// Taps of the window.
pub(super) const TAPS: usize = 11;
/// Taps on either side of the centre.
pub(super) const RADIUS: usize = TAPS / 2;
const SIGMA: f64 = 1.5;
/// Stabilises the luminance term.
pub(super) const C1: f64 = 0.01 * 0.01;
/// Stabilises the contrast term.
pub(super) const C2: f64 = 0.03 * 0.03;

/// The normalised Gaussian window along one axis.
pub(super) fn window() -> [f64; TAPS] {
    let mut window = [0.0; TAPS];
    for (tap, weight) in window.iter_mut().enumerate() {
        let distance = tap as f64 - RADIUS as f64;
        *weight = (-distance * distance / (2.0 * SIGMA * SIGMA)).exp();
    }
    let sum: f64 = window.iter().sum();
    window.map(|weight| weight / sum)
}
