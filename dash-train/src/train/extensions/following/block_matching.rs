//! Block matching: where fast Gaussians are when the window of time reaches a new frame.
//!
//! The gradient of a picture reaches as far as a Gaussian is wide. What is farther off, or what a trajectory carries on
//! through the floor that it bounces off, fades instead of being drawn to its place. So groups of fast Gaussians are looked
//! for around where they were a frame before, in pictures of several cameras, and the coarse field is taught what is found
//! before its first step on the new frame.

mod memory;
mod search;

use burn::tensor::{Int, Tensor, TensorData};
use dash_model::{GaussianRows, SH_C0, TrajectoryBasis};
use glam::Vec3;
use rayon::prelude::*;

use self::memory::{MEMBERS, Place};
pub(super) use self::memory::{Memory, NUMBERS};
use self::search::{Found, Group, Pair, groups, pairs};
use super::window::time_window;
use crate::Error;
use crate::train::core::{Optimizer, Run, TimeSpan, to_host};
use crate::train::paper::Dash;

/// Motion from one frame to the next, in shares of the image's width, from which on Gaussians are looked for.
const MIN_MOTION: f32 = 0.015;

/// Gaussians more transparent than this are not asked.
const MIN_OPACITY: f32 = 0.2;
/// Frames before the new one whose fastest way counts: what bounces is slow for a moment.
const MEMORY: usize = 4;
/// Other Gaussians that keep their trajectories while the field is taught, at most.
const KEPT: usize = 2_000;
/// Steps in which it is taught, at most, and the share of what it was off that is little enough.
const STEPS: usize = 40;
const TAUGHT: f32 = 0.1;
/// How far from where it was found a Gaussian may be at no cost, in units of its fastest way of late.
const TOLERANCE: f32 = 0.5;
/// A span leads to a time by itself if it has this share of it behind it; what has less would have to jump.
const MIN_SPAN: f32 = 0.5;
/// What changing a span costs beside where it moves the last known frame, as a square.
const SPAN_COST: f32 = 0.1;

/// Looks for fast Gaussians in frames that the window reaches with this step. Where one time does not show the scene from
/// several sides, pictures do not tell where anything is.
pub(super) fn meet_new_frames(run: &mut Run<Dash>, memory: &mut Memory) -> Result<(), Error> {
    let (Some(span), Some(before)) = (run.start, run.step.checked_sub(1)) else {
        return Ok(());
    };
    if run.method.motion.is_none() || !span.is_one_time() {
        return Ok(());
    }
    let [now, then] = [run.step, before].map(|step| time_window(run, step));
    let holds = |window: Option<(TimeSpan, TimeSpan)>, time: f32| {
        window.is_none_or(|(window, _)| window.holds(time))
    };
    let times = run.times.all();
    let new: Vec<usize> = (0..times.len())
        .filter(|&k| holds(now, times[k]) && !holds(then, times[k]))
        .collect();
    if new.is_empty() {
        return Ok(());
    }
    let times = times.to_vec();
    for at in new {
        let nearer = |k: usize| {
            let index = if times[at] > span.middle() {
                at.checked_sub(k)
            } else {
                Some(at + k)
            };
            index.and_then(|index| times.get(index).copied())
        };
        let known: Vec<f32> = (1..=MEMORY).map_while(nearer).collect();
        meet(run, memory, times[at], &known)?;
    }
    Ok(())
}

/// Looks for fast Gaussians at a new time, after some known ones, nearest first.
fn meet(run: &mut Run<Dash>, memory: &mut Memory, new: f32, known: &[f32]) -> Result<(), Error> {
    let Some(coefficients) = run.coefficients()? else {
        return Ok(());
    };
    let coefficients = coefficients.detach();
    let basis = run.method.basis;
    let rows = run.scene.static_set.to_rows();
    let places_at = |time: f32| -> Result<Vec<Vec3>, Error> {
        let moved = to_host(basis.displacement(coefficients.clone(), time)?);
        let moved = moved.chunks_exact(3).map(Vec3::from_slice);
        let places = rows.means.iter().zip(moved);
        Ok(places
            .map(|(&mean, moved)| Vec3::from(mean) + moved)
            .collect())
    };
    let expected = places_at(new)?;
    let before = known.iter().map(|&time| places_at(time));
    let before = before.collect::<Result<Vec<_>, _>>()?;
    let [last, earlier, ..] = before.as_slice() else {
        return Ok(());
    };
    // Ways in the time from the last frame to the new one.
    let pace = |k: usize| (new - known[0]) / (known[k] - known[k + 1]);
    let ways: Vec<Vec3> = last
        .iter()
        .zip(earlier)
        .map(|(&last, &earlier)| (last - earlier) * pace(0))
        .collect();
    let speeds: Vec<f32> = (0..rows.len())
        .map(|row| {
            let of = |k: usize| (before[k][row] - before[k + 1][row]).length() * pace(k).abs();
            (0..known.len() - 1).map(of).fold(0.0, f32::max)
        })
        .collect();
    let fast = fast(run, &rows, &speeds, |row| {
        last[row].is_finite() && expected[row].is_finite()
    });
    if fast.is_empty() {
        return Ok(());
    }
    let pairs: Vec<Pair> = pairs(run, [known[0], new])?;
    let found: Vec<(Vec<usize>, Found)> = groups(&fast, last, &ways)
        .into_par_iter()
        .filter_map(|members| {
            let group = Group {
                members: &members,
                last,
                ways: &ways,
                speeds: &speeds,
            };
            let color = |row: usize| rows.sh_dc[row].map(|v| 0.5 + SH_C0 * v);
            let found = group.find(&pairs, color, &expected)?;
            Some((members, found))
        })
        .collect();
    let displaced = |row: usize, shift: Vec3| last[row] + shift - Vec3::from(rows.means[row]);
    for (members, found) in found.iter().filter(|(_, found)| found.is_certain) {
        let places = members.iter().step_by(members.len().div_ceil(MEMBERS));
        memory.add(places.map(|&row| Place {
            point: rows.means[row],
            displacement: displaced(row, found.shift).to_array(),
            time: new,
            tolerance: TOLERANCE * speeds[row],
        }));
    }
    let moved: Vec<(usize, Vec3)> = found
        .into_iter()
        .flat_map(|(members, found)| members.into_iter().map(move |row| (row, found.shift)))
        .map(|(row, shift)| (row, displaced(row, shift)))
        .collect();
    if moved.is_empty() {
        return Ok(());
    }
    teach(run, &moved, coefficients, [known[0], new])
}

