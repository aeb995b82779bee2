//! What density control gathers between two rounds.

use crate::train::core::view_sums::ViewSums;

/// Screen-space gradients gathered between two rounds.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct DensityStatistics {
    gradient: Vec<f32>,
    seen: Vec<u32>,
}

impl DensityStatistics {
    /// What the device has summed.
    pub fn of(sums: &ViewSums) -> Self {
        let (gradient, views) = sums.totals();
        Self::from_totals(gradient, views.into_iter().map(|n| n as u32).collect())
    }

    /// Mean gradient of a Gaussian over the views that saw it.
    pub fn mean(&self, row: usize) -> f32 {
        if self.seen[row] > 0 {
            self.gradient[row] / self.seen[row] as f32
        } else {
            0.0
        }
    }

    /// Sums of gradients, and how often each Gaussian was seen.
    pub fn totals(&self) -> (&[f32], &[u32]) {
        (&self.gradient, &self.seen)
    }

    /// Rebuilds statistics from [`DensityStatistics::totals`].
    pub fn from_totals(gradient: Vec<f32>, seen: Vec<u32>) -> Self {
        Self { gradient, seen }
    }
}
