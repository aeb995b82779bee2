//! Times of which nothing was seen.

use serde::{Deserialize, Serialize};

/// Parts of a clip of which no picture was seen, `[from, to]`, in rising order. What happened there is not known, and a
/// field of time says nothing there but what it happened to start from:
/// [`DynamicPart::deform`](crate::DynamicPart::deform) goes by how things are on both sides. Where nothing was seen up to
/// an end of the clip, the gap goes on beyond it: it is `[-1, to]` or `[from, 2]`.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Gaps(Vec<[f32; 2]>);

/// The open ends of gaps.
const BEFORE_THE_CLIP: f32 = -1.0;
const AFTER_THE_CLIP: f32 = 2.0;

/// Share of a gap's length below which another one beside it does not count.
const SHORT: f32 = 0.5;

/// Where a time lies of which nothing was seen.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Gap {
    /// The last time before it that was seen.
    pub from: f32,
    /// The first after it.
    pub to: f32,
    /// How far into the gap it lies, from 0 at `from` to 1 at `to`.
    pub share: f32,
    /// How long pictures were seen both before `from` and after `to`, but for gaps shorter than half of this one; at
    /// most as long as the gap.
    pub beside: f32,
}

/// The end of what was seen that a time lies beyond.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct End {
    /// The first time that was seen, or the last.
    pub at: f32,
    /// A time that was seen, as far from the end as the time lies beyond it; no farther than pictures were seen, but
    /// for gaps shorter than half of that way.
    pub inner: f32,
}

