//! The result of a case.

use serde::Serialize;

/// A part of a result, compared with its expectation.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Judged {
    /// The part.
    pub name: String,
    /// How far it is off.
    pub error: f64,
    /// How far it may be.
    pub tolerance: f64,
}

impl Judged {
    /// The error in units of the tolerance; infinite for an error where there may be none, and for
    /// one that is not a number.
    pub fn strain(&self) -> f64 {
        match self.error {
            error if error.is_nan() => f64::INFINITY,
            0.0 => 0.0,
            error => error / self.tolerance,
        }
    }

    /// Whether the error is within the tolerance.
    pub fn passes(&self) -> bool {
        // In the positive form, so that NaN fails.
        self.error <= self.tolerance
    }
}

/// What came out of a case.
#[derive(Debug, Clone, PartialEq)]
pub struct Measured {
    /// Whether all of it was finite.
    pub finite: bool,
    /// What was compared.
    pub parts: Vec<Judged>,
}

impl Default for Measured {
    fn default() -> Self {
        Self {
            finite: true,
            parts: Vec::new(),
        }
    }
}

impl Measured {
    /// Whether all of it is finite and within tolerance. Of a case that found nothing there is nothing to
    /// say, which is no pass.
    pub fn passes(&self) -> bool {
        self.finite && !self.parts.is_empty() && self.parts.iter().all(Judged::passes)
    }

    /// Values that came out.
    pub fn saw(&mut self, values: &[f32]) {
        self.finite &= values.iter().all(|value| value.is_finite());
    }

    /// A part that is off by `error`.
    pub fn judge(&mut self, name: impl Into<String>, error: f64, tolerance: f64) {
        self.parts.push(Judged {
            name: name.into(),
            error,
            tolerance,
        });
    }

    /// A number of things of which there may be none.
    pub fn none(&mut self, name: impl Into<String>, count: usize) {
        self.judge(name, count as f64, 0.0);
    }

    /// Values that must be those of the reference within `tolerance`, as the length of the difference over their own.
    pub fn agree(&mut self, name: &str, got: &[f32], expected: &[f64], tolerance: f64) {
        self.saw(got);
        self.judge(name, relative_error(got, expected), tolerance);
    }

    /// The same for each row of `width` values by itself: no row is small beside another.
    pub fn agree_by_row(
        &mut self,
        name: &str,
        got: &[f32],
        expected: &[f64],
        width: usize,
        tolerance: f64,
    ) {
        self.saw(got);
        let rows = got.chunks(width).zip(expected.chunks(width));
        let errors = rows.map(|(got, expected)| relative_error(got, expected));
        self.judge(name, worst_of(errors), tolerance);
    }
}

/// Length of the difference of two vectors over that of the second. If the second is zero, the error is zero or
/// infinite.
pub(super) fn relative_error(got: &[f32], expected: &[f64]) -> f64 {
    if got.len() != expected.len() {
        return f64::INFINITY;
    }
    // In units of the largest, so that no square overflows.
    let largest = expected.iter().fold(0.0f64, |most, e| most.max(e.abs()));
    if largest == 0.0 {
        return match got.iter().all(|&value| value == 0.0) {
            true => 0.0,
            false => f64::INFINITY,
        };
    }
    let pairs = got.iter().zip(expected);
    let difference: f64 = pairs
        .map(|(&got, expected)| ((f64::from(got) - expected) / largest).powi(2))
        .sum();
    let length: f64 = expected.iter().map(|e| (e / largest).powi(2)).sum();
    (difference / length).sqrt()
}

/// Largest difference of two lists of values.
pub(super) fn largest_difference(got: &[f32], expected: &[f64]) -> f64 {
    let pairs = got.iter().zip(expected);
    worst_of(pairs.map(|(&got, expected)| (f64::from(got) - expected).abs()))
}

/// The largest error; NaN if any is, which `max` would lose.
pub(super) fn worst_of(errors: impl Iterator<Item = f64>) -> f64 {
    errors.fold(0.0, |worst, error| match error > worst || error.is_nan() {
        true if !worst.is_nan() => error,
        _ => worst,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_wrong_does_not_pass() {
        let mut good = Measured::default();
        assert!(!good.passes(), "nothing was compared");
        good.agree("values", &[1.0, 2.0], &[1.0, 2.0], 1e-6);
        good.none("lost", 0);
        assert!(good.passes());
        let spoilt = |spoil: fn(&mut Measured)| {
            let mut measured = good.clone();
            spoil(&mut measured);
            !measured.passes()
        };
        assert!(spoilt(|m| m.none("lost", 1)));
        assert!(spoilt(|m| m.saw(&[f32::NAN])));
        assert!(spoilt(|m| m.judge("error", f64::NAN, 1.0)));
        assert!(spoilt(|m| m.agree(
            "values",
            &[1.0, 2.1],
            &[1.0, 2.0],
            1e-2
        )));
        assert!(spoilt(|m| m.agree("values", &[1e-9], &[0.0], 1.0)));
        assert!(spoilt(|m| m.agree("values", &[1.0], &[1.0, 0.0], 1.0)));
        assert!(spoilt(|m| {
            m.agree_by_row(
                "rows",
                &[1e9, 2.0, 1e-9, 3e-9],
                &[1e9, 2.0, 1e-9, 1e-9],
                2,
                1e-3,
            )
        }));
    }

    #[test]
    fn squares_of_huge_values_do_not_overflow() {
        let error = relative_error(&[1e38, 0.0], &[1e38, 1e200]);
        assert!((error - 1.0).abs() < 1e-6, "{error}");
        assert!(relative_error(&[f32::MAX], &[f64::from(f32::MAX)]) == 0.0);
    }
}
