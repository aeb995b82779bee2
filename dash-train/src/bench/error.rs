//! Errors of many values against a reference.

use serde::{Deserialize, Serialize};

/// How the errors are taken, for the file.
pub(super) const RULE: &str = "each f32 value against the f64 reference on the same f32 input; relative to the larger of the \
     reference and a thousandth of its tensor's root mean square; values that are exactly 0 in both do \
     not count; a value that is not finite where the reference is counts as infinitely wrong";
/// Share of a tensor's root mean square under which errors are no longer relative to the value.
const FLOOR: f64 = 1e-3;

/// Statistics of one kind of error.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Norms {
    /// The largest; absent when a value was not finite.
    pub max: Option<f64>,
    /// The 99th percentile; absent when it is not finite.
    pub p99: Option<f64>,
    /// The root of the mean square; absent when it is not finite.
    pub rms: Option<f64>,
    /// The mean with its sign; absent when it is not finite.
    pub bias: Option<f64>,
}

/// Errors of an operation.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ErrorStats {
    /// Values that count.
    pub n_values: usize,
    /// Values that are not finite, though the reference is.
    pub n_not_finite: usize,
    /// Relative errors.
    pub relative: Norms,
    /// Absolute errors, in the values' own units.
    pub absolute: Norms,
}

/// Collects errors of several tensors, each relative to its own values.
#[derive(Debug, Default)]
pub(super) struct Errors {
    relative: Vec<f64>,
    absolute: Vec<f64>,
    n_not_finite: usize,
}

impl Errors {
    /// Errors of one tensor.
    pub(super) fn of(got: &[f32], expected: &[f64]) -> ErrorStats {
        let mut errors = Self::default();
        errors.add(got, expected);
        errors.stats()
    }

    /// Adds a tensor.
    ///
    /// # Panics
    /// When the lengths differ.
    pub(super) fn add(&mut self, got: &[f32], expected: &[f64]) {
        assert_eq!(
            got.len(),
            expected.len(),
            "kernel and reference differ in size"
        );
        let n = expected.len().max(1) as f64;
        let rms = (expected.iter().map(|e| e * e).sum::<f64>() / n).sqrt();
        let floor = (FLOOR * rms).max(f64::MIN_POSITIVE);
        for (&got, &expected) in got.iter().zip(expected) {
            if got == 0.0 && expected == 0.0 {
                continue;
            }
            if !got.is_finite() && expected.is_finite() {
                self.n_not_finite += 1;
            }
            let error = f64::from(got) - expected;
            self.absolute.push(error);
            self.relative.push(error / expected.abs().max(floor));
        }
    }

    pub(super) fn stats(self) -> ErrorStats {
        ErrorStats {
            n_values: self.absolute.len(),
            n_not_finite: self.n_not_finite,
            relative: norms(self.relative),
            absolute: norms(self.absolute),
        }
    }
}

fn norms(errors: Vec<f64>) -> Norms {
    if errors.is_empty() {
        return Norms::default();
    }
    let n = errors.len();
    let mean = |of: fn(f64) -> f64| errors.iter().map(|&e| of(e)).sum::<f64>() / n as f64;
    let (bias, rms) = (mean(|e| e), mean(|e| e * e).sqrt());
    // NaN is the largest in this order, as it should be.
    let mut sizes: Vec<f64> = errors.iter().map(|e| e.abs()).collect();
    sizes.sort_by(f64::total_cmp);
    let finite = |value: f64| value.is_finite().then_some(value);
    Norms {
        max: finite(sizes[n - 1]),
        p99: finite(sizes[(n * 99 / 100).min(n - 1)]),
        rms: finite(rms),
        bias: finite(bias),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_are_those_worked_out_by_hand() {
        let stats = Errors::of(&[1.5, -2.0, 0.0, 4.0], &[1.0, -2.5, 0.0, 4.0]);
        assert_eq!(stats.n_values, 3);
        let close = |got: Option<f64>, expected: f64| {
            let got = got.expect("finite");
            assert!((got - expected).abs() < 1e-12, "{got}, not {expected}");
        };
        close(stats.absolute.max, 0.5);
        close(stats.absolute.bias, 1.0 / 3.0);
        close(stats.absolute.rms, (0.5 / 3.0_f64).sqrt());
        close(stats.relative.max, 0.5);
        close(stats.relative.bias, (0.5 + 0.2) / 3.0);
        close(stats.relative.p99, 0.5);
    }

    #[test]
    fn values_next_to_zero_are_measured_by_their_neighbours() {
        let stats = Errors::of(&[1e-9, 1.0], &[0.0, 1.0]);
        let floor = 1e-3 * 0.5_f64.sqrt();
        let max = stats.relative.max.expect("finite");
        assert!((max - 1e-9 / floor).abs() < 1e-3 * max, "{max}");
    }

    #[test]
    fn what_is_not_finite_is_never_a_good_number() {
        let stats = Errors::of(&[f32::NAN, 1.0], &[1.0, 1.0]);
        assert_eq!(stats.n_not_finite, 1);
        assert_eq!((stats.relative.max, stats.relative.rms), (None, None));
        assert_eq!(Errors::of(&[], &[]), ErrorStats::default());
        assert_eq!(Errors::of(&[0.0], &[0.0]).relative.max, None);
    }

    #[test]
    fn each_tensor_has_a_scale_of_its_own() {
        let mut errors = Errors::default();
        errors.add(&[1e6 + 1.0], &[1e6]);
        errors.add(&[1.1e-6], &[1e-6]);
        let relative = errors.stats().relative.max.expect("finite");
        assert!((relative - 0.1).abs() < 1e-4, "{relative}");
    }
}
