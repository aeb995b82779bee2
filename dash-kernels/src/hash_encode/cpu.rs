//! The hash encoding on the CPU.
//!
//! Levels are the outer loop, points the inner: a level of the table fits the caches, the whole
//! table does not. The forward pass and the gradient of the positions are split over points, the
//! gradient of the table over levels (and row ranges of them). No two threads share a sum, and
//! every sum runs in the order of the points, or of the levels, whatever the number of threads.

#![expect(
    clippy::needless_range_loop,
    reason = "lane loops index several lane arrays side by side"
)]

use rayon::prelude::*;

use super::corners::{Cells, LANES, Lanes, LevelConstants, PointBlock};
use super::layout::HashGridLayout;
use super::{LARGEST_COTANGENT, finite_or_zero};
use crate::isa::{Kernel, dispatch};

/// Calls `$function::<D, 2^D, F>($args)` for the layout's `D` and `F`.
macro_rules! for_layout {
    ($layout:expr, $function:ident($($arg:expr),*)) => {
        match ($layout.dims(), $layout.n_features_per_level()) {
            (2, 1) => $function::<2, 4, 1>($($arg),*),
            (2, 2) => $function::<2, 4, 2>($($arg),*),
            (2, 4) => $function::<2, 4, 4>($($arg),*),
            (2, 8) => $function::<2, 4, 8>($($arg),*),
            (3, 1) => $function::<3, 8, 1>($($arg),*),
            (3, 2) => $function::<3, 8, 2>($($arg),*),
            (3, 4) => $function::<3, 8, 4>($($arg),*),
            (3, 8) => $function::<3, 8, 8>($($arg),*),
            (4, 1) => $function::<4, 16, 1>($($arg),*),
            (4, 2) => $function::<4, 16, 2>($($arg),*),
            (4, 4) => $function::<4, 16, 4>($($arg),*),
            (4, 8) => $function::<4, 16, 8>($($arg),*),
            (dims, features) => unreachable!(
                "HashGridLayout::new admits no layout of {dims} axes and {features} features"
            ),
        }
    };
}

/// `positions [N, D]`, `table [T, F]` -> `[N, L * F]`.
pub fn hash_encode(positions: &[f32], table: &[f32], layout: &HashGridLayout) -> Vec<f32> {
    for_layout!(layout, encode(positions, table, layout))
}

/// Gradient of the table `[T, F]` from `v_out [N, L * F]`.
pub fn table_vjp(positions: &[f32], v_out: &[f32], layout: &HashGridLayout) -> Vec<f32> {
    for_layout!(layout, scatter(positions, v_out, layout))
}

/// Gradient of the positions `[N, D]` from `v_out [N, L * F]`.
pub fn positions_vjp(
    positions: &[f32],
    table: &[f32],
    v_out: &[f32],
    layout: &HashGridLayout,
) -> Vec<f32> {
    for_layout!(layout, slopes(positions, table, v_out, layout))
}

/// Points per parallel piece: as few pieces as there are threads, because each goes through the
/// whole table.
fn points_per_piece(n_points: usize) -> usize {
    n_points
        .div_ceil(rayon::current_num_threads())
        .next_multiple_of(LANES)
        .max(LANES)
}

fn blocks<const D: usize>(positions: &[f32]) -> Vec<PointBlock<D>> {
    positions
        .par_chunks(D * LANES)
        .map(PointBlock::new)
        .collect()
}

fn level_rows<'a, const F: usize>(
    table: &'a [f32],
    layout: &HashGridLayout,
    level: usize,
) -> &'a [[f32; F]] {
    let (start, size) = (layout.levels()[level].offset, layout.levels()[level].size);
    &table.as_chunks().0[start as usize..][..size as usize]
}

/// A gradient of the output as it counts.
#[inline(always)]
fn bounded(v: f32) -> f32 {
    finite_or_zero(v).clamp(-LARGEST_COTANGENT, LARGEST_COTANGENT)
}

/// The level's features at the start of a point's row.
#[inline(always)]
fn level_features<const F: usize>(row: &[f32]) -> &[f32; F] {
    row.first_chunk()
        .expect("a level's features end within the point's row")
}

