//! The training views' times.

use rand::Rng;

/// Training times by which the times before and after may be away, at most.
const REACH: usize = 3;
/// How much farther they may be than that many typical steps: farther ones are beyond a time gap.
const LONGEST: f32 = 1.5;

/// A training time before and one after another time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Around {
    pub(crate) before: f32,
    pub(crate) after: f32,
}

/// The training times, in order.
#[derive(Debug, Clone, PartialEq)]
pub struct Times {
    times: Vec<f32>,
    typical_step: f32,
}

impl Times {
    /// Of these times in [0, 1], in any order.
    pub fn of(times: impl Iterator<Item = f32>) -> Self {
        let mut times: Vec<f32> = times.collect();
        times.sort_by(f32::total_cmp);
        times.dedup();
        let mut steps: Vec<f32> = times.windows(2).map(|pair| pair[1] - pair[0]).collect();
        steps.sort_by(f32::total_cmp);
        let typical_step = steps.get(steps.len() / 2).copied().unwrap_or(0.0);
        Self {
            times,
            typical_step,
        }
    }

    /// All of them, each once.
    pub fn all(&self) -> &[f32] {
        &self.times
    }

    /// The times one to [`REACH`] places before and after a training time, as drawn; `None` at the clip's ends, and
    /// where a time gap is between them.
    pub(crate) fn around(&self, time: f32, rng: &mut impl Rng) -> Option<Around> {
        let away = rng.random_range(1..=REACH);
        let at = self.times.partition_point(|&t| t < time);
        let around = Around {
            before: *self.times.get(at.checked_sub(away)?)?,
            after: *self.times.get(at + away)?,
        };
        let longest = LONGEST * self.typical_step * (2 * away) as f32;
        (around.after - around.before <= longest).then_some(around)
    }
}
