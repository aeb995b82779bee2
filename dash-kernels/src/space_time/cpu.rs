//! Points of the unit cube on the CPU: rows are independent, so any number of threads gives the same bits.

use rayon::prelude::*;

use super::{AXES, Bounds, WIDTH};
use crate::isa::{Kernel, dispatch, finite_or_zero};

/// Positions of a parallel piece.
const PIECE: usize = 4096;

/// `positions [N, 3] -> [N, 4]`, see [`space_time`](super::space_time).
pub fn space_time(positions: &[f32], bounds: &Bounds, time: f32) -> Vec<f32> {
    let mut out = vec![0.0; positions.len() / AXES * WIDTH];
    out.par_chunks_mut(PIECE * WIDTH)
        .zip(positions.par_chunks(PIECE * AXES))
        .for_each(|(out, positions)| {
            dispatch(Forward {
                out,
                positions,
                bounds,
                time,
            })
        });
    out
}

/// Appends points beside those of `rows`, by `steps [M, 4]`. See [`space_time_beside`](super::space_time_beside).
pub fn add_beside(points: &mut Vec<f32>, steps: &[f32], rows: &[u32]) {
    let (steps, _) = steps.as_chunks::<WIDTH>();
    for (step, &row) in steps.iter().zip(rows) {
        for (axis, by) in step.iter().enumerate() {
            let beside = points[row as usize * WIDTH + axis] + by;
            points.push(finite_or_zero(beside).clamp(0.0, 1.0));
        }
    }
}

struct Forward<'a> {
    out: &'a mut [f32],
    positions: &'a [f32],
    bounds: &'a Bounds,
    time: f32,
}

impl Kernel for Forward<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let (rows, _) = self.out.as_chunks_mut::<WIDTH>();
        let (positions, _) = self.positions.as_chunks::<AXES>();
        let highest = if self.bounds.clamp { 1.0 } else { f32::MAX };
        let lowest = if self.bounds.clamp { 0.0 } else { f32::MIN };
        for (row, position) in rows.iter_mut().zip(positions) {
            let [x, y, z] =
                [0, 1, 2].map(|axis| along(position, self.bounds, axis).clamp(lowest, highest));
            *row = [x, y, z, self.time];
        }
    }
}

/// `positions [N, 3]`, `v_out [N, 4] -> [N, 3]`.
pub fn space_time_vjp(positions: &[f32], v_out: &[f32], bounds: &Bounds) -> Vec<f32> {
    let mut gradient = vec![0.0; positions.len()];
    gradient
        .par_chunks_mut(PIECE * AXES)
        .zip(positions.par_chunks(PIECE * AXES))
        .zip(v_out.par_chunks(PIECE * WIDTH))
        .for_each(|((gradient, positions), v_out)| {
            let (rows, _) = gradient.as_chunks_mut::<AXES>();
            let (positions, _) = positions.as_chunks::<AXES>();
            let (v_out, _) = v_out.as_chunks::<WIDTH>();
            for ((row, position), v) in rows.iter_mut().zip(positions).zip(v_out) {
                for axis in 0..AXES {
                    let inside = (0.0..=1.0).contains(&along(position, bounds, axis));
                    if inside || !bounds.clamp {
                        let v = finite_or_zero(v[axis]) * bounds.scale[axis];
                        row[axis] = v.clamp(f32::MIN, f32::MAX);
                    }
                }
            }
        });
    gradient
}

#[inline(always)]
fn along(position: &[f32; AXES], bounds: &Bounds, axis: usize) -> f32 {
    if position[axis].abs() < f32::INFINITY {
        (position[axis] - bounds.min[axis]) * bounds.scale[axis]
    } else {
        0.0
    }
}