fn encode<const D: usize, const CORNERS: usize, const F: usize>(
    positions: &[f32],
    table: &[f32],
    layout: &HashGridLayout,
) -> Vec<f32> {
    let n_points = positions.len() / D;
    let width = layout.n_features();
    let mut out = vec![0.0; n_points * width];
    let piece = points_per_piece(n_points);
    out.par_chunks_mut(piece * width)
        .zip(positions.par_chunks(piece * D))
        .for_each(|(out, positions)| {
            let blocks = blocks::<D>(positions);
            for (l, level) in layout.levels().iter().enumerate() {
                dispatch(EncodeLevel::<D, CORNERS, F> {
                    blocks: &blocks,
                    level: LevelConstants::new(level, layout.interpolation()),
                    rows: level_rows(table, layout, l),
                    out: &mut out[l * F..],
                    width,
                });
            }
        });
    out
}

struct EncodeLevel<'a, const D: usize, const CORNERS: usize, const F: usize> {
    blocks: &'a [PointBlock<D>],
    level: LevelConstants<D>,
    rows: &'a [[f32; F]],
    /// From the level's first feature of the first point on.
    out: &'a mut [f32],
    width: usize,
}

impl<const D: usize, const CORNERS: usize, const F: usize> Kernel
    for EncodeLevel<'_, D, CORNERS, F>
{
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let mut rows = [[0; LANES]; CORNERS];
        let mut weights = [[0.0; LANES]; CORNERS];
        for (block, out) in self
            .blocks
            .iter()
            .zip(self.out.chunks_mut(LANES * self.width))
        {
            let cells = Cells::locate(block, &self.level);
            cells.rows(&self.level, &mut rows);
            cells.weights(&mut weights);
            for (lane, out) in out.chunks_mut(self.width).enumerate() {
                let mut sum = [0.0; F];
                for corner in 0..CORNERS {
                    let row = &self.rows[rows[corner][lane] as usize];
                    let weight = weights[corner][lane];
                    for (sum, value) in sum.iter_mut().zip(row) {
                        *sum += weight * value;
                    }
                }
                if block.inside[lane] {
                    out[..F].copy_from_slice(&sum.map(finite_or_zero));
                }
            }
        }
    }
}

fn scatter<const D: usize, const CORNERS: usize, const F: usize>(
    positions: &[f32],
    v_out: &[f32],
    layout: &HashGridLayout,
) -> Vec<f32> {
    let blocks = blocks::<D>(positions);
    let mut v_table = vec![0.0; layout.n_entries() * F];
    let ranges_per_level = rayon::current_num_threads().div_ceil(layout.n_levels());
    let mut pieces = Vec::with_capacity(layout.n_levels() * ranges_per_level);
    let mut rest: &mut [[f32; F]] = v_table.as_chunks_mut().0;
    for (l, level) in layout.levels().iter().enumerate() {
        let (mut v_rows, tail) = rest.split_at_mut(level.size as usize);
        rest = tail;
        let range = v_rows.len().div_ceil(ranges_per_level);
        let mut first_row = 0;
        while !v_rows.is_empty() {
            let (head, tail) = v_rows.split_at_mut(range.min(v_rows.len()));
            v_rows = tail;
            pieces.push((l, first_row, head));
            first_row += range as u32;
        }
    }
    pieces
        .into_par_iter()
        .with_max_len(1)
        .for_each(|(l, first_row, v_rows)| {
            dispatch(ScatterLevel::<D, CORNERS, F> {
                blocks: &blocks,
                level: LevelConstants::new(&layout.levels()[l], layout.interpolation()),
                v_out: v_out.get(l * F..).unwrap_or_default(),
                width: layout.n_features(),
                first_row,
                v_rows,
            });
        });
    v_table
}

struct ScatterLevel<'a, const D: usize, const CORNERS: usize, const F: usize> {
    blocks: &'a [PointBlock<D>],
    level: LevelConstants<D>,
    /// From the level's first feature of the first point on.
    v_out: &'a [f32],
    width: usize,
    first_row: u32,
    /// The level's rows from `first_row` on; others are left to another piece.
    v_rows: &'a mut [[f32; F]],
}

impl<const D: usize, const CORNERS: usize, const F: usize> Kernel
    for ScatterLevel<'_, D, CORNERS, F>
{
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let mut rows = [[0; LANES]; CORNERS];
        let mut weights = [[0.0; LANES]; CORNERS];
        for (block, v_out) in self
            .blocks
            .iter()
            .zip(self.v_out.chunks(LANES * self.width))
        {
            let cells = Cells::locate(block, &self.level);
            cells.rows(&self.level, &mut rows);
            cells.weights(&mut weights);
            for (lane, v_out) in v_out.chunks(self.width).enumerate() {
                if !block.inside[lane] {
                    continue;
                }
                let v_out = level_features::<F>(v_out).map(bounded);
                for corner in 0..CORNERS {
                    let row = rows[corner][lane].wrapping_sub(self.first_row);
                    let weight = weights[corner][lane];
                    if let Some(v_row) = self.v_rows.get_mut(row as usize) {
                        for (v_row, v) in v_row.iter_mut().zip(&v_out) {
                            *v_row += weight * v;
                        }
                    }
                }
            }
        }
    }
}

