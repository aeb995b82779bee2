//! Costs by coverage on the CPU: worked out in f64. Sums of pieces are added in their order, so any number of threads
//! gives the same bits.

use rayon::prelude::*;

use super::{AT_REST, FloaterWeights, NEAR, NEAREST, PictureSize};
use crate::splats::{
    CONIC_A, CONIC_B, CONIC_C, DEPTH, MEAN_X, MEAN_Y, N_COLUMNS, OPACITY, RADIUS_X, RADIUS_Y,
};

/// Gaussians of a parallel piece.
const PIECE: usize = 4096;

/// What a picture shows of a Gaussian; all zero of one that is not drawn.
#[derive(Debug, Clone, Copy, Default)]
struct Drawn {
    opacity: f64,
    /// Of the picture, at most all of it; what lies beside it counts.
    share: f64,
    /// The part of `share` in the picture.
    inside: f64,
    /// How large a world unit appears there, in shares of the picture's width.
    scale: f64,
}

impl Drawn {
    fn of(splat: &[f32; N_COLUMNS], picture: PictureSize) -> Self {
        let value = |column: usize| f64::from(splat[column]);
        let size = [picture.width, picture.height].map(f64::from);
        let det = value(CONIC_A) * value(CONIC_C) - value(CONIC_B) * value(CONIC_B);
        let share = (1.0 / det.sqrt() / (size[0] * size[1])).min(1.0);
        let inside = part_inside(value(MEAN_X), value(RADIUS_X), size[0])
            * part_inside(value(MEAN_Y), value(RADIUS_Y), size[1]);
        let drawn = Self {
            opacity: value(OPACITY).clamp(0.0, 1.0),
            share,
            inside: share * inside,
            scale: f64::from(picture.focal) / value(DEPTH),
        };
        let shown = value(RADIUS_X) > 0.0 && value(DEPTH) > 0.0 && det > 0.0;
        let numbers = [drawn.opacity, drawn.scale, drawn.inside];
        match shown && numbers.iter().all(|&number| (number as f32).is_finite()) {
            true => drawn,
            false => Self::default(),
        }
    }
}

/// How much of `mean` +- `radius` lies in [0, `size`].
fn part_inside(mean: f64, radius: f64, size: f64) -> f64 {
    let (from, to) = ((mean - radius).max(0.0), (mean + radius).min(size));
    ((to - from) / (2.0 * radius)).clamp(0.0, 1.0)
}

/// The sum over rows of what `cost_and_slope` says of each, and the slopes.
fn sum_of_rows(n: usize, cost_and_slope: impl Fn(usize) -> (f64, f64) + Sync) -> (f32, Vec<f32>) {
    let mut slopes = vec![0.0; n];
    let pieces = slopes.par_chunks_mut(PIECE).enumerate();
    let costs: Vec<f64> = pieces
        .map(|(piece, slopes)| {
            let mut sum = 0.0;
            for (k, out) in slopes.iter_mut().enumerate() {
                let (cost, slope) = cost_and_slope(piece * PIECE + k);
                sum += cost;
                *out = slope as f32;
            }
            sum
        })
        .collect();
    (costs.iter().sum::<f64>() as f32, slopes)
}

/// The cost and its gradient to the extents. See [`visible_motion`](super::visible_motion).
pub fn visible_motion(
    extents: &[f32],
    splats: &[f32],
    picture: PictureSize,
    far: f32,
) -> (f32, Vec<f32>) {
    let (splats, _) = splats.as_chunks::<N_COLUMNS>();
    sum_of_rows(extents.len(), |row| {
        let drawn = Drawn::of(&splats[row], picture);
        if !extents[row].is_finite() {
            return (0.0, 0.0);
        }
        let weight = drawn.opacity * drawn.share;
        let motion = f64::from(extents[row]) * drawn.scale;
        let damped = 1.0 + motion / f64::from(far);
        (
            weight * motion / damped,
            weight * drawn.scale / (damped * damped),
        )
    })
}

/// The mean disparity of what is covered; `None` where nothing is.
fn typical_disparity(splats: &[[f32; N_COLUMNS]], picture: PictureSize) -> Option<f64> {
    let pieces = splats.par_chunks(PIECE).map(|splats| {
        let drawn = splats.iter().map(|splat| Drawn::of(splat, picture));
        drawn.fold([0.0; 2], |[covered, near], drawn| {
            let covers = drawn.opacity * drawn.inside;
            [covered + covers, near + covers * drawn.scale]
        })
    });
    let pieces: Vec<[f64; 2]> = pieces.collect();
    let [covered, near] = [0, 1].map(|k| pieces.iter().map(|piece| piece[k]).sum::<f64>());
    let typical = near / covered;
    (typical > 0.0 && typical.is_finite()).then_some(typical)
}

/// The cost and its gradient to the logits. See [`floater_cost`](super::floater_cost).
pub fn floater_cost(
    opacity_logits: &[f32],
    splats: &[f32],
    motion: Option<&[f32]>,
    picture: PictureSize,
    weights: FloaterWeights,
) -> (f32, Vec<f32>) {
    let (splats, _) = splats.as_chunks::<N_COLUMNS>();
    let of_nearness = f64::from(weights.nearness);
    let typical = match weights.nearness > 0.0 {
        true => typical_disparity(splats, picture),
        false => None,
    };
    let [nearer, nearest, at_rest] = [NEAR, NEAREST, AT_REST].map(f64::from);
    let nearness = |row: usize| {
        let Some(typical) = typical else {
            return 0.0;
        };
        let drawn = Drawn::of(&splats[row], picture);
        let near = (drawn.scale / typical).powi(2) - nearer * nearer;
        if near <= 0.0 {
            return 0.0;
        }
        let moved = motion.map_or(0.0, |motion| motion[row]);
        let moved = match moved.is_finite() {
            true => f64::from(moved) * drawn.scale,
            false => 0.0,
        };
        drawn.inside * near.min(nearest) / (1.0 + moved / at_rest)
    };
    let share = f64::from(weights.opacity) / opacity_logits.len() as f64;
    sum_of_rows(opacity_logits.len(), |row| {
        if !opacity_logits[row].is_finite() {
            return (0.0, 0.0);
        }
        let weight = share + of_nearness * nearness(row);
        let opacity = 1.0 / (1.0 + (-f64::from(opacity_logits[row])).exp());
        (opacity * weight, opacity * (1.0 - opacity) * weight)
    })
}
