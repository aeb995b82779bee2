//! Rows, padded to whole lanes, times weights, with what holds the sums in registers.

use crate::isa::finite_or_zero;

/// Values summed side by side.
pub(super) const LANES: usize = 16;
/// Rows (of parameters' gradients: inputs) whose sums are held at a time.
pub(super) const ROWS: usize = 4;

pub(super) type Lanes = [f32; LANES];

/// Lanes that hold `width` values.
pub(super) fn panels(width: usize) -> usize {
    width.div_ceil(LANES)
}

/// Values of rows in whole lanes, without the padding.
pub(super) fn unpad(out: &mut [f32], padded: &[Lanes], width: usize) {
    let rows = padded.chunks_exact(panels(width));
    for (out, row) in out.chunks_exact_mut(width).zip(rows) {
        out.copy_from_slice(&row.as_flattened()[..width]);
    }
}

/// Finite values of rows in whole lanes, with zeros in the padding and in the rows up to a multiple of [`ROWS`].
/// Returns that many rows.
#[inline(always)]
pub(super) fn pad(padded: &mut [Lanes], rows: &[f32], width: usize) -> usize {
    let n = rows.len() / width;
    let padded_rows = n.next_multiple_of(ROWS);
    let panels = panels(width);
    for (padded, row) in padded
        .chunks_exact_mut(panels)
        .zip(rows.chunks_exact(width))
    {
        let padded = padded.as_flattened_mut();
        for (padded, &value) in padded.iter_mut().zip(row) {
            *padded = finite_or_zero(value);
        }
        padded[width..].fill(0.0);
    }
    padded[n * panels..padded_rows * panels].fill([0.0; LANES]);
    padded_rows
}

/// Rows in whole lanes.
#[derive(Clone, Copy)]
pub(super) struct Rows<'a> {
    values: &'a [f32],
    stride: usize,
    width: usize,
}

impl<'a> Rows<'a> {
    #[inline(always)]
    pub(super) fn new(values: &'a [Lanes], width: usize) -> Self {
        Self {
            values: values.as_flattened(),
            stride: panels(width) * LANES,
            width,
        }
    }

    #[inline(always)]
    fn four(self, first: usize) -> [&'a [f32]; ROWS] {
        std::array::from_fn(|row| &self.values[(first + row) * self.stride..][..self.width])
    }
}

/// Rows times weights, plus `start` where there is any; `finish(at, sum)` is what is written at `at`.
#[inline(always)]
pub(super) fn multiply(
    rows: Rows,
    weights: &[Lanes],
    start: &[Lanes],
    out: &mut [Lanes],
    n_rows: usize,
    finish: impl Fn(usize, Lanes) -> Lanes,
) {
    let n_panels = weights.len() / rows.width;
    for first in (0..n_rows).step_by(ROWS) {
        let four = rows.four(first);
        for (panel, weights) in weights.chunks_exact(rows.width).enumerate() {
            let start = start.get(panel).copied().unwrap_or([0.0; LANES]);
            let sums = sum_products(four, weights, [start; ROWS]);
            for (row, sums) in sums.into_iter().enumerate() {
                let at = (first + row) * n_panels + panel;
                out[at] = finish(at, sums);
            }
        }
    }
}

/// `sums[row][l] + sum over k of rows[row][k] * weights[k][l]`.
#[inline(always)]
pub(super) fn sum_products(
    rows: [&[f32]; ROWS],
    weights: &[Lanes],
    sums: [Lanes; ROWS],
) -> [Lanes; ROWS] {
    let rows = rows.map(|row| &row[..weights.len()]);
    let mut sums = sums;
    for k in 0..weights.len() {
        for row in 0..ROWS {
            let value = rows[row][k];
            for l in 0..LANES {
                sums[row][l] += value * weights[k][l];
            }
        }
    }
    sums
}

/// Adds to `sums[k]` the sum over rows of `rows[row][k] * v[row]`.
#[inline(always)]
pub(super) fn add_outer(rows: Rows, v: &[Lanes], sums: &mut [Lanes], n_panels: usize) {
    let n_rows = v.len() / n_panels;
    for first in (0..rows.width).step_by(ROWS) {
        for panel in 0..n_panels {
            let mut held: [Lanes; ROWS] =
                std::array::from_fn(|k| sums[(first + k) * n_panels + panel]);
            for row in 0..n_rows {
                let values = &rows.values[row * rows.stride + first..][..ROWS];
                let v = &v[row * n_panels + panel];
                for k in 0..ROWS {
                    let value = values[k];
                    for l in 0..LANES {
                        held[k][l] += value * v[l];
                    }
                }
            }
            for (k, held) in held.into_iter().enumerate() {
                sums[(first + k) * n_panels + panel] = held;
            }
        }
    }
}

#[inline(always)]
pub(super) fn plus(a: Lanes, b: Lanes) -> Lanes {
    let mut out = a;
    for l in 0..LANES {
        out[l] += b[l];
    }
    out
}

// Loops over lanes become vector instructions, `map` of an array does not.

#[inline(always)]
pub(super) fn finite(values: Lanes) -> Lanes {
    let mut out = [0.0; LANES];
    for l in 0..LANES {
        out[l] = finite_or_zero(values[l]);
    }
    out
}

/// Zero where they are negative, too.
#[inline(always)]
pub(super) fn positive(values: Lanes) -> Lanes {
    let mut out = [0.0; LANES];
    for l in 0..LANES {
        out[l] = finite_or_zero(values[l].max(0.0));
    }
    out
}

/// Zero where `what` is not positive, too.
#[inline(always)]
pub(super) fn finite_where_positive(values: Lanes, what: &Lanes) -> Lanes {
    let mut out = [0.0; LANES];
    for l in 0..LANES {
        let value = finite_or_zero(values[l]);
        out[l] = if what[l] > 0.0 { value } else { 0.0 };
    }
    out
}
