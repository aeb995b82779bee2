//! The shape of a needle's packed row.

use num_traits::Float;

use crate::splats;

/// A splat whose exponent is `(across w^2 + along z^2) / 2`, `w` and `z` the distances across and along its long axis.
#[derive(Debug, Clone, Copy)]
pub struct Needle<T> {
    /// Unit vector across.
    pub normal: [T; 2],
    /// Its product with the axis' points.
    pub offset: T,
    /// Inverse variance across.
    pub across: T,
    /// Inverse variance along.
    pub along: T,
    /// The centre's place along the axis.
    pub centre: T,
}

impl<T: Float> Needle<T> {
    /// The needle of a packed row; `None` where the row is no needle's.
    #[inline(always)]
    pub fn of(row: &[T]) -> Option<Self> {
        let along = row[splats::ALONG];
        if along <= T::zero() {
            return None;
        }
        let normal = [row[splats::ACROSS_X], row[splats::ACROSS_Y]];
        Some(Self {
            normal,
            offset: row[splats::ACROSS_OFFSET],
            across: row[splats::CONIC_A] + row[splats::CONIC_C] - along,
            along,
            centre: normal[0] * row[splats::MEAN_Y] - normal[1] * row[splats::MEAN_X],
        })
    }

    /// A vector's parts across and along.
    #[inline(always)]
    pub fn parts(&self, [x, y]: [T; 2]) -> [T; 2] {
        let [nx, ny] = self.normal;
        [nx * x + ny * y, nx * y - ny * x]
    }
}
