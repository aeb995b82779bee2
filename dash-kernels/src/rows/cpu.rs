//! Rows on the CPU: copied one after the other.

use super::NOT_TAKEN;
use crate::isa::finite_or_zero;

/// `values [N, width] -> [M, width]`, see [`take_rows`](super::take_rows).
pub fn take_rows(values: &[f32], width: usize, rows: &[u32]) -> Vec<f32> {
    let mut out = Vec::with_capacity(rows.len() * width);
    for &row in rows {
        let row = &values[row as usize * width..][..width];
        out.extend(row.iter().map(|&value| finite_or_zero(value)));
    }
    out
}

/// `v_out [M, width]`, the place among those taken of each row, or `u32::MAX`, `[N] -> [N, width]`.
pub fn take_rows_vjp(v_out: &[f32], width: usize, places: &[u32]) -> Vec<f32> {
    let mut gradient = vec![0.0; places.len() * width];
    let rows = gradient.chunks_exact_mut(width).zip(places);
    for (row, &place) in rows.filter(|&(_, &place)| place != NOT_TAKEN) {
        for (value, &v) in row.iter_mut().zip(&v_out[place as usize * width..]) {
            *value = finite_or_zero(v);
        }
    }
    gradient
}

/// `first [N, width]`, `second [M, width] -> [N + M, width]`, see [`join_rows`](super::join_rows).
pub fn join_rows(first: &[f32], second: &[f32]) -> Vec<f32> {
    let mut out = Vec::with_capacity(first.len() + second.len());
    for part in [first, second] {
        out.extend(part.iter().map(|&value| finite_or_zero(value)));
    }
    out
}

/// The first `n_first` values of `v_out`, and the others.
pub fn join_rows_vjp(v_out: &[f32], n_first: usize) -> [Vec<f32>; 2] {
    let (first, second) = v_out.split_at(n_first);
    [first, second].map(|part| part.iter().map(|&v| finite_or_zero(v)).collect())
}
