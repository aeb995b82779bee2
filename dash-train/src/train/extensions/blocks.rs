//! Pictures as means over small square blocks.

/// Blocks across a picture, where their sides allow it.
const ACROSS: usize = 80;
/// Least and largest side of a block, pixels.
const SIDES: (usize, usize) = (2, 16);

/// How a picture is divided into blocks.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Blocks {
    side: usize,
    /// Pixels across the picture.
    width: usize,
    pub(crate) rows: usize,
    pub(crate) columns: usize,
}

impl Blocks {
    /// The blocks of a picture of `width` by `height` pixels.
    pub(crate) fn of(width: usize, height: usize) -> Self {
        Self::with_side((width / ACROSS).clamp(SIDES.0, SIDES.1), width, height)
    }

    fn with_side(side: usize, width: usize, height: usize) -> Self {
        Self {
            side,
            width,
            rows: height.div_ceil(side),
            columns: width.div_ceil(side),
        }
    }

    /// The block of a pixel, both counted row by row.
    pub(crate) fn at(self, pixel: usize) -> usize {
        let (row, column) = (pixel / self.width, pixel % self.width);
        row / self.side * self.columns + column / self.side
    }

    /// The mean colour of each block of a picture `[H, W, 3]`, row by row; those at the border are smaller.
    pub(crate) fn means(self, rgb: &[f32]) -> Vec<f32> {
        let mut sums = vec![0.0f32; self.rows * self.columns * 3];
        let mut counts = vec![0u32; self.rows * self.columns];
        for (pixel, color) in rgb.chunks_exact(3).enumerate() {
            let block = self.at(pixel);
            counts[block] += 1;
            for (sum, value) in sums[3 * block..].iter_mut().zip(color) {
                *sum += value;
            }
        }
        for (sum, &count) in sums.chunks_exact_mut(3).zip(&counts) {
            sum.iter_mut().for_each(|value| *value /= count as f32);
        }
        sums
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn blocks_at_the_border_are_means_too() {
        let blocks = Blocks::with_side(2, 5, 3);
        assert_eq!((blocks.rows, blocks.columns), (2, 3));
        let picture: Vec<f32> = (0..5 * 3).flat_map(|i| [i as f32, 1.0, 0.0]).collect();
        let means = blocks.means(&picture);
        // Pixels 0, 1, 5, 6; the corner is pixel 14 alone.
        assert_eq!(means[..3], [3.0, 1.0, 0.0]);
        assert_eq!(means[15..], [14.0, 1.0, 0.0]);
        assert_eq!([0, 6, 4, 14].map(|pixel| blocks.at(pixel)), [0, 0, 2, 5]);
    }

    #[test]
    fn blocks_grow_with_the_picture() {
        let side = |width| Blocks::of(width, 100).side;
        assert_eq!([10, 160, 1_352, 3_840].map(side), [2, 2, 16, 16]);
    }
}