impl Gaps {
    /// The gaps between `times` that are more than `steps` typical (median) steps apart, and what of [0, 1] lies before
    /// and after all of them. Equal times are one; what is not finite is none.
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
        let (first, last) = (times[0], times[times.len() - 1]);
        let before = (first > 0.0).then_some([BEFORE_THE_CLIP, first]);
        let after = (last < 1.0).then_some([last, AFTER_THE_CLIP]);
        let gaps = times.windows(2).map(|pair| [pair[0], pair[1]]);
        let between = gaps.filter(|[from, to]| to - from > longest);
        Self(before.into_iter().chain(between).chain(after).collect())
    }

    /// The end of what was seen that `time` lies beyond; `None` where it lies between two times that were seen.
    pub fn beyond(&self, time: f32) -> Option<End> {
        let first = self.0.first().filter(|gap| gap[0] == BEFORE_THE_CLIP);
        let last = self.0.last().filter(|gap| gap[1] == AFTER_THE_CLIP);
        let at = match (first, last) {
            (Some(&[_, first]), _) if time < first => first,
            (_, Some(&[last, _])) if time > last => last,
            _ => return None,
        };
        let way = at - time;
        let counts = |[from, to]: &&[f32; 2]| to - from >= SHORT * way.abs();
        let others = self.0.iter().filter(counts);
        let inner = if way > 0.0 {
            let next = others.map(|gap| gap[0]).filter(|t| *t >= at);
            (at + way).min(next.fold(1.0, f32::min))
        } else {
            let next = others.map(|gap| gap[1]).filter(|t| *t <= at);
            (at + way).max(next.fold(0.0, f32::max))
        };
        Some(End { at, inner })
    }

    /// The gap that `time` lies in, between two times that were seen; `None` where pictures were seen, as at both ends of
    /// a gap.
    pub fn around(&self, time: f32) -> Option<Gap> {
        let next = self.0.partition_point(|[from, _]| *from < time);
        let [from, to] = *self.0.get(next.checked_sub(1)?)?;
        if time >= to || from == BEFORE_THE_CLIP || to == AFTER_THE_CLIP {
            return None;
        }
        let length = to - from;
        let shorter = |[from, to]: &&[f32; 2]| to - from < SHORT * length;
        let others = || self.0.iter().filter(|gap| !shorter(gap));
        let before = others().map(|gap| gap[1]).filter(|t| *t <= from);
        let after = others().map(|gap| gap[0]).filter(|t| *t >= to);
        let seen_before = from - before.fold(0.0, f32::max);
        let seen_after = after.fold(1.0, f32::min) - to;
        Some(Gap {
            from,
            to,
            share: (time - from) / length,
            beside: seen_before.min(seen_after).min(length),
        })
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// Whether one lies between two times that were seen.
    pub fn lie_within(&self) -> bool {
        let closed = |[from, to]: &[f32; 2]| *from != BEFORE_THE_CLIP && *to != AFTER_THE_CLIP;
        self.0.iter().any(closed)
    }

    /// How many there are.
    pub fn len(&self) -> usize {
        self.0.len()
    }

    /// Whether nothing was seen up to an end of the clip.
    pub(crate) fn are_open(&self) -> bool {
        let mut times = self.0.iter().flatten();
        times.any(|t| [BEFORE_THE_CLIP, AFTER_THE_CLIP].contains(t))
    }

    /// Whether all lie in [0, 1] or are open, in rising order and without overlap.
    pub(crate) fn are_sound(&self) -> bool {
        let mut last = 0.0;
        self.0.iter().enumerate().all(|(index, &[from, to])| {
            let opens = index == 0 && from == BEFORE_THE_CLIP;
            let ends = index + 1 == self.0.len() && to == AFTER_THE_CLIP && from <= 1.0;
            let sound = (last <= from || opens) && from < to && (to <= 1.0 || ends);
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
        assert_eq!(of(&[0.1, 0.2, 0.9], 8.0), [[-1.0, 0.1], [0.9, 2.0]]);
        assert_eq!(of(&[0.0, 0.1, 0.2, 0.9], 1.5), [[0.2, 0.9], [0.9, 2.0]]);
        assert!(Gaps::between([0.1, 0.2, 0.3, 0.9], 1.5).lie_within());
        assert!(!Gaps::between([0.1, 0.2, 0.3, 0.4], 1.5).lie_within());
    }

    #[test]
    fn beyond_what_was_seen_its_end_is_told_and_a_time_as_far_on_this_side() {
        let gaps = Gaps(vec![
            [-1.0, 0.25],
            [0.375, 0.5],
            [0.6875, 0.75],
            [0.875, 2.0],
        ]);
        let of = |time| gaps.beyond(time).map(|end| [end.at, end.inner]);
        for seen in [0.25, 0.4, 0.5, 0.7, 0.875, f32::NAN] {
            assert_eq!(of(seen), None, "{seen}");
        }
        assert_eq!(of(0.1875), Some([0.25, 0.3125]));
        // No farther than up to the next gap, but through one that is short beside the way.
        assert_eq!(of(0.0), Some([0.25, 0.375]));
        assert_eq!(of(0.9375), Some([0.875, 0.8125]));
        assert_eq!(of(1.0), Some([0.875, 0.75]));
        assert_eq!(of(1.03125), Some([0.875, 0.71875]));
        for within in [0.1, 0.25, 0.9] {
            assert_eq!(gaps.around(within), None, "{within}");
        }
        assert!(gaps.around(0.4).is_some());
        // What lies between two gaps was not seen up to the clip's ends.
        assert_eq!(gaps.around(0.4).map(|gap| gap.beside), Some(0.125));
        let closed = Gaps(vec![[0.25, 1.0]]);
        assert_eq!([0.0, 0.5, 1.5].map(|time| closed.beyond(time)), [None; 3]);
    }

    #[test]
    fn a_gap_is_around_what_lies_strictly_within() {
        let gaps = Gaps(vec![[0.25, 0.5], [0.5, 0.75]]);
        for outside in [-1.0, 0.0, 0.25, 0.5, 0.75, 1.0, f32::NAN] {
            assert_eq!(gaps.around(outside), None, "{outside}");
        }
        let place = |time| gaps.around(time).map(|gap| ([gap.from, gap.to], gap.share));
        assert_eq!(place(0.3125), Some(([0.25, 0.5], 0.25)));
        assert_eq!(place(0.625), Some(([0.5, 0.75], 0.5)));
        assert_eq!(Gaps::default().around(0.5), None);
    }

    #[test]
    fn what_was_seen_beside_a_gap_ends_at_other_gaps_that_are_not_much_shorter() {
        // Lengths of 1 / 32, 1 / 4, 1 / 8 and 1 / 16.
        let gaps = Gaps(vec![
            [0.125, 0.15625],
            [0.25, 0.5],
            [0.625, 0.75],
            [0.875, 0.9375],
        ]);
        let beside = |time| gaps.around(time).map(|gap| gap.beside);
        // As long as itself; up to the next gap, which is half as long; up to that before and to the clip's end.
        assert_eq!(beside(0.14), Some(0.03125));
        assert_eq!(beside(0.3), Some(0.125));
        assert_eq!(beside(0.7), Some(0.125));
        assert_eq!(beside(0.9), Some(0.0625));
        let next_to_another = Gaps(vec![[0.25, 0.5], [0.5, 0.75]]);
        assert_eq!(next_to_another.around(0.3).map(|gap| gap.beside), Some(0.0));
    }

    #[test]
    fn gaps_of_files_are_checked() {
        let sound = |gaps: &[[f32; 2]]| Gaps(gaps.to_vec()).are_sound();
        assert!(sound(&[]) && sound(&[[0.0, 1.0]]) && sound(&[[0.1, 0.2], [0.2, 0.3]]));
        assert!(sound(&[[-1.0, 0.2], [0.2, 0.3], [0.3, 2.0]]) && sound(&[[-1.0, 2.0]]));
        for unsound in [
            [[0.1, 0.3], [0.2, 0.4]],
            [[0.5, 0.6], [0.1, 0.2]],
            [[0.1, 0.2], [0.4, 0.4]],
            [[-0.1, 0.2], [0.3, 0.4]],
            [[0.1, 0.2], [-1.0, 0.4]],
            [[0.1, 2.0], [0.3, 0.4]],
            [[0.1, 0.2], [1.5, 2.0]],
            [[0.1, 0.2], [0.3, 1.1]],
            [[0.1, f32::NAN], [0.3, 0.4]],
            [[f32::NEG_INFINITY, 0.2], [0.3, f32::INFINITY]],
        ] {
            assert!(!sound(&unsound), "{unsound:?}");
        }
    }
}
