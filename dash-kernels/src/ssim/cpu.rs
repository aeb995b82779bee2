//! Structural similarity on the CPU.
//!
//! Bands of rows run in parallel, each tile by tile of columns, each tile streaming through
//! separable blurs. A pixel's arithmetic does not depend on its band or tile, so results are the
//! same for any number of threads. Moments are kept in f64: in f32 `E[x^2] - mean^2` of a constant
//! image is off by more than C2 tolerates.

use std::ops::Range;

use rayon::prelude::*;

use super::blur::Blur;
use super::terms::{Terms, finite_or_zero};
use super::window::RADIUS;
use crate::isa::{Kernel, dispatch};

/// Bands per thread, so that a thread that is held up does not hold up the others.
const BANDS_PER_THREAD: usize = 2;
/// Every band also blurs rows above and below it; thinner ones would mostly do that.
const MIN_BAND_ROWS: usize = 4 * RADIUS;
/// Values in a row of a tile: the rows that the window spans stay within a level-2 cache.
const TILE_VALUES: usize = 384;
/// Every tile also blurs columns to its left and right; narrower ones would mostly do that.
const MIN_TILE_COLUMNS: usize = 4 * RADIUS;

/// `x [H, W, C]`, `y [H, W, C]` -> `[H, W, C]`.
pub fn ssim(x: &[f32], y: &[f32], shape: [usize; 3]) -> Vec<f32> {
    let images = Images { x, y, shape };
    for_bands(&images, |first_row, columns, out| {
        dispatch(ForwardTile {
            images,
            first_row,
            columns,
            out,
        });
    })
}

/// Gradient of `own` from `v_out`, all `[H, W, C]`; the similarity is symmetric, so the gradient
/// of the other image is had by exchanging the two.
pub fn ssim_vjp(own: &[f32], other: &[f32], v_out: &[f32], shape: [usize; 3]) -> Vec<f32> {
    let images = Images {
        x: own,
        y: other,
        shape,
    };
    for_bands(&images, |first_row, columns, v_x| {
        dispatch(BackwardTile {
            images,
            v_out,
            first_row,
            columns,
            v_x,
        });
    })
}

/// Fills an image by calling `tile(first_row, columns, rows)`, where `rows` are a band's.
fn for_bands(images: &Images, tile: impl Fn(usize, Columns, &mut [f32]) + Sync) -> Vec<f32> {
    for_bands_with::<()>(images, |first_row, columns, out, _| {
        tile(first_row, columns, out);
    })
    .0
}

/// As [`for_bands`], and something more for each row of the image, which `tile` fills for the band's.
pub(crate) fn for_bands_with<R: Clone + Default + Send>(
    images: &Images,
    tile: impl Fn(usize, Columns, &mut [f32], &mut [R]) + Sync,
) -> (Vec<f32>, Vec<R>) {
    let [height, width, channels] = images.shape;
    let rows = height
        .div_ceil(BANDS_PER_THREAD * rayon::current_num_threads())
        .max(MIN_BAND_ROWS);
    let columns_per_tile = (TILE_VALUES / channels).max(MIN_TILE_COLUMNS);
    let mut out = vec![0.0; height * width * channels];
    let mut of_rows = vec![R::default(); height];
    out.par_chunks_mut(rows * width * channels)
        .zip(of_rows.par_chunks_mut(rows))
        .enumerate()
        .for_each(|(band, (out, of_rows))| {
            for first in (0..width).step_by(columns_per_tile) {
                let count = columns_per_tile.min(width - first);
                tile(band * rows, Columns { first, count }, out, of_rows);
            }
        });
    (out, of_rows)
}

/// Columns of a tile.
#[derive(Clone, Copy)]
pub(crate) struct Columns {
    pub(crate) first: usize,
    pub(crate) count: usize,
}

/// Two images of one shape `[H, W, C]`.
#[derive(Clone, Copy)]
pub(crate) struct Images<'a> {
    pub(crate) x: &'a [f32],
    pub(crate) y: &'a [f32],
    pub(crate) shape: [usize; 3],
}

impl<'a> Images<'a> {
    /// The image's row, `None` above and below it.
    fn row_in_image(&self, row: isize) -> Option<usize> {
        usize::try_from(row).ok().filter(|&row| row < self.shape[0])
    }

