//! The order in which views are trained on.

use rand::seq::SliceRandom;
use rand_pcg::Pcg64;
use serde::{Deserialize, Serialize};

/// Views that are drawn before the candidates are looked at again, while these change.
const ROUND: usize = 32;

/// Draws every candidate once, in random order, before any comes again.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct ViewSampler {
    left: Vec<u32>,
}

impl ViewSampler {
    /// The next of the views for which `is_candidate` holds. While `changing`, only a few are drawn
    /// before candidates are listed anew.
    pub(crate) fn next(
        &mut self,
        n: usize,
        is_candidate: impl Fn(usize) -> bool,
        changing: bool,
        rng: &mut Pcg64,
    ) -> usize {
        if self.left.is_empty() {
            self.left = (0..n as u32)
                .filter(|&view| is_candidate(view as usize))
                .collect();
            self.left.shuffle(rng);
            if changing {
                self.left.truncate(ROUND);
            }
        }
        self.left.pop().map_or(0, |view| view as usize)
    }

    /// Forgets what is left of the round.
    pub(crate) fn restart(&mut self) {
        self.left.clear();
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
            let mut round: Vec<usize> = (0..7)
                .map(|_| sampler.next(9, |view| view < 7, false, &mut rng))
                .collect();
            round.sort_unstable();
            assert_eq!(round, [0, 1, 2, 3, 4, 5, 6]);
        }
    }
}
