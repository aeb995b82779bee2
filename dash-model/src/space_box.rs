//! The box of world space that a field covers.

use burn::tensor::{Tensor, TensorData};
use dash_kernels::KernelError;
use dash_kernels::space_time::{Beside, Bounds, space_time, space_time_beside};
use serde::{Deserialize, Serialize};

/// An axis-aligned box of world space that a field maps onto the unit cube.
///
/// # Example
/// ```
/// use burn::tensor::{Device, Tensor};
/// use dash_model::SpaceBox;
///
/// let space = SpaceBox::fixed(2.0);
/// let points = Tensor::<2>::from_data([[-2.0, 0.0, 1.0]], &Device::flex());
/// let unit = space.points_at(points, 0.25)?.into_data();
/// assert_eq!(unit.try_into_vec::<f32>().expect("f32"), [0.0, 0.5, 0.75, 0.25]);
///
/// // Around a point cloud, without the outermost percent along each axis.
/// let cloud: Vec<[f32; 3]> = (0..200).map(|i| [0.01 * i as f32, 0.0, 1.0]).collect();
/// assert!(SpaceBox::around(&cloud, 0.01, 0.1).diagonal() > 2.0);
/// # Ok::<(), dash_kernels::KernelError>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SpaceBox {
    /// Smallest corner, world units.
    pub min: [f32; 3],
    /// Largest corner, world units.
    pub max: [f32; 3],
    /// Whether points outside are clamped to the box. If not, features are zero there, as in the released DASH code.
    pub clamp: bool,
}

impl SpaceBox {
    /// The box `[-bound, bound]^3` of the released code, without clamping.
    pub fn fixed(bound: f32) -> Self {
        Self {
            min: [-bound; 3],
            max: [bound; 3],
            clamp: false,
        }
    }

    /// A box around points, with clamping: from the `tail` to the `1 - tail` quantile along each axis, widened on both sides by
    /// `margin` times its size. Points that are not finite are ignored.
    pub fn around(points: &[[f32; 3]], tail: f32, margin: f32) -> Self {
        let (mut min, mut max) = ([-1.0f32; 3], [1.0f32; 3]);
        for axis in 0..3 {
            let mut values: Vec<f32> = points
                .iter()
                .map(|p| p[axis])
                .filter(|v| v.is_finite())
                .collect();
            if values.is_empty() {
                continue;
            }
            values.sort_by(f32::total_cmp);
            let last = (values.len() - 1) as f32;
            let low = values[(tail * last).floor() as usize];
            let high = values[((1.0 - tail) * last).ceil() as usize];
            let pad = margin * (high - low) + 1e-6 * (1.0 + low.abs().max(high.abs()));
            min[axis] = low - pad;
            max[axis] = high + pad;
        }
        // A flat scene would have cells of no width: no axis is thinner than a tenth of the widest.
        let widest = (0..3).map(|a| max[a] - min[a]).fold(0.0, f32::max);
        for axis in 0..3 {
            let missing = 0.1 * widest - (max[axis] - min[axis]);
            if missing > 0.0 {
                min[axis] -= missing / 2.0;
                max[axis] += missing / 2.0;
            }
        }
        Self {
            min,
            max,
            clamp: true,
        }
    }

    /// Length of the diagonal, world units.
    pub fn diagonal(&self) -> f32 {
        (0..3)
            .map(|a| (self.max[a] - self.min[a]).powi(2))
            .sum::<f32>()
            .sqrt()
    }

    fn scale(&self) -> [f32; 3] {
        std::array::from_fn(|a| 1.0 / (self.max[a] - self.min[a]))
    }

    /// World positions in the unit cube, with the time as fourth coordinate.
    ///
    /// # Shapes
    /// `[N, 3] -> [N, 4]`
    ///
    /// # Errors
    /// When there are other than three coordinates, or the box or the time is not finite.
    pub fn points_at(&self, positions: Tensor<2>, time: f32) -> Result<Tensor<2>, KernelError> {
        space_time(positions, &self.bounds(), time)
    }

    /// [`SpaceBox::points_at`], and behind these others beside some of them, clamped to the unit cube.
    ///
    /// # Shapes
    /// `[N, 3]`, `M` points beside `-> [N + M, 4]`
    ///
    /// # Errors
    /// As [`SpaceBox::points_at`], and when a row is not there.
    pub fn points_beside(
        &self,
        positions: Tensor<2>,
        time: f32,
        beside: Beside,
    ) -> Result<Tensor<2>, KernelError> {
        space_time_beside(positions, beside, &self.bounds(), time)
    }

    fn bounds(&self) -> Bounds {
        Bounds {
            min: self.min,
            scale: self.scale(),
            clamp: self.clamp,
        }
    }

    /// World positions in the unit cube.
    ///
    /// # Shapes
    /// `[N, 3] -> [N, 3]`
    pub fn normalize(&self, positions: Tensor<2>) -> Tensor<2> {
        let device = positions.device();
        let row = |values: [f32; 3]| {
            Tensor::<2>::from_data(TensorData::new(values.to_vec(), [1, 3]), &device)
        };
        let unit = (positions - row(self.min)) * row(self.scale());
        if self.clamp {
            unit.clamp(0.0, 1.0)
        } else {
            unit
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_box_ignores_outliers_and_nan_and_is_never_flat() {
        let mut points: Vec<[f32; 3]> = (0..1000).map(|i| [i as f32 / 999.0, 2.0, -1.0]).collect();
        points.push([f32::NAN, 0.0, 0.0]);
        points.push([1e9, 0.0, 0.0]);
        let space = SpaceBox::around(&points, 0.01, 0.1);
        assert!(space.max[0] < 1.5 && space.min[0] > -0.5, "{space:?}");
        assert!(space.max[1] - space.min[1] > 0.05);
        assert!(SpaceBox::around(&[], 0.01, 0.1).diagonal().is_finite());
    }
}
