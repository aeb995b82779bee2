//! Deformation on the CPU: some values a Gaussian, row after row.

use super::{Columns, MEAN, QUAT, SCALE};

/// Rows of offsets.
#[derive(Clone, Copy)]
pub struct Offsets<'a> {
    /// `[N, width]`.
    pub values: &'a [f32],
    /// Columns.
    pub width: usize,
}

impl Offsets<'_> {
    /// `size` columns of each row.
    fn columns(&self, first: usize, size: usize) -> impl Iterator<Item = &[f32]> {
        let rows = self.values.chunks_exact(self.width);
        rows.map(move |row| &row[first..first + size])
    }
}

/// `means [N, 3]` with their path `[N, 3]` and offsets. See [`deform`](super::deform).
pub fn moved(
    means: &[f32],
    path: Option<&[f32]>,
    offsets: Offsets<'_>,
    columns: Columns,
) -> Vec<f32> {
    let mut moved = means.to_vec();
    if let Some(path) = path {
        for (value, along) in moved.iter_mut().zip(path) {
            *value += along;
        }
    }
    let rows = moved.chunks_exact_mut(MEAN).zip(offsets.columns(0, MEAN));
    for (row, offset) in rows {
        for (value, by) in row.iter_mut().zip(offset) {
            *value += columns.mean_factor * by;
        }
    }
    moved
}

/// `values [N, size]` plus the columns of offsets from `first` on.
pub fn plus(values: &[f32], size: usize, offsets: Offsets<'_>, first: usize) -> Vec<f32> {
    let mut sums = values.to_vec();
    let rows = sums
        .chunks_exact_mut(size)
        .zip(offsets.columns(first, size));
    for (row, offset) in rows {
        for (value, by) in row.iter_mut().zip(offset) {
            *value += by;
        }
    }
    sums
}

/// The gradient of `width` columns of offsets.
pub fn deform_vjp(
    v_means: &[f32],
    v_quats: &[f32],
    v_scales: &[f32],
    width: usize,
    columns: Columns,
) -> Vec<f32> {
    let mut v_offsets = vec![0.0; v_means.len() / MEAN * width];
    let rows = || v_means.chunks_exact(MEAN);
    for (row, v) in v_offsets.chunks_exact_mut(width).zip(rows()) {
        for (out, v) in row.iter_mut().zip(v) {
            *out = columns.mean_factor * v;
        }
    }
    for (first, size, v) in [
        (columns.quats, QUAT, v_quats),
        (columns.scales, SCALE, v_scales),
    ] {
        let Some(first) = first else {
            continue;
        };
        let rows = v_offsets.chunks_exact_mut(width);
        for (row, v) in rows.zip(v.chunks_exact(size)) {
            row[first..first + size].copy_from_slice(v);
        }
    }
    v_offsets
}
