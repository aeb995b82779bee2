//! The coarse trajectories of Gaussians.

use burn::tensor::Tensor;
use dash_kernels::displacement::displacement;
use dash_kernels::trajectory::{Polyline, squared_extent};
use serde::{Deserialize, Serialize};

use crate::ModelError;

/// Added below the square root of [`TrajectoryBasis::extent`], so that its gradient at rest is 0 and not NaN.
const EXTENT_EPSILON: f32 = 1e-12;

/// Basis functions of the coarse stage's trajectories.
///
/// # Example
/// ```
/// use burn::tensor::{Device, Tensor};
/// use dash_model::TrajectoryBasis;
///
/// // Two segments: 1 along x in the first half of the clip, 2 along y in the second.
/// let basis = TrajectoryBasis::polyline(2);
/// let coefficients = [[1.0, 0.0, 0.0, 0.0, 2.0, 0.0]];
/// let coefficients = Tensor::<2>::from_data(coefficients, &Device::flex());
/// let moved = basis.displacement(coefficients, 0.75)?.into_data();
/// assert_eq!(moved.try_into_vec::<f32>().expect("f32"), [1.0, 1.0, 0.0]);
/// # Ok::<(), dash_model::ModelError>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum TrajectoryBasis {
    /// `p(t) = p + t dp`, the paper's Eq. 4.
    Linear,
    /// A polyline through `p` at the anchor time. It adds `dp_k` over the k-th of equal spans of the clip, and subtracts it
    /// over spans before the anchor. A span's coefficient displaces all times beyond the span and none nearer to the anchor,
    /// so that motion is learnt outwards from there.
    Polyline {
        /// The number of spans.
        spans: usize,
        /// The time of no displacement, in [0, 1].
        #[serde(default, skip_serializing_if = "is_start")]
        anchor: f32,
    },
}

fn is_start(anchor: &f32) -> bool {
    *anchor == 0.0
}

impl TrajectoryBasis {
    /// A polyline of `spans` through `p` at the start of the clip.
    pub const fn polyline(spans: usize) -> Self {
        Self::Polyline { spans, anchor: 0.0 }
    }

    /// The time of no displacement, in [0, 1].
    pub fn anchor(self) -> f32 {
        match self {
            Self::Linear => 0.0,
            Self::Polyline { anchor, .. } => anchor,
        }
    }

    /// The number of basis functions `B`.
    pub fn len(self) -> usize {
        match self {
            Self::Linear => 1,
            Self::Polyline { spans, .. } => spans,
        }
    }

    /// Whether there are no basis functions, and therefore no motion.
    pub fn is_empty(self) -> bool {
        self.len() == 0
    }

    /// The values of the basis functions at `time` in [0, 1].
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

    /// The extent of each trajectory, `|dp|` of the paper: the square root of [`squared_extent`], a mean square displacement
    /// that is scaled to be `|dp|^2` for a steady motion.
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
    fn a_polyline_displaces_later_times_only_and_adds_up_its_spans() {
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
    fn an_anchored_polyline_displaces_times_beyond_its_spans_on_either_side() {
        let basis = TrajectoryBasis::Polyline {
            spans: 4,
            anchor: 0.625,
        };
        assert_eq!(basis.at(0.625), [0.0; 4]);
        assert_eq!(basis.at(1.0), [0.0, 0.0, 0.5, 1.0]);
        assert_eq!(basis.at(0.5), [0.0, 0.0, -0.5, 0.0]);
        assert_eq!(basis.at(0.125), [-0.5, -1.0, -0.5, 0.0]);
        // The extent of a steady motion does not depend on the anchor.
        let steady = || Tensor::<2>::from_data([[0.75; 12]], &burn::tensor::Device::flex());
        for basis in [basis, TrajectoryBasis::polyline(4)] {
            let extent = basis.extent(steady()).expect("four spans").into_data();
            let extent = extent.try_into_vec::<f32>().expect("f32")[0];
            assert!((extent - 27f32.sqrt()).abs() < 1e-5, "{extent}");
        }
    }
}
