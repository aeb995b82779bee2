//! The 3D smoothing filter of Mip-Splatting (Yu et al., 2024), whose files hold Gaussians without it and its width beside
//! them.

/// The column of the filter's standard deviation.
pub(super) const COLUMN: &str = "filter_3D";

/// The scales' logarithms and the opacity's logit of a Gaussian as it is drawn: wider by the filter, and fainter as it
/// is wider.
pub(super) fn filtered(log_scales: [f32; 3], logit: f32, width: f32) -> ([f32; 3], f32) {
    if width == 0.0 {
        return (log_scales, logit);
    }
    let variance = f64::from(width).powi(2);
    let before = log_scales.map(f64::from);
    let after = before.map(|log| 0.5 * ((2.0 * log).exp() + variance).ln());
    let narrower: f64 = (0..3).map(|k| before[k] - after[k]).sum();
    let opacity = narrower.exp() / (1.0 + (-f64::from(logit)).exp());
    let logit = (opacity / (1.0 - opacity)).ln();
    (after.map(|log| log as f32), logit as f32)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// As the authors write it: the square root of the ratio of both determinants.
    #[test]
    fn a_filter_adds_variances_and_keeps_what_a_gaussian_weighs() {
        let (scales, opacity, width) = ([0.5f64, 0.02, 0.001], 0.7f64, 0.03f64);
        let logit = (opacity / (1.0 - opacity)).ln() as f32;
        let logs = scales.map(|scale| scale.ln() as f32);
        let (wider, fainter) = filtered(logs, logit, width as f32);
        let squares = scales.map(|scale| scale * scale);
        let sums = squares.map(|square| square + width * width);
        for (log, sum) in wider.iter().zip(sums) {
            assert!((f64::from(*log) - sum.sqrt().ln()).abs() < 1e-6, "{log}");
        }
        let ratio = squares.iter().product::<f64>() / sums.iter().product::<f64>();
        let expected = opacity * ratio.sqrt();
        let found = 1.0 / (1.0 + (-f64::from(fainter)).exp());
        assert!((found / expected - 1.0).abs() < 1e-5, "{found} {expected}");
    }

    #[test]
    fn no_filter_changes_nothing_and_extremes_stay_numbers() {
        assert_eq!(
            filtered([0.1, -3.0, 7.0], 2.5, 0.0),
            ([0.1, -3.0, 7.0], 2.5)
        );
        for logit in [f32::NEG_INFINITY, -60.0, 60.0, f32::INFINITY] {
            let (logs, logit) = filtered([f32::NEG_INFINITY, -80.0, 40.0], logit, 0.01);
            assert!(
                logs.iter().all(|log| log.is_finite()) && !logit.is_nan(),
                "{logs:?} {logit}"
            );
        }
        assert!(filtered([0.0; 3], 0.0, f32::NAN).1.is_nan());
    }
}
