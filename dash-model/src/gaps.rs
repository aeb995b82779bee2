//! Times of which nothing was seen.

use serde::{Deserialize, Serialize};

/// Parts of a clip of which no picture was seen, `[from, to]`, in rising order. What happened there is not known: within
/// one, Gaussians go in straight lines from how they are at its beginning to how they are at its end. A field of
/// time says nothing there but what it happened to start from.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Gaps(Vec<[f32; 2]>);

impl Gaps {
    /// The gaps between `times` that are more than `steps` typical (median) steps apart. Equal times are one; what
    /// is not finite is none.
    pub fn between(times: impl IntoIterator<Item = f32>, steps: f32) -> Self {
        let mut times: Vec<f32> = times.into_iter().filter(|t| t.is_finite()).collect();
        times.sort_by(f32::total_cmp);
        times.dedup();
        let mut lengths: Vec<f32> = times.windows(2).map(|pair| pair[1] - pair[0]).collect();
        lengths.sort_by(f32::total_cmp);
        let Some(typical) = lengths.get(lengths.len() / 2) else {
            return Self::default();
        };
        let longest = steps * typical;
        let gaps = times.windows(2).map(|pair| [pair[0], pair[1]]);
        Self(gaps.filter(|[from, to]| to - from > longest).collect())
    }

    /// The gap that `time` lies in and how far into it, from 0 at its beginning to 1 at its end; `None` where pictures
    /// were seen, as at both ends of a gap.
    pub fn around(&self, time: f32) -> Option<([f32; 2], f32)> {
        let next = self.0.partition_point(|[from, _]| *from < time);
        let [from, to] = *self.0.get(next.checked_sub(1)?)?;
        (time < to).then(|| ([from, to], (time - from) / (to - from)))
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// How many there are.
    pub fn len(&self) -> usize {
        self.0.len()
    }

    /// Whether all lie in [0, 1], in rising order and without overlap.
    pub(crate) fn are_sound(&self) -> bool {
        let mut last = 0.0;
        self.0.iter().all(|&[from, to]| {
            let sound = last <= from && from < to && to <= 1.0;
            last = to;
            sound
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gaps_are_longer_than_typical_steps() {
        let of = |times: &[f32], steps: f32| Gaps::between(times.iter().copied(), steps).0;
        let times = [0.5, 0.0, 0.1, 0.2, 0.2, 0.6, 0.7, 0.9, f32::NAN, 1.0];
        assert_eq!(of(&times, 1.5), [[0.2, 0.5], [0.7, 0.9]]);
        assert_eq!(of(&times, 2.5), [[0.2, 0.5]]);
        assert_eq!(of(&times, 4.0), [[0.0; 2]; 0]);
        for too_few in [&[] as &[f32], &[0.3], &[0.3, 0.3], &[0.0, 1.0]] {
            assert!(of(too_few, 1.5).is_empty(), "{too_few:?}");
        }
    }

    #[test]
    fn a_gap_is_around_what_lies_strictly_within() {
        let gaps = Gaps(vec![[0.25, 0.5], [0.5, 0.75]]);
        for outside in [-1.0, 0.0, 0.25, 0.5, 0.75, 1.0, f32::NAN] {
            assert_eq!(gaps.around(outside), None, "{outside}");
        }
        assert_eq!(gaps.around(0.3125), Some(([0.25, 0.5], 0.25)));
        assert_eq!(gaps.around(0.625), Some(([0.5, 0.75], 0.5)));
        assert_eq!(Gaps::default().around(0.5), None);
    }

    #[test]
    fn gaps_of_files_are_checked() {
        let sound = |gaps: &[[f32; 2]]| Gaps(gaps.to_vec()).are_sound();
        assert!(sound(&[]) && sound(&[[0.0, 1.0]]) && sound(&[[0.1, 0.2], [0.2, 0.3]]));
        for unsound in [
            [[0.1, 0.3], [0.2, 0.4]],
            [[0.5, 0.6], [0.1, 0.2]],
            [[0.1, 0.2], [0.4, 0.4]],
            [[-0.1, 0.2], [0.3, 0.4]],
            [[0.1, 0.2], [0.3, 1.1]],
            [[0.1, f32::NAN], [0.3, 0.4]],
            [[f32::NEG_INFINITY, 0.2], [0.3, f32::INFINITY]],
        ] {
            assert!(!sound(&unsound), "{unsound:?}");
        }
    }
}
