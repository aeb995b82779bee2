//! Block matching: where fast Gaussians are in a frame that scene flow comes to.
//!
//! The gradient of a picture reaches as far as a Gaussian is wide. What is farther off, or what its velocity carries on
//! through the floor that it bounces off, is not drawn to its place. So groups of fast Gaussians are looked
//! for around where they were a frame before, in pictures of several cameras.

mod search;

use dash_model::{GaussianRows, SH_C0};
use glam::Vec3;
use rayon::prelude::*;

use self::search::{Group, Pair, groups, pairs};
use crate::Error;
use crate::train::core::Run;
use crate::train::paper::Dash;

/// Motion from one frame to the next, in shares of the image's width, from which on Gaussians are looked for.
const MIN_MOTION: f32 = 0.015;
/// Gaussians more transparent than this are not asked.
const MIN_OPACITY: f32 = 0.2;

/// What is known before a new frame.
pub(super) struct Ahead {
    /// Its time.
    pub(super) time: f32,
    /// The times of known frames, nearest first.
    pub(super) known: Vec<f32>,
    /// Where all Gaussians were in each of them.
    pub(super) before: Vec<Vec<Vec3>>,
    /// Where they are expected in the new one.
    pub(super) expected: Vec<Vec3>,
    /// How far each is looked for if its own velocity says less, world units; 0 where that is all that counts.
    pub(super) reach: Vec<f32>,
}

/// Fast Gaussians that pictures show elsewhere than expected, and how far that is from where they were in the last known frame.
pub(super) fn find(run: &Run<Dash>, ahead: &Ahead) -> Result<Vec<(usize, Vec3)>, Error> {
    let Ahead {
        time,
        known,
        before,
        expected,
        reach,
    } = ahead;
    let Some(last) = before.first() else {
        return Ok(Vec::new());
    };
    let earlier = before.get(1).unwrap_or(last);
    // Ways in the time from the last frame to the new one.
    let ratio = |k: usize| (time - known[0]) / (known[k] - known[k + 1]);
    let last_ratio = if before.len() > 1 { ratio(0) } else { 0.0 };
    let ways: Vec<Vec3> = last
        .iter()
        .zip(earlier)
        .map(|(&last, &earlier)| (last - earlier) * last_ratio)
        .collect();
    let rows = run.scene.static_set.to_rows();
    let speeds: Vec<f32> = (0..rows.len())
        .map(|row| {
            let of = |k: usize| (before[k][row] - before[k + 1][row]).length() * ratio(k).abs();
            (0..known.len() - 1).map(of).fold(reach[row], f32::max)
        })
        .collect();
    let fast = fast(run, &rows, &speeds, reach, |row| {
        last[row].is_finite() && expected[row].is_finite()
    });
    if fast.is_empty() {
        return Ok(Vec::new());
    }
    let pairs: Vec<Pair> = pairs(run, [known[0], *time])?;
    let found: Vec<(Vec<usize>, Vec3)> = groups(&fast, last, &ways)
        .into_par_iter()
        .filter_map(|members| {
            let group = Group {
                members: &members,
                last,
                ways: &ways,
                speeds: &speeds,
            };
            let color = |row: usize| rows.sh_dc[row].map(|v| 0.5 + SH_C0 * v);
            let shift = group.find(&pairs, color, expected)?;
            Some((members, shift))
        })
        .collect();
    let each = found.into_iter();
    let each = each.flat_map(|(members, shift)| members.into_iter().map(move |row| (row, shift)));
    Ok(each.collect())
}

/// Gaussians that can be seen and have moved fast on the screen.
fn fast(
    run: &Run<Dash>,
    rows: &GaussianRows,
    speeds: &[f32],
    reach: &[f32],
    is_finite: impl Fn(usize) -> bool,
) -> Vec<usize> {
    let scales = run.method.mean_scales();
    let limit = dash_model::logit(MIN_OPACITY);
    (0..rows.len())
        .filter(|&row| {
            (reach[row] > 0.0 || speeds[row] * scales[row] >= MIN_MOTION)
                && rows.opacity_logits[row] >= limit
                && is_finite(row)
        })
        .collect()
}

#[cfg(test)]
pub(super) mod tests;
