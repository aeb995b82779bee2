//! The photometric loss on the CPU.
//!
//! One stream of a band's rows gives the similarity, its gradient and the absolute and squared errors: each pixel is
//! read and its moments are blurred once for all of them. Tiles and precision are those of the similarity's
//! own kernel; sums are taken row by row in f64 and added from top to bottom, so that any number of threads gives
//! the same bits.

use crate::isa::{Kernel, dispatch};
use crate::ssim::cpu::{
    Columns, Images, RowGradient, Upstream, for_bands_with, stream_backward, within_range,
};
use crate::ssim::terms::Terms;

/// Sums kept side by side: one AVX-512 register of `f64`.
const LANES: usize = 8;

/// Loss and mean squared error, and the loss's gradient to `image`, `[H, W, C]` like `target`.
pub fn photometric(
    image: &[f32],
    target: &[f32],
    dssim: f32,
    shape: [usize; 3],
) -> ([f32; 2], Vec<f32>) {
    let images = Images {
        x: image,
        y: target,
        shape,
    };
    let (n, dssim) = (image.len() as f64, f64::from(dssim));
    let (v_absolute, v_similarity) = ((1.0 - dssim) / n, -dssim / n);
    let (gradient, sums) = for_bands_with(&images, |first_row, columns, v_image, sums| {
        dispatch(LossTile {
            images,
            v_absolute,
            v_similarity,
            first_row,
            columns,
            similarity: Vec::new(),
            v_image,
            sums,
        });
    });
    let total = sums.iter().fold(Sums::default(), |total, row| Sums {
        similarity: total.similarity + row.similarity,
        absolute: total.absolute + row.absolute,
        squared: total.squared + row.squared,
    });
    let loss = (1.0 - dssim) * total.absolute / n + dssim * (1.0 - total.similarity / n);
    ([loss as f32, (total.squared / n) as f32], gradient)
}

/// Sums over a row.
#[derive(Debug, Clone, Copy, Default)]
struct Sums {
    similarity: f64,
    absolute: f64,
    squared: f64,
}

struct LossTile<'a> {
    images: Images<'a>,
    /// What an absolute error and a similarity count in the loss.
    v_absolute: f64,
    v_similarity: f64,
    first_row: usize,
    columns: Columns,
    /// Similarities of a row, in the tile's columns and around.
    similarity: Vec<f64>,
    /// The band's rows, whole.
    v_image: &'a mut [f32],
    sums: &'a mut [Sums],
}

impl Kernel for LossTile<'_> {
    type Output = ();

    #[inline(always)]
    fn run(mut self) {
        let rows = self.first_row..self.first_row + self.sums.len();
        if self.v_similarity != 0.0 {
            return stream_backward(self.images, self.columns, rows, &mut self);
        }
        // A similarity that does not count is not worked out.
        let zeros = vec![0.0; self.columns.count * self.images.shape[2]];
        for row in rows {
            let gradient = RowGradient {
                x: self.images.tile_row(self.images.x, row, self.columns),
                y: self.images.tile_row(self.images.y, row, self.columns),
                v_mean: &zeros,
                v_squares: &zeros,
                v_product: &zeros,
            };
            self.finish(row, &gradient);
        }
    }
}

impl Upstream for LossTile<'_> {
    #[inline(always)]
    fn moments_vjp(
        &mut self,
        row: usize,
        part: Columns,
        moments: [&[f64]; 4],
        gradients: [&mut [f64]; 3],
    ) {
        let n = moments[0].len();
        self.similarity.resize(n, 0.0);
        let [mean_x, mean_y, squares, product] = moments.map(|row| &row[..n]);
        let [v_mean, v_squares, v_product] = gradients.map(|row| &mut row[..n]);
        let similarity = &mut self.similarity[..n];
        for i in 0..n {
            let terms = Terms::new(mean_x[i], mean_y[i], squares[i], product[i]);
            [v_mean[i], v_squares[i], v_product[i], similarity[i]] = terms.vjp(self.v_similarity);
        }
        // Rows and columns around the tile are other tiles' to count.
        let Some(sums) = row
            .checked_sub(self.first_row)
            .and_then(|row| self.sums.get_mut(row))
        else {
            return;
        };
        let channels = self.images.shape[2];
        let own = &similarity[(self.columns.first - part.first) * channels..];
        let mut lanes = [0.0; LANES];
        let own = own[..self.columns.count * channels].chunks_exact(LANES);
        for (lane, similarity) in own.remainder().iter().enumerate() {
            lanes[lane] = similarity.clamp(-1.0, 1.0);
        }
        for chunk in own {
            for lane in 0..LANES {
                lanes[lane] += chunk[lane].clamp(-1.0, 1.0);
            }
        }
        sums.similarity += lanes.iter().sum::<f64>();
    }

    #[inline(always)]
    fn finish(&mut self, row: usize, gradient: &RowGradient) {
        let row = row - self.first_row;
        let v_image = self.images.band_row(self.v_image, row, self.columns);
        let n = v_image.len();
        let (x, y) = (&gradient.x[..n], &gradient.y[..n]);
        let signs = [self.v_absolute, -self.v_absolute];
        for i in 0..n {
            let error = x[i] - y[i];
            let brighter = if error > 0.0 { signs[0] } else { 0.0 };
            let v_absolute = if error < 0.0 { signs[1] } else { brighter };
            let v_absolute = if error.is_finite() { v_absolute } else { 0.0 };
            v_image[i] = within_range(gradient.at(i) + v_absolute);
        }
        let (mut absolute, mut squared) = ([0.0; LANES], [0.0; LANES]);
        let (x, y) = (x.chunks_exact(LANES), y.chunks_exact(LANES));
        for (lane, (x, y)) in x.remainder().iter().zip(y.remainder()).enumerate() {
            let error = f64::from(*x) - f64::from(*y);
            (absolute[lane], squared[lane]) = (error.abs(), error * error);
        }
        for (x, y) in x.zip(y) {
            for lane in 0..LANES {
                let error = f64::from(x[lane]) - f64::from(y[lane]);
                absolute[lane] += error.abs();
                squared[lane] += error * error;
            }
        }
        let sums = &mut self.sums[row];
        sums.absolute += absolute.iter().sum::<f64>();
        sums.squared += squared.iter().sum::<f64>();
    }
}
