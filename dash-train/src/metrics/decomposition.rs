//! Accuracy of the static/dynamic decomposition.

use std::ops::{Add, AddAssign};

/// A pixel counts as dynamic where the dynamic set's accumulated alpha is above this.
pub const DYNAMIC_ALPHA_THRESHOLD: f32 = 0.5;
/// How the decomposition is scored, for `metric_settings`.
pub const DECOMPOSITION_RULE: &str = "a pixel is marked where the dynamic set alone has alpha > 0.5; counts are summed over the \
     views before precision, recall and F1 are taken; each is 1 where there was nothing to find and \
     nothing was found";

/// A confusion matrix of pixels, summed over views: moving or still, covered by the dynamic set or not.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct DecompositionCounts {
    /// Moving and marked.
    pub true_positives: u64,
    /// Still and marked.
    pub false_positives: u64,
    /// Moving and not marked.
    pub false_negatives: u64,
}

/// Compares the dynamic set's alpha with the true motion mask of one view.
///
/// A NaN alpha marks nothing.
///
/// # Shapes
/// `dynamic_alpha [H, W], truth [H, W]`.
///
/// # Panics
/// When the sizes differ.
pub fn decomposition_counts(dynamic_alpha: &[f32], truth: &[bool]) -> DecompositionCounts {
    assert_eq!(
        dynamic_alpha.len(),
        truth.len(),
        "decomposition_counts: the alpha and the mask differ in size"
    );
    let mut counts = DecompositionCounts::default();
    for (alpha, moves) in dynamic_alpha.iter().zip(truth) {
        match (*alpha > DYNAMIC_ALPHA_THRESHOLD, *moves) {
            (true, true) => counts.true_positives += 1,
            (true, false) => counts.false_positives += 1,
            (false, true) => counts.false_negatives += 1,
            (false, false) => {}
        }
    }
    counts
}

impl DecompositionCounts {
    /// The share of the marked pixels that move. With nothing marked: 1 when nothing moves, else 0.
    pub fn precision(&self) -> f64 {
        self.share(self.true_positives + self.false_positives)
    }

    /// The share of the moving pixels that are marked. With nothing moving: 1 when nothing is
    /// marked, else 0.
    pub fn recall(&self) -> f64 {
        self.share(self.true_positives + self.false_negatives)
    }

    /// The harmonic mean of precision and recall; 1 when nothing moves and nothing is marked.
    pub fn f1(&self) -> f64 {
        let wrong = self.false_positives + self.false_negatives;
        if self.true_positives + wrong == 0 {
            return 1.0;
        }
        2.0 * self.true_positives as f64 / (2 * self.true_positives + wrong) as f64
    }

    fn share(&self, of: u64) -> f64 {
        match of {
            0 => f64::from(u8::from(self.false_positives + self.false_negatives == 0)),
            _ => self.true_positives as f64 / of as f64,
        }
    }
}

impl Add for DecompositionCounts {
    type Output = Self;

    fn add(self, other: Self) -> Self {
        Self {
            true_positives: self.true_positives + other.true_positives,
            false_positives: self.false_positives + other.false_positives,
            false_negatives: self.false_negatives + other.false_negatives,
        }
    }
}

impl AddAssign for DecompositionCounts {
    fn add_assign(&mut self, other: Self) {
        *self = *self + other;
    }
}

impl std::iter::Sum for DecompositionCounts {
    fn sum<I: Iterator<Item = Self>>(views: I) -> Self {
        views.fold(Self::default(), Add::add)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn counts_and_scores_of_two_small_views() {
        let first = decomposition_counts(&[0.9, 0.6, 0.2, 0.0], &[true, false, true, false]);
        assert_eq!(
            first,
            DecompositionCounts {
                true_positives: 1,
                false_positives: 1,
                false_negatives: 1
            }
        );
        let second = decomposition_counts(&[0.8, 0.7], &[true, true]);
        let both: DecompositionCounts = [first, second].into_iter().sum();
        assert_eq!(both.precision(), 0.75);
        assert_eq!(both.recall(), 0.75);
        assert_eq!(both.f1(), 0.75);
    }

    #[test]
    fn f1_is_the_harmonic_mean() {
        let counts = DecompositionCounts {
            true_positives: 3,
            false_positives: 1,
            false_negatives: 5,
        };
        let (precision, recall) = (0.75, 0.375);
        assert_eq!((counts.precision(), counts.recall()), (precision, recall));
        assert!((counts.f1() - 2.0 * precision * recall / (precision + recall)).abs() < 1e-15);
    }

    #[test]
    fn nothing_moves() {
        let right = decomposition_counts(&[0.0, 0.5, f32::NAN], &[false; 3]);
        assert_eq!(
            (right.precision(), right.recall(), right.f1()),
            (1.0, 1.0, 1.0)
        );
        let wrong = decomposition_counts(&[1.0, 0.0], &[false; 2]);
        assert_eq!(
            (wrong.precision(), wrong.recall(), wrong.f1()),
            (0.0, 0.0, 0.0)
        );
        let missed = decomposition_counts(&[0.0], &[true]);
        assert_eq!(
            (missed.precision(), missed.recall(), missed.f1()),
            (0.0, 0.0, 0.0)
        );
    }
}
