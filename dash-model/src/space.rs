//! The box of space that a field covers, and the coarse trajectories in it.

use burn::tensor::{Tensor, TensorData};
use dash_kernels::KernelError;
use dash_kernels::displacement::displacement;
use dash_kernels::space_time::{Bounds, space_time};
use dash_kernels::trajectory::{Polyline, squared_extent};
use serde::{Deserialize, Serialize};

use crate::ModelError;

/// An axis-aligned box mapped onto the unit cube.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SpaceBox {
    /// Smallest corner, world units.
    pub min: [f32; 3],
    /// Largest corner, world units.
    pub max: [f32; 3],
    /// Whether points outside are moved to the nearest face. If not, fields are zero there, as in
    /// the released DASH code.
    pub clamp: bool,
}

impl SpaceBox {
    /// The box `[-bound, bound]^3` of the released code, with nothing outside it.
    pub fn fixed(bound: f32) -> Self {
        Self {
            min: [-bound; 3],
            max: [bound; 3],
            clamp: false,
        }
    }

    /// A box around points: from the `tail` to the `1 - tail` quantile of each axis, widened by
    /// `margin` times its size. Points that are not finite do not count.
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
        // No axis thinner than a tenth of the widest: a flat scene would have cells of no width.
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

    /// World positions in the unit cube, and a time as the fourth coordinate.
    ///
    /// # Shapes
    /// `[N, 3] -> [N, 4]`
    ///
    /// # Errors
    /// When there are other than three coordinates, or the box or the time is not finite.
    pub fn points_at(&self, positions: Tensor<2>, time: f32) -> Result<Tensor<2>, KernelError> {
        let bounds = Bounds {
            min: self.min,
            scale: self.scale(),
            clamp: self.clamp,
        };
        space_time(positions, &bounds, time)
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

/// Guards the square root of [`TrajectoryBasis::extent`]: its gradient at rest is 0, not NaN.
const EXTENT_EPSILON: f32 = 1e-12;

/// Functions of time that the coarse stage's trajectories are made of.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum TrajectoryBasis {
    /// `p(t) = p + t dp`, the paper's Eq. 4.
    Linear,
    /// A polyline that is at `p` at one time, from where on it adds `dp_k` over the k-th of equal spans of the
    /// clip, and before which it takes it away. What is learnt of one span moves all times beyond it along
    /// but none nearer, so motion can be followed from that time on.
    Polyline {
        /// The number of spans.
        spans: usize,
        /// The time at which nothing is displaced, in [0, 1].
        #[serde(default, skip_serializing_if = "is_start")]
        anchor: f32,
    },
}

fn is_start(anchor: &f32) -> bool {
    *anchor == 0.0
}

impl TrajectoryBasis {
    /// A polyline of `spans` that is at `p` at the start of the clip.
    pub const fn polyline(spans: usize) -> Self {
        Self::Polyline { spans, anchor: 0.0 }
    }

    /// The time at which nothing is displaced, in [0, 1].
    pub fn anchor(self) -> f32 {
        match self {
            Self::Linear => 0.0,
            Self::Polyline { anchor, .. } => anchor,
        }
    }

    /// The number of functions `B`.
    pub fn len(self) -> usize {
        match self {
            Self::Linear => 1,
            Self::Polyline { spans, .. } => spans,
        }
    }

    /// Whether there are none, so that nothing moves.
    pub fn is_empty(self) -> bool {
        self.len() == 0
    }

    /// The functions' values at `time` in [0, 1].
    pub fn at(self, time: f32) -> Vec<f32> {
        match self {
            Self::Linear => vec![time],
            Self::Polyline { spans, anchor } => (0..spans)
                .map(|k| {
                    let way = |time: f32| (time * spans as f32 - k as f32).clamp(0.0, 1.0);
                    way(time) - way(anchor)
                })
                .collect(),
        }
    }

    /// Displacement at `time`.
    ///
    /// # Shapes
    /// `coefficients [N, B * 3] -> [N, 3]`, world units.
    ///
    /// # Errors
    /// When the shape does not fit.
    pub fn displacement(self, coefficients: Tensor<2>, time: f32) -> Result<Tensor<2>, ModelError> {
        Ok(displacement(coefficients, &self.at(time))?)
    }

    /// How far each trajectory goes, `|dp|` of the paper: the square root of [`squared_extent`], the mean square
    /// distance from where nothing is displaced, in units that make it `|dp|^2` for a steady motion, as the paper
    /// measures it.
    ///
    /// # Shapes
    /// `coefficients [N, B * 3] -> [N]`, world units.
    ///
    /// # Errors
    /// When the shape does not fit.
    pub fn extent(self, coefficients: Tensor<2>) -> Result<Tensor<1>, ModelError> {
        let squared = squared_extent(coefficients, Polyline::new(self.len(), self.anchor())?)?;
        Ok((squared + EXTENT_EPSILON).sqrt())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_polyline_moves_later_times_only_and_ends_where_its_parts_add_up() {
        let basis = TrajectoryBasis::polyline(4);
        assert_eq!(basis.at(0.0), [0.0; 4]);
        assert_eq!(basis.at(0.375), [1.0, 0.5, 0.0, 0.0]);
        assert_eq!(basis.at(1.0), [1.0; 4]);
        let coefficients = Tensor::<2>::from_data(
            [[1.0, 0.0, 0.0, 0.0, 2.0, 0.0, 0.0, 0.0, 3.0, 0.0, 0.0, 0.0]],
            &burn::tensor::Device::flex(),
        );
        let at = |time| {
            let moved = basis.displacement(coefficients.clone(), time);
            moved.expect("widths fit").into_data()
        };
        assert_eq!(
            at(0.375).try_into_vec::<f32>().expect("f32"),
            [1.0, 1.0, 0.0]
        );
        assert_eq!(at(1.0).try_into_vec::<f32>().expect("f32"), [1.0, 2.0, 3.0]);
    }

    #[test]
    fn an_anchored_polyline_moves_times_beyond_its_spans_on_either_side() {
        let basis = TrajectoryBasis::Polyline {
            spans: 4,
            anchor: 0.625,
        };
        assert_eq!(basis.at(0.625), [0.0; 4]);
        assert_eq!(basis.at(1.0), [0.0, 0.0, 0.5, 1.0]);
        assert_eq!(basis.at(0.5), [0.0, 0.0, -0.5, 0.0]);
        assert_eq!(basis.at(0.125), [-0.5, -1.0, -0.5, 0.0]);
        // A steady motion goes as far whatever the time at which nothing is displaced.
        let steady = || Tensor::<2>::from_data([[0.75; 12]], &burn::tensor::Device::flex());
        for basis in [basis, TrajectoryBasis::polyline(4)] {
            let extent = basis.extent(steady()).expect("four spans").into_data();
            let extent = extent.try_into_vec::<f32>().expect("f32")[0];
            assert!((extent - 27f32.sqrt()).abs() < 1e-5, "{extent}");
        }
    }

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
