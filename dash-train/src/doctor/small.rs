//! Pictures made small, and what changes from one to the next.

use crate::dataset::View;
use crate::numbers::median;

/// Longer side of the small pictures that are compared.
const SMALL_SIDE: usize = 96;
/// Pixels that are compared exactly.
const EXACT_SAMPLES: usize = 4096;
/// Brightness above which a pixel tells about exposure, and below which about clipping.
const EXPOSED: [f32; 2] = [0.06, 0.94];
/// Share of the small picture that must be exposed for a change of brightness to mean something.
const MIN_EXPOSED: f64 = 0.05;
/// Logarithm of a factor that is next to none.
const NO_CHANGE: f64 = 0.01;
/// A common factor is known to this part of its logarithm (median deviation).
const SPREAD: f64 = 0.35;
/// Least change of a small picture's pixel that is motion, not noise.
pub(super) const MOVED: f32 = 0.04;
/// The change that is motion where pictures are noisy, in standard deviations of the noise.
const ABOVE_NOISE: f32 = 6.0;
/// The quarter of the changes by noise that are the smallest are below so many standard deviations.
const SMALLEST_QUARTER: f32 = 0.3186;
/// Most change that noise explains: above it, all of the picture moves.
const MOST_BY_NOISE: f32 = 0.25;

/// What changes between two successive pictures of a track.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Step {
    /// Mean absolute change of brightness.
    pub(super) energy: f64,
    /// Share of the picture that changes visibly.
    pub(super) moved: f64,
    /// Share of the pixels that have exactly the same colour.
    pub(super) same: f64,
    /// The factor by which most of the picture gets brighter; `None` where it is too dark to tell, and
    /// where parts change by different factors, as they do by motion.
    pub(super) gain: Option<f64>,
}

/// A picture made small, and some of its pixels as they are.
pub(super) struct Small {
    pub(super) luma: Vec<f32>,
    exact: Vec<[f32; 3]>,
}

impl Small {
    pub(super) fn of(view: &View, rgb: &[f32]) -> Self {
        let (width, height) = (view.camera.width, view.camera.height);
        let block = width.max(height).div_ceil(SMALL_SIDE).max(1);
        let mut luma = Vec::with_capacity((width / block + 1) * (height / block + 1));
        for top in (0..height).step_by(block) {
            for left in (0..width).step_by(block) {
                let (mut sum, mut count) = (0.0, 0.0);
                for y in top..(top + block).min(height) {
                    let row =
                        &rgb[3 * (y * width + left)..3 * (y * width + (left + block).min(width))];
                    sum += row.iter().sum::<f32>() / 3.0;
                    count += (row.len() / 3) as f32;
                }
                luma.push(sum / count);
            }
        }
        let stride = (width * height).div_ceil(EXACT_SAMPLES).max(1);
        let exact = rgb
            .chunks_exact(3)
            .step_by(stride)
            .map(|p| [p[0], p[1], p[2]]);
        Self {
            luma,
            exact: exact.collect(),
        }
    }

    /// How much each pixel differs from an earlier picture's.
    pub(super) fn changes_from(&self, before: &Self) -> impl Iterator<Item = f32> {
        let pairs = before.luma.iter().zip(&self.luma);
        pairs.map(|(a, b)| (b - a).abs())
    }

    /// What changes from this picture to the next.
    pub(super) fn step_to(&self, next: &Self) -> Step {
        let n = self.luma.len().min(next.luma.len()).max(1) as f64;
        let changes = || next.changes_from(self);
        let least = noise_limit(changes().collect());
        let moved = changes().filter(|&change| change > least).count() as f64 / n;
        let same = self
            .exact
            .iter()
            .zip(&next.exact)
            .filter(|(a, b)| a == b)
            .count();
        let exposed = |v: f32| (EXPOSED[0]..EXPOSED[1]).contains(&v);
        let ratios: Vec<f64> = self
            .luma
            .iter()
            .zip(&next.luma)
            .filter(|(a, b)| exposed(**a) && exposed(**b))
            .map(|(a, b)| f64::from(b / a).ln())
            .collect();
        let enough = ratios.len() as f64 >= MIN_EXPOSED * n;
        Step {
            energy: changes().map(f64::from).sum::<f64>() / n,
            moved,
            same: same as f64 / self.exact.len().max(1) as f64,
            gain: enough.then(|| common(ratios)).flatten(),
        }
    }
}

/// The least change that is motion among `changes`. What moves is a part of the picture, or changes by very different
/// amounts; noise is everywhere and alike.
fn noise_limit(mut changes: Vec<f32>) -> f32 {
    let quarter = changes.len() / 4;
    if quarter == 0 {
        return MOVED;
    }
    let smallest = *changes.select_nth_unstable_by(quarter, f32::total_cmp).1;
    (ABOVE_NOISE * smallest / SMALLEST_QUARTER).clamp(MOVED, MOST_BY_NOISE)
}

/// The factor that is common to logarithms of ratios, if there is one.
fn common(ratios: Vec<f64>) -> Option<f64> {
    let middle = median(ratios.clone())?;
    let spread = median(ratios.into_iter().map(|r| (r - middle).abs()))?;
    (middle.abs() < NO_CHANGE || spread < SPREAD * middle.abs()).then(|| middle.exp())
}