    /// Values of `image` in the tile's columns of a row.
    #[inline(always)]
    pub(crate) fn tile_row<'b>(&self, image: &'b [f32], row: usize, columns: Columns) -> &'b [f32] {
        let [_, width, channels] = self.shape;
        &image[(row * width + columns.first) * channels..][..columns.count * channels]
    }

    /// The tile's columns in a row of a band of an image.
    #[inline(always)]
    pub(crate) fn band_row<'b>(
        &self,
        band: &'b mut [f32],
        row: usize,
        columns: Columns,
    ) -> &'b mut [f32] {
        let [_, width, channels] = self.shape;
        &mut band[(row * width + columns.first) * channels..][..columns.count * channels]
    }

    /// The tile's columns and `margin` more on either side: the part that lies in the image, and
    /// how many values are missing on its left.
    fn widened(&self, columns: Columns, margin: usize) -> (Columns, usize) {
        let [_, width, channels] = self.shape;
        let first = columns.first.saturating_sub(margin);
        let end = (columns.first + columns.count + margin).min(width);
        let part = Columns {
            first,
            count: end - first,
        };
        (part, (margin - (columns.first - first)) * channels)
    }

    /// Pushes a row's `x`, `y`, `x^2 + y^2` and `x y`, for the moments in the tile's columns and
    /// `margin` more on either side.
    #[inline(always)]
    fn push_moments<'b>(
        &self,
        row: isize,
        columns: Columns,
        margin: usize,
        blur: &'b mut Blur<4>,
    ) -> Option<[&'b [f64]; 4]> {
        let Some(row) = self.row_in_image(row) else {
            return blur.push_zeros();
        };
        let (part, missing) = self.widened(columns, margin + RADIUS);
        let x = self.tile_row(self.x, row, part);
        let y = self.tile_row(self.y, row, part);
        // What lies outside the image is zero from the start and stays so.
        let [mean_x, mean_y, squares, product] =
            blur.input().map(|row| &mut row[missing..][..x.len()]);
        for i in 0..x.len() {
            let (x, y) = (finite_or_zero(x[i]), finite_or_zero(y[i]));
            mean_x[i] = x;
            mean_y[i] = y;
            squares[i] = x * x + y * y;
            product[i] = x * y;
        }
        blur.push()
    }
}

struct ForwardTile<'a> {
    images: Images<'a>,
    first_row: usize,
    columns: Columns,
    /// The band's rows, whole.
    out: &'a mut [f32],
}

impl Kernel for ForwardTile<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let [_, width, channels] = self.images.shape;
        let mut blur = Blur::new(self.columns.count, channels);
        let mut row = self.first_row as isize - RADIUS as isize;
        for out in self.out.chunks_mut(width * channels) {
            let out = &mut out[self.columns.first * channels..][..self.columns.count * channels];
            loop {
                let moments = self.images.push_moments(row, self.columns, 0, &mut blur);
                row += 1;
                let Some(moments) = moments else { continue };
                let [mean_x, mean_y, squares, product] = moments.map(|row| &row[..out.len()]);
                for (i, out) in out.iter_mut().enumerate() {
                    let terms = Terms::new(mean_x[i], mean_y[i], squares[i], product[i]);
                    *out = terms.similarity().clamp(-1.0, 1.0) as f32;
                }
                break;
            }
        }
    }
}

/// What a gradient of the similarity is wanted for.
pub(crate) trait Upstream {
    /// Writes the gradients of `mean_x`, `squares` and `product` in the columns `part` of an image's row, from
    /// the moments there.
    fn moments_vjp(
        &mut self,
        row: usize,
        part: Columns,
        moments: [&[f64]; 4],
        gradients: [&mut [f64]; 3],
    );

    /// Takes the gradient of a row in the tile's columns.
    fn finish(&mut self, row: usize, gradient: &RowGradient);
}

/// A row of both images, and the blurred gradients of the moments there.
pub(crate) struct RowGradient<'a> {
    pub(crate) x: &'a [f32],
    pub(crate) y: &'a [f32],
    pub(crate) v_mean: &'a [f64],
    pub(crate) v_squares: &'a [f64],
    pub(crate) v_product: &'a [f64],
}

