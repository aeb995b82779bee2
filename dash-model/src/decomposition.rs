//! Static/dynamic decomposition: motion statistics over many views, and the threshold on them.
//!
//! ```
//! use dash_model::decomposition::{MotionStatistics, percentile_threshold, select_dynamic};
//!
//! let mut statistics = MotionStatistics::new(4);
//! // Motion of each Gaussian in two views, weighted by visibility.
//! statistics.add(&[0.0, 0.1, 0.9, 0.1], &[1.0, 1.0, 0.5, 1.0]);
//! statistics.add(&[0.1, 0.1, 1.0, 0.0], &[1.0, 1.0, 1.0, 0.0]);
//! assert_eq!(percentile_threshold(&statistics.means(), 0.5), 0.1);
//! assert_eq!(select_dynamic(&statistics.means(), 0.5, 0.0), [false, false, true, false]);
//! ```

/// The mean motion of every Gaussian over training views.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct MotionStatistics {
    weighted: Vec<f32>,
    weights: Vec<f32>,
}

impl MotionStatistics {
    /// Empty statistics of `n` Gaussians.
    pub fn new(n: usize) -> Self {
        Self {
            weighted: vec![0.0; n],
            weights: vec![0.0; n],
        }
    }

    /// Rebuilds statistics from [`MotionStatistics::totals`].
    pub fn from_totals(weighted: Vec<f32>, weights: Vec<f32>) -> Self {
        Self { weighted, weights }
    }

    /// The weighted sums and the weights.
    pub fn totals(&self) -> (&[f32], &[f32]) {
        (&self.weighted, &self.weights)
    }

    /// Adds the motion in one view. Values that are not finite, and those of weight 0 (not visible in this view), are ignored.
    ///
    /// # Panics
    /// When the numbers of Gaussians differ.
    pub fn add(&mut self, motion: &[f32], weights: &[f32]) {
        assert_eq!(
            motion.len(),
            self.weights.len(),
            "one motion for each Gaussian"
        );
        assert_eq!(
            weights.len(),
            self.weights.len(),
            "one weight for each Gaussian"
        );
        for (i, (&m, &w)) in motion.iter().zip(weights).enumerate() {
            if m.is_finite() && w > 0.0 {
                self.weighted[i] += m * w;
                self.weights[i] += w;
            }
        }
    }

    /// The statistics of the rows named by `sources`, after a change of the set.
    pub fn gather(&self, sources: &[usize]) -> Self {
        Self {
            weighted: sources.iter().map(|&row| self.weighted[row]).collect(),
            weights: sources.iter().map(|&row| self.weights[row]).collect(),
        }
    }

    /// Mean motion of each Gaussian; 0 where it was never visible.
    pub fn means(&self) -> Vec<f32> {
        self.weighted
            .iter()
            .zip(&self.weights)
            .map(|(&sum, &weight)| if weight > 0.0 { sum / weight } else { 0.0 })
            .collect()
    }
}

/// The `quantile` of the finite motions; infinite when there are none, so that no motion exceeds it.
pub fn percentile_threshold(motion: &[f32], quantile: f32) -> f32 {
    let mut finite: Vec<f32> = motion.iter().copied().filter(|m| m.is_finite()).collect();
    if finite.is_empty() {
        return f32::INFINITY;
    }
    let rank = (quantile.clamp(0.0, 1.0) * (finite.len() - 1) as f32).floor() as usize;
    *finite.select_nth_unstable_by(rank, f32::total_cmp).1
}

/// Selects the motions above both the `quantile` and an absolute `floor`. Equal motions get equal decisions; a motion that
/// is not finite is static.
///
/// # Source
/// The paper's `|dp| > tau` with `tau` the top-k % percentile. `floor` is ours (0 in the paper), so that a static scene has
/// no dynamic part.
pub fn select_dynamic(motion: &[f32], quantile: f32, floor: f32) -> Vec<bool> {
    let threshold = percentile_threshold(motion, quantile);
    motion
        .iter()
        .map(|&m| m.is_finite() && m > threshold && m > floor)
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_top_share_is_dynamic() {
        let motion: Vec<f32> = (0..100).map(|i| i as f32).collect();
        let mask = select_dynamic(&motion, 0.8, 0.0);
        let count = mask.iter().filter(|&&m| m).count();
        assert_eq!(count, 20, "20 % of 100");
        assert!(mask[99] && !mask[79]);
    }

    #[test]
    fn equal_motions_get_equal_decisions_and_nan_is_static() {
        assert_eq!(select_dynamic(&[1.0; 7], 0.8, 0.0), [false; 7]);
        let mask = select_dynamic(&[0.0, 0.0, 0.0, 5.0, 5.0, f32::NAN], 0.5, 0.0);
        assert_eq!(mask, [false, false, false, true, true, false]);
        assert_eq!(select_dynamic(&[f32::NAN; 3], 0.8, 0.0), [false; 3]);
        assert_eq!(select_dynamic(&[3.0], 0.8, 0.0), [false]);
        assert!(select_dynamic(&[], 0.8, 0.0).is_empty());
    }

    #[test]
    fn the_floor_keeps_a_static_scene_static() {
        let jitter: Vec<f32> = (0..50).map(|i| 1e-4 * i as f32).collect();
        assert!(select_dynamic(&jitter, 0.8, 0.5).iter().all(|m| !m));
    }

    #[test]
    fn statistics_average_over_visible_views() {
        let mut statistics = MotionStatistics::new(3);
        statistics.add(&[1.0, f32::NAN, 4.0], &[1.0, 1.0, 0.0]);
        statistics.add(&[3.0, 2.0, 4.0], &[3.0, 1.0, 0.0]);
        assert_eq!(statistics.means(), [2.5, 2.0, 0.0]);
        assert_eq!(statistics.gather(&[2, 0, 0]).means(), [0.0, 2.5, 2.5]);
    }
}
