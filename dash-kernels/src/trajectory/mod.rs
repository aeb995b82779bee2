//! Extents of trajectories.

mod autodiff;
pub mod cpu;
#[cfg(feature = "cube")]
mod cube;
pub mod reference;
#[cfg(test)]
mod tests;

use burn::backend::tensor::FloatTensor;
use burn::backend::{Backend, Dispatch, backend_extension};
use burn::tensor::Tensor;

use crate::KernelError;
use crate::host::{HostBackend, dims};

/// Displacements are clamped to this length along each axis, so that their squares stay finite.
pub const LARGEST: f32 = 1e16;

/// Piecewise linear trajectories over `n_spans` equal spans of [0, 1], with no displacement at the time `anchor`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Polyline {
    n_spans: usize,
    /// The span that contains the anchor.
    span: usize,
    /// The fraction of that span up to the anchor.
    share: f32,
    /// One over the sum of a steady motion of length one.
    inverse_steady: f32,
}

impl Polyline {
    /// A polyline of `n_spans` spans with no displacement at `anchor`.
    ///
    /// # Errors
    /// [`KernelError::Config`] without spans, or for a time outside of [0, 1].
    pub fn new(n_spans: usize, anchor: f32) -> Result<Self, KernelError> {
        if n_spans == 0 || !(0.0..=1.0).contains(&anchor) {
            return Err(KernelError::Config {
                op: "squared_extent",
                what: format!(
                    "{n_spans} spans with anchor {anchor}, expected one or more and a time in [0, 1]"
                ),
            });
        }
        let at = anchor * n_spans as f32;
        let span = (at as usize).min(n_spans - 1);
        let steady: f64 = (0..=n_spans)
            .map(|knot| (knot as f64 / n_spans as f64 - f64::from(anchor)).powi(2))
            .sum();
        Ok(Self {
            n_spans,
            span,
            share: at - span as f32,
            inverse_steady: (1.0 / steady) as f32,
        })
    }

    /// Coefficients of one trajectory.
    fn width(self) -> usize {
        3 * self.n_spans
    }
}

/// Sum of the squared displacements at all knots, divided by that of a steady motion of length one. A steady motion of
/// displacement `dp` gives `|dp|^2`.
///
/// A coefficient that is not finite counts as zero.
///
/// # Shapes
/// `coefficients [N, B * 3] -> [N]`: the displacement over each of the `B` spans.
///
/// # Gradient
/// To the coefficients; that of a displacement beyond [`LARGEST`] is that of the clamped one. A gradient of the output
/// that is not finite counts as zero.
///
/// # Errors
/// [`KernelError::Shape`] when there are not three coefficients for each span.
///
/// # Example
/// ```
/// use burn::tensor::{Device, Tensor};
/// use dash_kernels::trajectory::{Polyline, squared_extent};
///
/// // A steady motion of length 2 along x over the whole clip, in two equal spans.
/// let polyline = Polyline::new(2, 0.0)?;
/// let coefficients = Tensor::from_floats([[1.0, 0.0, 0.0, 1.0, 0.0, 0.0]], &Device::flex());
/// let extent = squared_extent(coefficients, polyline)?.into_scalar::<f32>();
/// assert!((extent - 4.0).abs() < 1e-6);
/// # Ok::<(), dash_kernels::KernelError>(())
/// ```
pub fn squared_extent(
    coefficients: Tensor<2>,
    polyline: Polyline,
) -> Result<Tensor<1>, KernelError> {
    let [n, width] = coefficients.dims();
    if width != polyline.width() {
        return Err(KernelError::Shape {
            op: "squared_extent",
            tensor: "coefficients",
            expected: format!("[N, {}]", polyline.width()),
            found: vec![n, width],
        });
    }
    // No device binds an empty buffer.
    if n == 0 {
        return Ok(Tensor::zeros([0], &coefficients.device()));
    }
    Ok(Tensor::from_dispatch(Dispatch::squared_extent(
        coefficients.into_dispatch(),
        polyline,
    )))
}

/// Dispatch of [`squared_extent`] over the enabled backends.
#[backend_extension(Autodiff, Flex: cfg(feature = "flex"), NdArray: cfg(feature = "ndarray"), Cube: cfg(feature = "cube"))]
pub trait SquaredExtent: Backend {
    /// See [`squared_extent`]; the shape has been checked.
    fn squared_extent(coefficients: FloatTensor<Self>, polyline: Polyline) -> FloatTensor<Self>;
}

/// The pullback of [`squared_extent`], which a backend has to implement for gradients.
pub trait SquaredExtentVjp: SquaredExtent {
    /// Gradient of the coefficients from that of the output.
    fn squared_extent_vjp(
        coefficients: FloatTensor<Self>,
        v_out: FloatTensor<Self>,
        polyline: Polyline,
    ) -> FloatTensor<Self>;
}

impl<B: HostBackend> SquaredExtent for B {
    fn squared_extent(coefficients: FloatTensor<B>, polyline: Polyline) -> FloatTensor<B> {
        let [n, _] = dims::<2>(&coefficients);
        let out = cpu::squared_extent(&B::values(&coefficients), polyline);
        B::tensor(out, [n], &coefficients)
    }
}

impl<B: HostBackend> SquaredExtentVjp for B {
    fn squared_extent_vjp(
        coefficients: FloatTensor<B>,
        v_out: FloatTensor<B>,
        polyline: Polyline,
    ) -> FloatTensor<B> {
        let shape = dims::<2>(&coefficients);
        let (values, v) = (B::values(&coefficients), B::values(&v_out));
        let gradient = cpu::squared_extent_vjp(&values, &v, polyline);
        B::tensor(gradient, shape, &coefficients)
    }
}
