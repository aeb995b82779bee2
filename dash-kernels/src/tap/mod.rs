//! The gradient of a tensor in the middle of a graph.

mod autodiff;
#[cfg(test)]
mod tests;

use burn::backend::tensor::FloatTensor;
use burn::backend::{Backend, Dispatch, backend_extension};
use burn::tensor::Tensor;

use crate::host::HostBackend;

/// `values`, whose gradient `leaf` has after the backward pass: Burn keeps gradients of leaves alone. Nothing is copied and
/// nothing is launched.
///
/// # Shapes
/// `values` and `leaf` of any shapes. The gradient that is found under `leaf` has the shape of `values`.
///
/// # Example
/// ```
/// use burn::tensor::{Device, Tensor};
/// use dash_kernels::tap::tap;
///
/// let device = Device::flex().autodiff();
/// let parameter = Tensor::<1>::from_floats([1.0, 2.0], &device).require_grad();
/// let leaf = Tensor::<1>::empty([1], &device).require_grad();
/// let middle = tap(parameter.clone() * 3.0, leaf.clone());
/// let gradients = (middle * 5.0).sum().backward();
/// let of = |tensor: &Tensor<1>| tensor.grad(&gradients).expect("tracked").into_data();
/// assert_eq!(of(&leaf).try_into_vec::<f32>()?, [5.0, 5.0]);
/// assert_eq!(of(&parameter).try_into_vec::<f32>()?, [15.0, 15.0]);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn tap<const R: usize>(values: Tensor<R>, leaf: Tensor<R>) -> Tensor<R> {
    Tensor::from_dispatch(Dispatch::tap(values.into_dispatch(), leaf.into_dispatch()))
}

/// Dispatch of [`tap`] over the enabled backends.
#[backend_extension(Autodiff, Flex: cfg(feature = "flex"), NdArray: cfg(feature = "ndarray"), Cube: cfg(feature = "cube"))]
pub trait Tap: Backend {
    /// See [`tap`].
    fn tap(values: FloatTensor<Self>, leaf: FloatTensor<Self>) -> FloatTensor<Self>;
}

impl<B: HostBackend> Tap for B {
    fn tap(values: FloatTensor<B>, _leaf: FloatTensor<B>) -> FloatTensor<B> {
        values
    }
}

#[cfg(feature = "cube")]
impl Tap for burn_cubecl::CubeBackend {
    fn tap(values: FloatTensor<Self>, _leaf: FloatTensor<Self>) -> FloatTensor<Self> {
        values
    }
}
