//! What density control gathers between two rounds.

use rayon::prelude::*;

/// Gaussians that a thread takes at least.
const PORTION: usize = 4096;

/// Columns of packed splats that hold the mean.
pub(crate) const MEANS: usize = 2;

/// Screen-space gradients gathered between two rounds.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct DensityStatistics {
    gradient: Vec<f32>,
    seen: Vec<u32>,
}

impl DensityStatistics {
    /// Nothing gathered for `n` Gaussians.
    pub fn new(n: usize) -> Self {
        Self {
            gradient: vec![0.0; n],
            seen: vec![0; n],
        }
    }

    /// Adds one view: gradients with respect to the means of packed splats, and the splats (for visibility).
    /// `half_size` is half the image in pixels, which makes the gradient independent of it.
    pub fn add(&mut self, v_means: &[f32], splats: &[f32], half_size: [f32; 2]) {
        use dash_kernels::splats::{N_COLUMNS, RADIUS_X};
        let rows = v_means
            .par_chunks_exact(MEANS)
            .zip(splats.par_chunks_exact(N_COLUMNS));
        let sums = self.gradient.par_iter_mut().zip(&mut self.seen);
        let rows = rows.zip(sums).with_min_len(PORTION);
        rows.for_each(|((v, splat), (gradient, seen))| {
            let (x, y) = (v[0] * half_size[0], v[1] * half_size[1]);
            if splat[RADIUS_X] > 0.0 && x.is_finite() && y.is_finite() {
                *gradient += x.hypot(y);
                *seen += 1;
            }
        });
    }

    /// Mean gradient of a Gaussian over the views that saw it.
    pub fn mean(&self, row: usize) -> f32 {
        if self.seen[row] > 0 {
            self.gradient[row] / self.seen[row] as f32
        } else {
            0.0
        }
    }

    /// Appends Gaussians without statistics.
    pub fn grow(&mut self, added: usize) {
        self.gradient.resize(self.gradient.len() + added, 0.0);
        self.seen.resize(self.seen.len() + added, 0);
    }

    /// Follows a change of the rows.
    pub fn gather(&self, sources: &[usize]) -> Self {
        Self {
            gradient: sources.iter().map(|&row| self.gradient[row]).collect(),
            seen: sources.iter().map(|&row| self.seen[row]).collect(),
        }
    }

    /// Sums of gradients, and how often each Gaussian was seen.
    pub fn parts(&self) -> (&[f32], &[u32]) {
        (&self.gradient, &self.seen)
    }

    /// Rebuilds statistics from [`DensityStatistics::parts`].
    pub fn from_parts(gradient: Vec<f32>, seen: Vec<u32>) -> Self {
        Self { gradient, seen }
    }
}
