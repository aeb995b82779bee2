//! How much a field's features change beside some of its points.

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

/// Features, and how smooth they are.
#[derive(Debug, Clone)]
pub struct Smoothness {
    /// The features at the points themselves `[N, F]`.
    pub own: Tensor<2>,
    /// The mean over the points looked beside of the squared distance between the features at them and beside them, `[1]`.
    pub cost: Tensor<1>,
    /// Features of further rows `[R, F]`; `None` where there are none.
    pub others: Option<Tensor<2>>,
}

/// Parts `features [N + M + R, F]`: of `N` points, of `M` points beside those in `rows`, of whatever else was looked up with
/// them. And compares the second with the first.
///
/// # Gradient
/// To the features, in one pass.
///
/// # Errors
/// [`KernelError::Shape`] when there are too few features, [`KernelError::Config`] when a row is not there, occurs twice, or
/// none is given.
///
/// # Source
/// DASH Eq. 11.
///
/// # Example
/// ```
/// use burn::tensor::{Device, Tensor};
/// use dash_kernels::smoothness::smoothness;
///
/// let features = Tensor::from_floats([[1.0, 2.0], [0.0, 0.0], [1.0, 5.0]], &Device::flex());
/// // The third row is beside the first.
/// let found = smoothness(features, 2, &[0])?;
/// assert_eq!(found.own.dims(), [2, 2]);
/// assert_eq!(found.cost.into_scalar::<f32>(), 9.0);
/// assert!(found.others.is_none());
/// # Ok::<(), dash_kernels::KernelError>(())
/// ```
pub fn smoothness(features: Tensor<2>, n: usize, rows: &[u32]) -> Result<Smoothness, KernelError> {
    let [n_all, width] = features.dims();
    let m = rows.len();
    if n_all < n + m || width == 0 {
        return Err(KernelError::Shape {
            op: "smoothness",
            tensor: "features",
            expected: format!("[{} or more, 1 or more]", n + m),
            found: vec![n_all, width],
        });
    }
    let mut seen = vec![false; n];
    let is_new = |&row: &u32| {
        let seen = seen.get_mut(row as usize);
        seen.is_some_and(|seen| !std::mem::replace(seen, true))
    };
    if m == 0 || !rows.iter().all(is_new) {
        return Err(KernelError::Config {
            op: "smoothness",
            what: format!("`rows` are {m}, expected some, all different, below {n}"),
        });
    }
    let (own, cost, others) = Dispatch::smoothness(features.into_dispatch(), n, rows.to_vec());
    Ok(Smoothness {
        own: Tensor::from_dispatch(own),
        cost: Tensor::from_dispatch(cost),
        others: (n_all > n + m).then(|| Tensor::from_dispatch(others)),
    })
}

/// Dispatch of [`smoothness`] over the enabled backends.
#[backend_extension(Autodiff, Flex: cfg(feature = "flex"), NdArray: cfg(feature = "ndarray"), Cube: cfg(feature = "cube"))]
pub trait FieldSmoothness: Backend {
    /// Features of points, cost and features of further rows, if any; see [`smoothness`]. Shapes and rows have been checked.
    fn smoothness(
        features: FloatTensor<Self>,
        n: usize,
        rows: Vec<u32>,
    ) -> (FloatTensor<Self>, FloatTensor<Self>, FloatTensor<Self>);
}

/// The pullback of [`smoothness`], which a backend has to implement for gradients.
pub trait FieldSmoothnessVjp: FieldSmoothness {
    /// The gradient of the features from those of the three outputs; `None`: zero.
    fn smoothness_vjp(
        features: FloatTensor<Self>,
        gradients: [Option<FloatTensor<Self>>; 3],
        n: usize,
        rows: Vec<u32>,
    ) -> FloatTensor<Self>;
}

impl<B: HostBackend> FieldSmoothness for B {
    fn smoothness(
        features: FloatTensor<B>,
        n: usize,
        rows: Vec<u32>,
    ) -> (FloatTensor<B>, FloatTensor<B>, FloatTensor<B>) {
        let [n_all, width] = dims::<2>(&features);
        let values = B::values(&features);
        let cost = cpu::smoothness(&values, width, n, &rows);
        let first = n + rows.len();
        (
            B::tensor(values[..n * width].to_vec(), [n, width], &features),
            B::tensor(vec![cost], [1], &features),
            B::tensor(
                values[first * width..].to_vec(),
                [n_all - first, width],
                &features,
            ),
        )
    }
}

impl<B: HostBackend> FieldSmoothnessVjp for B {
    fn smoothness_vjp(
        features: FloatTensor<B>,
        gradients: [Option<FloatTensor<B>>; 3],
        n: usize,
        rows: Vec<u32>,
    ) -> FloatTensor<B> {
        let [n_all, width] = dims::<2>(&features);
        let [v_own, v_cost, v_others] = gradients.each_ref().map(|v| v.as_ref().map(B::values));
        let v_cost = v_cost.map_or(0.0, |v| v[0]);
        let values = B::values(&features);
        let outer = [v_own.as_deref(), v_others.as_deref()];
        let v_features = cpu::smoothness_vjp(&values, width, outer, v_cost, n, &rows);
        B::tensor(v_features, [n_all, width], &features)
    }
}
