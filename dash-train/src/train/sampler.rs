//! The order in which views are trained on.

use rand::seq::SliceRandom;
use rand_pcg::Pcg64;
use serde::{Deserialize, Serialize};

/// Draws every view once, in random order, before any view comes again.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct ViewSampler {
    left: Vec<u32>,
}

impl ViewSampler {
    /// The next of `n` views.
    pub(crate) fn next(&mut self, n: usize, rng: &mut Pcg64) -> usize {
        if self.left.is_empty() {
            self.left = (0..n as u32).collect();
            self.left.shuffle(rng);
        }
        self.left.pop().map_or(0, |view| view as usize)
    }
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;

    use super::*;

    #[test]
    fn every_view_comes_once_a_round() {
        let mut rng = Pcg64::seed_from_u64(3);
        let mut sampler = ViewSampler::default();
        for _ in 0..3 {
            let mut round: Vec<usize> = (0..7).map(|_| sampler.next(7, &mut rng)).collect();
            round.sort_unstable();
            assert_eq!(round, [0, 1, 2, 3, 4, 5, 6]);
        }
    }
}
