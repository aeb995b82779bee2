//! Time gaps: parts of a clip that no picture shows, and how to get through them.

mod turn;

use serde::{Deserialize, Serialize};

pub(crate) use turn::turn;

/// The time gaps of a clip, `[from, to]` each, in rising order.
///
/// A deformation field has learnt nothing about times inside a gap. [`DynamicPart::deform`](crate::DynamicPart::deform)
/// interpolates between both sides of a gap instead, and extrapolates before the first and after the last time seen. A gap
/// at an end of the clip is open: it is `[-1, to]` or `[from, 2]`.
///
/// # Example
/// ```
/// use dash_model::Gaps;
///
/// // Pictures every 0.1, none between 0.4 and 0.7, none after 0.9.
/// let times = [0.0, 0.1, 0.2, 0.3, 0.4, 0.7, 0.8, 0.9];
/// let gaps = Gaps::between(times, 1.5);
/// let inside = gaps.interpolation(0.55).expect("in a gap");
/// assert_eq!([inside.from, inside.to], [0.4, 0.7]);
/// assert!((inside.weight - 0.5).abs() < 1e-6);
/// let after = gaps.extrapolation(0.95).expect("after the last picture");
/// assert_eq!(after.edge, 0.9);
/// assert!((after.mirrored - 0.85).abs() < 1e-6);
/// assert!(gaps.interpolation(0.2).is_none() && gaps.extrapolation(0.2).is_none());
/// ```
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Gaps(Vec<[f32; 2]>);

/// The open ends of gaps.
const BEFORE_THE_CLIP: f32 = -1.0;
const AFTER_THE_CLIP: f32 = 2.0;

/// Share of a gap's length below which another gap beside it is ignored.
const SHORT: f32 = 0.5;

/// How to interpolate at a time inside a gap.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GapInterpolation {
    /// The last time seen before the gap.
    pub from: f32,
    /// The first time seen after it.
    pub to: f32,
    /// Weight of `to`, from 0 at `from` to 1 at `to`.
    pub weight: f32,
    /// How long pictures were seen both before `from` and after `to`, at most the gap's length. Gaps shorter than half of
    /// this one count as seen.
    pub observed: f32,
}

/// How to extrapolate at a time before the first or after the last time seen.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GapExtrapolation {
    /// The first or the last time seen.
    pub edge: f32,
    /// The time as far inside from `edge` as the asked one is outside, or the farthest with pictures in between. Gaps
    /// shorter than half of the distance count as seen.
    pub mirrored: f32,
}

impl Gaps {
    /// The gaps longer than `steps` typical (median) steps between `times`, and what of [0, 1] lies before and after all
    /// of them. Repeated times count once; times that are not finite are ignored.
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

    /// How to extrapolate at `time`; `None` between the first and the last time seen.
    pub fn extrapolation(&self, time: f32) -> Option<GapExtrapolation> {
        let first = self.0.first().filter(|gap| gap[0] == BEFORE_THE_CLIP);
        let last = self.0.last().filter(|gap| gap[1] == AFTER_THE_CLIP);
        let edge = match (first, last) {
            (Some(&[_, first]), _) if time < first => first,
            (_, Some(&[last, _])) if time > last => last,
            _ => return None,
        };
        let way = edge - time;
        let counts = |[from, to]: &&[f32; 2]| to - from >= SHORT * way.abs();
        let others = self.0.iter().filter(counts);
        let mirrored = if way > 0.0 {
            let next = others.map(|gap| gap[0]).filter(|t| *t >= edge);
            (edge + way).min(next.fold(1.0, f32::min))
        } else {
            let next = others.map(|gap| gap[1]).filter(|t| *t <= edge);
            (edge + way).max(next.fold(0.0, f32::max))
        };
        Some(GapExtrapolation { edge, mirrored })
    }

    /// How to interpolate at `time`; `None` unless it lies strictly inside a gap between two times seen.
    pub fn interpolation(&self, time: f32) -> Option<GapInterpolation> {
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
        Some(GapInterpolation {
            from,
            to,
            weight: (time - from) / length,
            observed: seen_before.min(seen_after).min(length),
        })
    }

    /// Whether there is no gap.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// Whether a gap lies between two times seen.
    pub fn any_closed(&self) -> bool {
        let closed = |[from, to]: &[f32; 2]| *from != BEFORE_THE_CLIP && *to != AFTER_THE_CLIP;
        self.0.iter().any(closed)
    }

    /// The number of gaps.
    pub fn len(&self) -> usize {
        self.0.len()
    }

    /// Whether all gaps lie in [0, 1] or are open, in rising order and without overlap.
    pub(crate) fn are_valid(&self) -> bool {
        let mut last = 0.0;
        self.0.iter().enumerate().all(|(index, &[from, to])| {
            let opens = index == 0 && from == BEFORE_THE_CLIP;
            let ends = index + 1 == self.0.len() && to == AFTER_THE_CLIP && from <= 1.0;
            let valid = (last <= from || opens) && from < to && (to <= 1.0 || ends);
            last = to;
            valid
        })
    }
}

#[cfg(test)]
mod tests;
