//! Extents of trajectories on the CPU: rows are independent, so any number of threads gives the same bits.
//!
//! Displacements are summed outwards from the time at which there is none, so that nothing cancels.

use rayon::prelude::*;

use super::{LARGEST, Polyline};
use crate::isa::finite_or_zero;

/// Trajectories of a parallel piece.
const PIECE: usize = 256;

/// What a span adds, along the axes.
type Addend = [f32; 3];

/// `coefficients [N, B * 3] -> [N]`, see [`squared_extent`](super::squared_extent).
pub fn squared_extent(coefficients: &[f32], polyline: Polyline) -> Vec<f32> {
    let width = polyline.width();
    let mut out = vec![0.0; coefficients.len() / width];
    out.par_chunks_mut(PIECE)
        .zip(coefficients.par_chunks(PIECE * width))
        .for_each(|(out, rows)| {
            for (out, row) in out.iter_mut().zip(rows.chunks_exact(width)) {
                let mut sums = [0.0; 3];
                let mut add = |at: Addend| {
                    for (sum, at) in sums.iter_mut().zip(at) {
                        *sum += at * at;
                    }
                };
                later(row, polyline, |_, at| add(at));
                earlier(row, polyline, |_, at| add(at));
                *out = sums.iter().sum::<f32>() * polyline.inverse_steady;
            }
        });
    out
}

/// `coefficients [N, B * 3], v_out [N] -> [N, B * 3]`.
pub fn squared_extent_vjp(coefficients: &[f32], v_out: &[f32], polyline: Polyline) -> Vec<f32> {
    let width = polyline.width();
    let mut gradient = vec![0.0; coefficients.len()];
    gradient
        .par_chunks_mut(PIECE * width)
        .zip(coefficients.par_chunks(PIECE * width))
        .zip(v_out.par_chunks(PIECE))
        .for_each(|((gradient, rows), v_out)| {
            let rows = rows.chunks_exact(width);
            for ((gradient, row), &v) in gradient.chunks_exact_mut(width).zip(rows).zip(v_out) {
                let factor = 2.0 * finite_or_zero(v) * polyline.inverse_steady;
                vjp_of_row(gradient, row, factor, polyline);
            }
        });
    gradient
}

/// A span moves every knot beyond it along: its gradient is the sum of their displacements.
fn vjp_of_row(gradient: &mut [f32], row: &[f32], factor: f32, polyline: Polyline) {
    let (sums, _) = gradient.as_chunks_mut::<3>();
    let (span, share) = (polyline.span, polyline.share);
    // Each knot's displacement, at the span whose far end it is; the anchor's span has two.
    let mut before = [0.0; 3];
    later(row, polyline, |k, at| sums[k] = at);
    earlier(row, polyline, |k, at| {
        if k == span {
            before = at;
        } else {
            sums[k] = at;
        }
    });
    let mut sum = [0.0; 3];
    for k in (span + 1..sums.len()).rev() {
        sum = plus(sum, sums[k]);
        sums[k] = sum;
    }
    let after = plus(sum, sums[span]);
    sum = [0.0; 3];
    for beyond in &mut sums[..span] {
        sum = plus(sum, *beyond);
        *beyond = sum;
    }
    before = plus(sum, before);
    sums[span] = std::array::from_fn(|a| (1.0 - share) * after[a] + share * before[a]);
    for value in gradient {
        *value = (*value * factor).clamp(f32::MIN, f32::MAX);
    }
}

/// The displacements at the knots after the anchor, the nearest first, with the spans that end there.
#[inline(always)]
fn later(row: &[f32], polyline: Polyline, mut visit: impl FnMut(usize, Addend)) {
    let (spans, _) = row.as_chunks::<3>();
    let mut at = [0.0; 3];
    for (k, &span) in spans.iter().enumerate().skip(polyline.span) {
        let part = if k == polyline.span {
            1.0 - polyline.share
        } else {
            1.0
        };
        at = on(at, span, part);
        visit(k, at);
    }
}

/// Those before it with the opposite sign, which a square does not see, and the spans that start there.
#[inline(always)]
fn earlier(row: &[f32], polyline: Polyline, mut visit: impl FnMut(usize, Addend)) {
    let (spans, _) = row.as_chunks::<3>();
    let mut at = [0.0; 3];
    for k in (0..=polyline.span).rev() {
        let part = if k == polyline.span {
            polyline.share
        } else {
            1.0
        };
        at = on(at, spans[k], part);
        visit(k, at);
    }
}

#[inline(always)]
fn on(at: Addend, span: Addend, part: f32) -> Addend {
    std::array::from_fn(|a| (at[a] + part * finite_or_zero(span[a])).clamp(-LARGEST, LARGEST))
}

#[inline(always)]
fn plus(a: Addend, b: Addend) -> Addend {
    std::array::from_fn(|axis| a[axis] + b[axis])
}
