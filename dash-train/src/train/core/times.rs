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

#[cfg(test)]
mod tests {
    use rand::SeedableRng;
    use rand_pcg::Pcg64;

    use super::*;

    #[test]
    fn times_around_are_of_training_and_of_one_side_of_a_gap() {
        let frames = [0, 1, 2, 3, 4, 5, 6, 7, 16, 17, 18, 19, 20];
        let time = |frame: usize| frame as f32 / 20.0;
        // Each several times, in no order.
        let times = Times::of(frames.iter().chain(frames.iter().rev()).map(|&f| time(f)));
        let mut rng = Pcg64::seed_from_u64(5);
        let mut drawn = |frame: usize| -> Vec<[usize; 2]> {
            let around = (0..100).filter_map(|_| times.around(time(frame), &mut rng));
            let frame_of = |time: f32| (time * 20.0).round() as usize;
            let around = around.map(|a| [frame_of(a.before), frame_of(a.after)]);
            let mut around: Vec<[usize; 2]> = around.collect();
            around.sort_unstable();
            around.dedup();
            around
        };
        assert_eq!(drawn(4), [[1, 7], [2, 6], [3, 5]]);
        assert_eq!(drawn(1), [[0, 2]]);
        assert_eq!(drawn(6), [[5, 7]]);
        for without in [0, 7, 16, 20] {
            assert!(drawn(without).is_empty(), "{without}");
        }
        assert_eq!(Times::of(std::iter::empty()).around(0.0, &mut rng), None);
    }
}
