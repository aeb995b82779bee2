//! Windows of time: parts of a clip that overlap, each a scene of its own.

use serde::{Deserialize, Serialize};

/// When each window of a clip begins and ends, in [0, 1] over the clip. Where two overlap, one fades into the next.
///
/// # Example
/// ```
/// use dash_model::TimeWindows;
///
/// let windows = TimeWindows::new(vec![[0.0, 0.625], [0.375, 1.0]]);
/// assert_eq!(windows.shares(0.2), [(0, 1.0)]);
/// // Each window has times of its own.
/// assert_eq!(windows.local(1, 0.6875), 0.5);
/// ```
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct TimeWindows(Vec<[f32; 2]>);

impl TimeWindows {
    /// Windows in the order of time, of which each begins before the one before it ends.
    ///
    /// # Panics
    /// Without any window.
    pub fn new(spans: Vec<[f32; 2]>) -> Self {
        assert!(!spans.is_empty(), "a clip has at least one window");
        Self(spans)
    }

    /// One window: the whole clip.
    pub fn whole() -> Self {
        Self(vec![[0.0, 1.0]])
    }

    /// How many there are.
    #[expect(clippy::len_without_is_empty, reason = "there is always one")]
    pub fn len(&self) -> usize {
        self.0.len()
    }

    /// How long a window is, as a share of the clip.
    pub fn duration(&self, window: usize) -> f32 {
        let [from, to] = self.0[window];
        to - from
    }

    /// A time of the clip as one of a window, in [0, 1].
    pub fn local(&self, window: usize, time: f32) -> f32 {
        let [from, to] = self.0[window];
        ((time - from) / (to - from)).clamp(0.0, 1.0)
    }

    /// The windows that show a time of the clip, and the share of each in the picture; the shares add up to 1.
    pub fn shares(&self, time: f32) -> Vec<(usize, f32)> {
        for k in 0..self.len() - 1 {
            let [from, to] = self.fade(k);
            if time <= from {
                return vec![(k, 1.0)];
            }
            if time < to {
                let share = (time - from) / (to - from);
                return vec![(k, 1.0 - share), (k + 1, share)];
            }
        }
        vec![(self.len() - 1, 1.0)]
    }

    /// From when to when a window fades into the next: in the middle of what both show, before the next fade begins.
    fn fade(&self, k: usize) -> [f32; 2] {
        let end = |k: usize| self.0[k][1];
        let begin = |k: usize| self.0[k][0];
        let middle = |k: usize| 0.5 * (end(k) + begin(k + 1));
        let mut width = end(k) - begin(k + 1);
        if k > 0 {
            width = width.min(middle(k) - middle(k - 1));
        }
        if k + 2 < self.len() {
            width = width.min(middle(k + 1) - middle(k));
        }
        let half = 0.5 * width.max(0.0);
        [middle(k) - half, middle(k) + half]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_window_fades_into_the_next() {
        let spans = [(0, 4), (2, 6), (5, 8)];
        let spans = spans.map(|(first, last)| [first as f32 / 8.0, last as f32 / 8.0]);
        let windows = TimeWindows::new(spans.to_vec());
        let at = |frame: f32| windows.shares(frame / 8.0);
        assert_eq!(at(0.0), [(0, 1.0)]);
        assert_eq!(at(1.5), [(0, 1.0)]);
        assert_eq!(at(3.0), [(0, 0.5), (1, 0.5)]);
        assert_eq!(at(4.0), [(1, 1.0)]);
        assert_eq!(at(5.25), [(1, 0.75), (2, 0.25)]);
        assert_eq!(at(8.0), [(2, 1.0)]);
        let mut before = 0.0;
        for step in 0..=800 {
            let shares = at(step as f32 / 100.0);
            let sum: f32 = shares.iter().map(|(_, share)| share).sum();
            assert!((sum - 1.0).abs() < 1e-6, "{shares:?}");
            let middle: f32 = shares.iter().map(|(k, share)| *k as f32 * share).sum();
            assert!((0.0..0.02).contains(&(middle - before)), "a jump at {step}");
            before = middle;
        }
        assert_eq!(windows.local(1, 0.25), 0.0);
        assert_eq!(windows.local(1, 0.5), 0.5);
        assert_eq!(windows.duration(1), 0.5);
        assert_eq!(TimeWindows::whole().shares(0.3), [(0, 1.0)]);
    }
}