fn slopes<const D: usize, const CORNERS: usize, const F: usize>(
    positions: &[f32],
    table: &[f32],
    v_out: &[f32],
    layout: &HashGridLayout,
) -> Vec<f32> {
    let n_points = positions.len() / D;
    let width = layout.n_features();
    let mut v_positions = vec![0.0; positions.len()];
    let piece = points_per_piece(n_points);
    v_positions
        .par_chunks_mut(piece * D)
        .zip(positions.par_chunks(piece * D))
        .zip(v_out.par_chunks(piece * width))
        .for_each(|((v_positions, positions), v_out)| {
            let blocks = blocks::<D>(positions);
            let mut sums = vec![[[0.0; LANES]; D]; blocks.len()];
            for (l, level) in layout.levels().iter().enumerate() {
                dispatch(SlopesLevel::<D, CORNERS, F> {
                    blocks: &blocks,
                    level: LevelConstants::new(level, layout.interpolation()),
                    rows: level_rows(table, layout, l),
                    v_out: &v_out[l * F..],
                    width,
                    sums: &mut sums,
                });
            }
            for (i, v) in v_positions.iter_mut().enumerate() {
                let (point, axis) = (i / D, i % D);
                let (block, lane) = (point / LANES, point % LANES);
                if blocks[block].inside[lane] {
                    *v = finite_or_zero(sums[block][axis][lane]);
                }
            }
        });
    v_positions
}

struct SlopesLevel<'a, const D: usize, const CORNERS: usize, const F: usize> {
    blocks: &'a [PointBlock<D>],
    level: LevelConstants<D>,
    rows: &'a [[f32; F]],
    /// From the level's first feature of the first point on.
    v_out: &'a [f32],
    width: usize,
    sums: &'a mut [[Lanes<f32>; D]],
}

impl<const D: usize, const CORNERS: usize, const F: usize> Kernel
    for SlopesLevel<'_, D, CORNERS, F>
{
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let mut rows = [[0; LANES]; CORNERS];
        for ((block, sums), v_out) in self
            .blocks
            .iter()
            .zip(self.sums)
            .zip(self.v_out.chunks(LANES * self.width))
        {
            let cells = Cells::locate(block, &self.level);
            cells.rows(&self.level, &mut rows);
            let mut v_weights = [[0.0; LANES]; CORNERS];
            for (lane, v_out) in v_out.chunks(self.width).enumerate() {
                let v_out = level_features::<F>(v_out).map(bounded);
                for corner in 0..CORNERS {
                    let row = &self.rows[rows[corner][lane] as usize];
                    let mut dot = 0.0;
                    for (value, v) in row.iter().zip(&v_out) {
                        dot += value * v;
                    }
                    v_weights[corner][lane] = dot;
                }
            }
            add_slopes(&cells, &v_weights, sums);
        }
    }
}

/// Adds the gradient of the position, given that of each corner's weight: along each axis the
/// difference of its two sides, interpolated along the other axes.
#[inline(always)]
fn add_slopes<const D: usize, const CORNERS: usize>(
    cells: &Cells<D>,
    v_weights: &[Lanes<f32>; CORNERS],
    sums: &mut [Lanes<f32>; D],
) {
    // `interpolated` has been interpolated along the axes above `axis`, highest first.
    let mut interpolated = *v_weights;
    for axis in (0..D).rev() {
        let half = 1 << axis;
        let mut difference = [[0.0; LANES]; CORNERS];
        for corner in 0..half {
            for lane in 0..LANES {
                let (low, high) = (
                    interpolated[corner][lane],
                    interpolated[corner + half][lane],
                );
                difference[corner][lane] = high - low;
                interpolated[corner][lane] = low + cells.upper_weight[axis][lane] * (high - low);
            }
        }
        for other in (0..axis).rev() {
            let half = 1 << other;
            for corner in 0..half {
                for lane in 0..LANES {
                    let (low, high) = (difference[corner][lane], difference[corner + half][lane]);
                    difference[corner][lane] = low + cells.upper_weight[other][lane] * (high - low);
                }
            }
        }
        for lane in 0..LANES {
            sums[axis][lane] += difference[0][lane] * cells.slope[axis][lane];
        }
    }
}
