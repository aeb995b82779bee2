//! What changes over a whole clip: of what moves slowly, little does from one frame to the next.

use super::small::{MOVED, Small};
use crate::numbers::median;

/// Spans of the clip whose means are compared.
const SPANS: usize = 8;
/// Means of spans differ by motion when they do so by this many of their standard deviations: the range of eight
/// normal values exceeds it once in ten million.
const ABOVE_NOISE: f64 = 8.0;
/// How much noisier than usual a pixel may be.
const NOISIEST: f64 = 3.0;
/// From the mean size of the difference of two normal values to the standard deviation of one.
const DEVIATION: f64 = 0.886;

/// The sums that a clip's small pictures are gathered into.
pub(super) struct Span {
    /// Of each span, of each pixel.
    sums: Vec<Vec<f64>>,
    counts: Vec<f64>,
    /// Of the changes from frame to frame.
    change: Vec<f64>,
    n_changes: f64,
    n_frames: usize,
}

impl Span {
    /// Of a clip of so many frames.
    pub(super) fn new(n_frames: usize) -> Self {
        let spans = n_frames.clamp(1, SPANS);
        Self {
            sums: vec![Vec::new(); spans],
            counts: vec![0.0; spans],
            change: Vec::new(),
            n_changes: 0.0,
            n_frames: n_frames.max(1),
        }
    }

    /// Takes in a picture, the `index`th of the clip, and its change from the one `before`. `gain`: how much brighter
    /// than the first all of it is.
    pub(super) fn add(&mut self, index: usize, picture: &Small, before: Option<&Small>, gain: f64) {
        let values = || picture.luma.iter().map(|&v| f64::from(v) / gain);
        let span = index * self.sums.len() / self.n_frames;
        let sums = &mut self.sums[span];
        sums.resize(picture.luma.len(), 0.0);
        sums.iter_mut().zip(values()).for_each(|(sum, v)| *sum += v);
        self.counts[span] += 1.0;
        if let Some(before) = before {
            self.change.resize(picture.luma.len(), 0.0);
            let changes = picture
                .changes_from(before)
                .map(|change| f64::from(change) / gain);
            self.change
                .iter_mut()
                .zip(changes)
                .for_each(|(sum, c)| *sum += c);
            self.n_changes += 1.0;
        }
    }

    /// Share of the picture that is not the same in all spans of the clip, by more than sensor noise.
    pub(super) fn moved(&self) -> f64 {
        let spans: Vec<(&[f64], f64)> = self
            .sums
            .iter()
            .zip(&self.counts)
            .filter(|(_, count)| **count > 0.0)
            .map(|(sums, count)| (sums.as_slice(), *count))
            .collect();
        let fewest = spans
            .iter()
            .map(|(_, count)| *count)
            .fold(f64::INFINITY, f64::min);
        let n = self.change.len();
        // What moves also changes from frame to frame, more than most.
        let usual = median(self.change.iter().copied()).unwrap_or(0.0);
        let moves = |pixel: usize| {
            let means = || {
                spans
                    .iter()
                    .filter_map(|(sums, n)| Some(sums.get(pixel)? / n))
            };
            let range = means().fold(0.0, f64::max) - means().fold(f64::INFINITY, f64::min);
            let change = self.change[pixel].min(NOISIEST * usual);
            let noise = DEVIATION * change / self.n_changes / fewest.sqrt();
            range > f64::from(MOVED).max(ABOVE_NOISE * noise)
        };
        (0..n).filter(|&pixel| moves(pixel)).count() as f64 / n.max(1) as f64
    }
}