impl RowGradient<'_> {
    /// The gradient of a value of `x`; zero where that is not finite.
    #[inline(always)]
    pub(crate) fn at(&self, i: usize) -> f64 {
        let v = self.v_mean[i]
            + 2.0 * f64::from(self.x[i]) * self.v_squares[i]
            + finite_or_zero(self.y[i]) * self.v_product[i];
        if self.x[i].is_finite() { v } else { 0.0 }
    }
}

/// Works the gradient out for the tile's `columns` in `rows` of the image.
#[inline(always)]
pub(crate) fn stream_backward(
    images: Images,
    columns: Columns,
    rows: Range<usize>,
    upstream: &mut impl Upstream,
) {
    let [_, _, channels] = images.shape;
    // Moments are needed, and their gradients blurred, a window's radius around the tile.
    let mut moments_blur = Blur::<4>::new(columns.count + 2 * RADIUS, channels);
    let mut gradient_blur = Blur::<3>::new(columns.count, channels);
    let (part, missing) = images.widened(columns, RADIUS);
    let part_values = part.count * channels;
    let mut pushed_row = rows.start as isize - 2 * RADIUS as isize;
    for row in rows {
        let x = images.tile_row(images.x, row, columns);
        let y = &images.tile_row(images.y, row, columns)[..x.len()];
        loop {
            let moments = images.push_moments(pushed_row, columns, RADIUS, &mut moments_blur);
            let moments_row = pushed_row - RADIUS as isize;
            pushed_row += 1;
            let Some(moments) = moments else { continue };
            let gradients = match images.row_in_image(moments_row) {
                Some(row) => {
                    let inside = |row| &<[f64]>::split_at(row, missing).1[..part_values];
                    let inside_mut =
                        |row| &mut <[f64]>::split_at_mut(row, missing).1[..part_values];
                    let gradients = gradient_blur.input().map(inside_mut);
                    upstream.moments_vjp(row, part, moments.map(inside), gradients);
                    gradient_blur.push()
                }
                None => gradient_blur.push_zeros(),
            };
            let Some(gradients) = gradients else { continue };
            let [v_mean, v_squares, v_product] = gradients.map(|row| &row[..x.len()]);
            let gradient = RowGradient {
                x,
                y,
                v_mean,
                v_squares,
                v_product,
            };
            upstream.finish(row, &gradient);
            break;
        }
    }
}

struct BackwardTile<'a> {
    images: Images<'a>,
    v_out: &'a [f32],
    first_row: usize,
    columns: Columns,
    /// The band's rows, whole.
    v_x: &'a mut [f32],
}

impl Kernel for BackwardTile<'_> {
    type Output = ();

    #[inline(always)]
    fn run(mut self) {
        let [_, width, channels] = self.images.shape;
        let n_rows = self.v_x.len() / (width * channels);
        let rows = self.first_row..self.first_row + n_rows;
        stream_backward(self.images, self.columns, rows, &mut self);
    }
}

impl Upstream for BackwardTile<'_> {
    #[inline(always)]
    fn moments_vjp(
        &mut self,
        row: usize,
        part: Columns,
        moments: [&[f64]; 4],
        gradients: [&mut [f64]; 3],
    ) {
        let v_out = self.images.tile_row(self.v_out, row, part);
        moments_vjp(moments, v_out, gradients);
    }

    #[inline(always)]
    fn finish(&mut self, row: usize, gradient: &RowGradient) {
        let v_x = self
            .images
            .band_row(self.v_x, row - self.first_row, self.columns);
        for (i, v_x) in v_x.iter_mut().enumerate() {
            *v_x = within_range(gradient.at(i));
        }
    }
}

/// Gradients near the largest number there is leave its range; they count as zero.
#[inline(always)]
pub(crate) fn within_range(v: f64) -> f32 {
    let v = v as f32;
    if v.is_finite() { v } else { 0.0 }
}

/// Gradients of `mean_x`, `squares` and `product` from that of the similarity, for a row.
#[inline(always)]
fn moments_vjp(moments: [&[f64]; 4], v_out: &[f32], gradients: [&mut [f64]; 3]) {
    let [mean_x, mean_y, squares, product] = moments;
    let [v_mean, v_squares, v_product] = gradients;
    for i in 0..v_out.len() {
        let terms = Terms::new(mean_x[i], mean_y[i], squares[i], product[i]);
        [v_mean[i], v_squares[i], v_product[i], _] = terms.vjp(finite_or_zero(v_out[i]));
    }
}