/// Gaussians that can be seen and have moved fast on the screen.
fn fast(
    run: &Run<Dash>,
    rows: &GaussianRows,
    speeds: &[f32],
    is_finite: impl Fn(usize) -> bool,
) -> Vec<usize> {
    let scales = run.method.statistics.means();
    let limit = dash_model::logit(MIN_OPACITY);
    (0..rows.len())
        .filter(|&row| {
            speeds[row] * scales[row] >= MIN_MOTION
                && rows.opacity_logits[row] >= limit
                && is_finite(row)
        })
        .collect()
}

/// Teaches the coarse field where some Gaussians are displaced to at the second of two times, and the trajectories that
/// others had.
fn teach(
    run: &mut Run<Dash>,
    moved: &[(usize, Vec3)],
    coefficients: Tensor<2>,
    times: [f32; 2],
) -> Result<(), Error> {
    let device = coefficients.device();
    let [total, width] = coefficients.dims();
    let mut is_moved = vec![false; total];
    moved.iter().for_each(|&(row, _)| is_moved[row] = true);
    let others: Vec<usize> = (0..total).filter(|&row| !is_moved[row]).collect();
    let kept = others.iter().step_by(others.len().div_ceil(KEPT).max(1));
    let rows: Vec<i32> = moved
        .iter()
        .map(|(row, _)| row)
        .chain(kept)
        .map(|&row| row as i32)
        .collect();
    let (n, all) = (moved.len(), rows.len());
    let rows = Tensor::<1, Int>::from_data(TensorData::new(rows, [all]), &device);
    let means = run.scene.static_set.means.val().detach();
    let means = means.select(0, rows.clone());
    let mut targets = to_host(coefficients.select(0, rows));
    for ((_, to), target) in moved.iter().zip(targets.chunks_exact_mut(width)) {
        lead_to(run.method.basis, target, *to, times);
    }
    // What is not finite is left to the guard of the step.
    if targets.iter().any(|value| !value.is_finite()) {
        return Ok(());
    }
    let Some(mut field) = run.method.motion.take() else {
        return Ok(());
    };
    let targets = Tensor::<2>::from_data(TensorData::new(targets, [all, width]), &device);
    let unit = run.extent * run.extent;
    let mut optimizer = Optimizer::default();
    let mut first = None;
    for _ in 0..STEPS {
        let off = (field.coefficients(means.clone())? - targets.clone()).powi_scalar(2) / unit;
        let of_moved = off.clone().narrow(0, 0, n).sum() / n as f32;
        let left = to_host(of_moved.clone())[0];
        if !left.is_finite() || left <= TAUGHT * TAUGHT * *first.get_or_insert(left) {
            break;
        }
        let loss = if all > n {
            of_moved + off.narrow(0, n, all - n).sum() / (all - n) as f32
        } else {
            of_moved
        };
        let mut gradients = loss.backward();
        field = optimizer.step("motion", field, &mut gradients, |name| {
            run.method.motion_rate(1.0, name)
        });
    }
    run.method.motion = Some(field);
    Ok(())
}

/// Changes a trajectory `coefficients [B * 3]` so that it displaces to a place at the second of two times: by the last
/// span on the way there, or the last two where that has hardly begun, and as little as can be at the first time.
fn lead_to(basis: TrajectoryBasis, coefficients: &mut [f32], to: Vec3, [known, time]: [f32; 2]) {
    let (weights, at_known) = (basis.at(time), basis.at(known));
    let mut off = to;
    for (weight, part) in weights.iter().zip(coefficients.chunks_exact(3)) {
        off -= *weight * Vec3::from_slice(part);
    }
    let mut spans: Vec<usize> = (0..weights.len()).filter(|&k| weights[k] != 0.0).collect();
    if time > basis.anchor() {
        spans.reverse();
    }
    let leads_alone = |k: &usize| weights[*k].abs() >= MIN_SPAN;
    let used = if spans.first().is_some_and(leads_alone) {
        1
    } else {
        2
    };
    spans.truncate(used);
    let share = |k: usize| weights[k] / (at_known[k].powi(2) + SPAN_COST);
    let norm: f32 = spans.iter().map(|&k| weights[k] * share(k)).sum();
    for k in spans {
        for (axis, value) in coefficients[3 * k..3 * k + 3].iter_mut().enumerate() {
            *value += off[axis] * share(k) / norm;
        }
    }
}

#[cfg(test)]
mod tests;
