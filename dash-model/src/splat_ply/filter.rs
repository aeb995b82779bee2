//! The 3D smoothing filter of Mip-Splatting (Yu et al., 2024), whose files hold Gaussians without it and its width beside
//! them.

/// The column of the filter's standard deviation.
pub(super) const COLUMN: &str = "filter_3D";

/// Logarithms of scales whose squares are still numbers; farther ones look alike.
const WIDEST: f64 = 300.0;

/// The first row whose filter is no width, and what is there.
pub(super) fn refused(widths: impl Iterator<Item = f32>) -> Option<(usize, f32)> {
    let mut rows = widths.enumerate();
    rows.find(|(_, width)| !(*width >= 0.0 && width.is_finite()))
}

/// The scales' logarithms and the opacity's logit of a Gaussian once the filter has widened it: the wider, the fainter.
pub(super) fn filtered(log_scales: [f32; 3], logit: f32, width: f32) -> ([f32; 3], f32) {
    if width == 0.0 {
        return (log_scales, logit);
    }
    let variance = f64::from(width).powi(2);
    let before = log_scales.map(|log| f64::from(log).clamp(-WIDEST, WIDEST));
    let after = before.map(|log| 0.5 * ((2.0 * log).exp() + variance).ln());
    let log_scales = after.map(|log| log as f32);
    // The logarithm of the share of its opacity that remains.
    let share: f64 = (0..3).map(|k| before[k] - after[k]).sum();
    if share >= 0.0 {
        return (log_scales, logit);
    }
    let odds = f64::from(logit).exp();
    let transparent = share.exp() / (1.0 + odds) - share.exp_m1();
    let opaque = share - (1.0 / odds).ln_1p();
    (log_scales, (opaque - transparent.ln()) as f32)
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
        let plain = ([0.1, -3.0, 7.0], 2.5);
        assert_eq!(filtered(plain.0, plain.1, 0.0), plain);
        for logit in [f32::NEG_INFINITY, -60.0, 60.0, f32::INFINITY] {
            for scales in [
                [f32::NEG_INFINITY, -80.0, 40.0],
                [1e3, 0.0, f32::INFINITY],
                [20.0; 3],
            ] {
                let (logs, faint) = filtered(scales, logit, 0.01);
                assert!(logs.iter().all(|log| log.is_finite()), "{logs:?}");
                assert!(faint <= logit, "{scales:?} {logit}: {faint}");
            }
        }
        let wide = filtered([1e3; 3], 2.0, 0.01);
        assert_eq!(wide.1, 2.0, "nothing is wider");
    }

    #[test]
    fn filters_that_are_no_width_are_found() {
        assert_eq!(refused([0.0, 0.5].into_iter()), None);
        assert_eq!(refused([0.5, -0.1].into_iter()), Some((1, -0.1)));
        assert!(refused([f32::NAN].into_iter()).is_some());
    }
}
