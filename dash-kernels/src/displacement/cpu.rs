//! Displacements on the CPU: rows are independent, so any number of threads gives the same bits.

use rayon::prelude::*;

use super::AXES;
use crate::isa::{Kernel, dispatch, finite_or_zero};

/// Trajectories of a parallel piece.
const PIECE: usize = 256;

/// `coefficients [N, B * 3] -> [N, 3]`, see [`displacement`](super::displacement).
pub fn displacement(coefficients: &[f32], basis: &[f32]) -> Vec<f32> {
    let width = AXES * basis.len();
    let mut out = vec![0.0; coefficients.len() / width * AXES];
    out.par_chunks_mut(PIECE * AXES)
        .zip(coefficients.par_chunks(PIECE * width))
        .for_each(|(out, rows)| dispatch(Piece { out, rows, basis }));
    out
}

struct Piece<'a> {
    out: &'a mut [f32],
    rows: &'a [f32],
    basis: &'a [f32],
}

impl Kernel for Piece<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let rows = self.rows.chunks_exact(AXES * self.basis.len());
        let (out, _) = self.out.as_chunks_mut::<AXES>();
        for (out, row) in out.iter_mut().zip(rows) {
            let (spans, _) = row.as_chunks::<AXES>();
            for (span, &value) in spans.iter().zip(self.basis) {
                for axis in 0..AXES {
                    let sum = finite_or_zero(span[axis]).mul_add(value, out[axis]);
                    out[axis] = sum.clamp(f32::MIN, f32::MAX);
                }
            }
        }
    }
}

/// `v_out [N, 3] -> [N, B * 3]`.
pub fn displacement_vjp(v_out: &[f32], basis: &[f32]) -> Vec<f32> {
    let width = AXES * basis.len();
    let mut gradient = vec![0.0; v_out.len() / AXES * width];
    gradient
        .par_chunks_mut(PIECE * width)
        .zip(v_out.par_chunks(PIECE * AXES))
        .for_each(|(gradient, v_out)| {
            let (v_out, _) = v_out.as_chunks::<AXES>();
            for (gradient, v) in gradient.chunks_exact_mut(width).zip(v_out) {
                let (spans, _) = gradient.as_chunks_mut::<AXES>();
                for (span, &value) in spans.iter_mut().zip(basis) {
                    *span = v.map(|v| (finite_or_zero(v) * value).clamp(f32::MIN, f32::MAX));
                }
            }
        });
    gradient
}
