//! Sums of screen-space gradients on the CPU: rows are independent, so any number of threads gives the same bits.

use rayon::prelude::*;

use super::SUMS;
use crate::splats::{MEAN_X, MEAN_Y, N_COLUMNS, RADIUS_X};

/// Gaussians of a parallel piece.
const PIECE: usize = 4096;

/// Adds a view in place. See [`add_screen_gradients`](super::add_screen_gradients).
pub fn add_screen_gradients(
    sums: &mut [f32],
    v_splats: &[f32],
    splats: &[f32],
    half_size: [f32; 2],
) {
    let (sums, _) = sums.as_chunks_mut::<SUMS>();
    let (v_splats, _) = v_splats.as_chunks::<N_COLUMNS>();
    let (splats, _) = splats.as_chunks::<N_COLUMNS>();
    let rows = sums.par_iter_mut().zip(v_splats).zip(splats);
    rows.with_min_len(PIECE).for_each(|((sums, v), splat)| {
        let (x, y) = (v[MEAN_X] * half_size[0], v[MEAN_Y] * half_size[1]);
        if splat[RADIUS_X] > 0.0 && x.is_finite() && y.is_finite() {
            sums[0] += x.hypot(y);
            sums[1] += 1.0;
        }
    });
}
