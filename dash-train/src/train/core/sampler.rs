//! The order in which views are trained on.

use std::collections::BTreeMap;

use rand::seq::SliceRandom;
use rand_pcg::Pcg64;
use serde::{Deserialize, Serialize};

/// Views that are drawn before the candidates are looked at again, while these change.
const ROUND: usize = 16;
/// How many of them are new.
const NEW: usize = 8;

/// Draws every candidate once, in random order, before any comes again.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct ViewSampler {
    left: Vec<u32>,
    /// Whether `left` has been told since it was drawn.
    #[serde(skip)]
    is_told: bool,
}

impl ViewSampler {
    /// The next of the views for which `is_candidate` holds.
    pub fn next(
        &mut self,
        n: usize,
        is_candidate: impl Fn(usize) -> bool,
        rng: &mut Pcg64,
    ) -> usize {
        if self.left.is_empty() {
            self.left = shuffled(n, is_candidate, rng);
            self.is_told = false;
        }
        self.left.pop().map_or(0, |view| view as usize)
    }

    /// The next while candidates become more: only a few are drawn before they are listed anew, half
    /// of them from those that are new, of every `time` as many as of any other: motion is lost where
    /// few pictures show the way.
    pub fn next_of_growing(
        &mut self,
        n: usize,
        is_candidate: impl Fn(usize) -> bool,
        is_new: impl Fn(usize) -> bool,
        time: impl Fn(usize) -> f32,
        rng: &mut Pcg64,
    ) -> usize {
        if self.left.is_empty() {
            let new = shuffled(n, |view| is_candidate(view) && is_new(view), rng);
            self.left = in_turns(new, time);
            self.left.truncate(NEW);
            let mut others = shuffled(n, is_candidate, rng);
            others.truncate(ROUND - self.left.len());
            self.left.extend(others);
            self.left.shuffle(rng);
            self.is_told = false;
        }
        self.left.pop().map_or(0, |view| view as usize)
    }

    /// The views that are left of the round, next first; once for each round.
    pub fn tell_new_round(&mut self) -> Option<impl Iterator<Item = usize>> {
        let is_new = !std::mem::replace(&mut self.is_told, true);
        is_new.then(|| self.left.iter().rev().map(|&view| view as usize))
    }

    /// The largest index among the views left of the round.
    pub fn largest(&self) -> Option<usize> {
        self.left.iter().max().map(|&view| view as usize)
    }

    /// Forgets what is left of the round.
    pub fn restart(&mut self) {
        self.left.clear();
    }
}

fn shuffled(n: usize, is_candidate: impl Fn(usize) -> bool, rng: &mut Pcg64) -> Vec<u32> {
    let mut views: Vec<u32> = (0..n as u32)
        .filter(|&view| is_candidate(view as usize))
        .collect();
    views.shuffle(rng);
    views
}

/// The same views, their times taking turns; those of one time keep their order.
fn in_turns(views: Vec<u32>, time: impl Fn(usize) -> f32) -> Vec<u32> {
    let mut turns = BTreeMap::new();
    let mut turn_of = |view: u32| {
        let turn = turns.entry(time(view as usize).to_bits()).or_insert(0u32);
        *turn += 1;
        *turn
    };
    let mut ordered: Vec<(u32, u32)> = views
        .into_iter()
        .map(|view| (turn_of(view), view))
        .collect();
    ordered.sort_by_key(|&(turn, _)| turn);
    ordered.into_iter().map(|(_, view)| view).collect()
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
            let first = sampler.next(9, |view| view < 7, &mut rng);
            let told: Vec<usize> = sampler.tell_new_round().expect("drawn anew").collect();
            assert!(sampler.tell_new_round().is_none(), "told already");
            let left: Vec<usize> = (1..7)
                .map(|_| sampler.next(9, |view| view < 7, &mut rng))
                .collect();
            assert_eq!(told, left);
            let mut round: Vec<usize> = std::iter::once(first).chain(left).collect();
            round.sort_unstable();
            assert_eq!(round, [0, 1, 2, 3, 4, 5, 6]);
        }
    }

    #[test]
    fn half_of_a_growing_round_is_new() {
        let mut rng = Pcg64::seed_from_u64(4);
        let mut sampler = ViewSampler::default();
        let mut next =
            |rng: &mut Pcg64| sampler.next_of_growing(99, |v| v < 90, |v| v >= 85, |_| 0.0, rng);
        let new = (0..ROUND).filter(|_| next(&mut rng) >= 85).count();
        // Five views are new, and among the eleven others are new ones by chance too.
        assert!((5..=10).contains(&new), "{new}");
        let mut sampler = ViewSampler::default();
        let mut next = || sampler.next_of_growing(9, |v| v < 3, |_| false, |_| 0.0, &mut rng);
        assert!((0..ROUND).all(|_| next() < 3));
    }

    #[test]
    fn every_new_time_has_its_turn() {
        let mut rng = Pcg64::seed_from_u64(5);
        // Eight cameras at each of ten times, of which the last four are new.
        let time = |view: usize| (view / 8) as f32;
        for _ in 0..20 {
            let mut sampler = ViewSampler::default();
            let mut of_time = [0; 10];
            for _ in 0..ROUND {
                let view = sampler.next_of_growing(80, |_| true, |v| v >= 48, time, &mut rng);
                of_time[view / 8] += 1;
            }
            assert!(of_time[6..].iter().all(|&n| n >= NEW / 4), "{of_time:?}");
        }
    }
}
