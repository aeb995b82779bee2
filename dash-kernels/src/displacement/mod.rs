//! Displacements of trajectories at a time.

mod autodiff;
pub mod cpu;
#[cfg(feature = "cube")]
pub(crate) mod cube;
pub mod reference;
#[cfg(test)]
mod tests;

use burn::backend::tensor::FloatTensor;
use burn::backend::{Backend, Dispatch, backend_extension};
use burn::tensor::Tensor;

use crate::KernelError;
use crate::host::{HostBackend, dims};

/// Coordinates of a displacement.
pub(crate) const AXES: usize = 3;

/// Displacements of trajectories: the sum of their coefficients times the values of the basis functions at a time.
///
/// In place of a matrix product, for which GPUs with tensor cores round the factors to ten bits.
///
/// Coefficients that are not finite count as zero. Sums are clamped to the range of `f32`.
///
/// # Shapes
/// `coefficients [N, B * 3] -> [N, 3]`, for the `B` values of `basis`.
///
/// # Gradient
/// To the coefficients. A gradient of the output that is not finite counts as zero.
///
/// # Errors
/// [`KernelError::Shape`] when there are not three coefficients for each basis function,
/// [`KernelError::Config`] for a basis function whose value is not finite.
///
/// # Example
/// ```
/// use burn::tensor::{Device, Tensor};
/// use dash_kernels::displacement::displacement;
///
/// // One trajectory with two basis functions: the first moves along x, the second along y.
/// let coefficients = Tensor::from_floats([[1.0, 0.0, 0.0, 0.0, 2.0, 0.0]], &Device::flex());
/// let moved = displacement(coefficients, &[0.5, 0.25])?;
/// assert_eq!(moved.into_data().try_into_vec::<f32>()?, [0.5, 0.5, 0.0]);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn displacement(coefficients: Tensor<2>, basis: &[f32]) -> Result<Tensor<2>, KernelError> {
    let [n, width] = coefficients.dims();
    if width != AXES * basis.len() {
        return Err(KernelError::Shape {
            op: "displacement",
            tensor: "coefficients",
            expected: format!("[N, {}]", AXES * basis.len()),
            found: vec![n, width],
        });
    }
    check_basis("displacement", basis)?;
    // No device binds an empty buffer.
    if n == 0 || width == 0 {
        return Ok(Tensor::zeros([n, AXES], &coefficients.device()));
    }
    Ok(Tensor::from_dispatch(Dispatch::displacement(
        coefficients.into_dispatch(),
        basis.to_vec(),
    )))
}

pub(crate) fn check_basis(op: &'static str, basis: &[f32]) -> Result<(), KernelError> {
    match basis.iter().find(|value| !value.is_finite()) {
        None => Ok(()),
        Some(value) => Err(KernelError::Config {
            op,
            what: format!("a value of `basis` is {value}, expected finite values"),
        }),
    }
}

/// Dispatch of [`displacement`] over the enabled backends.
#[backend_extension(Autodiff, Flex: cfg(feature = "flex"), NdArray: cfg(feature = "ndarray"), Cube: cfg(feature = "cube"))]
pub trait Displacement: Backend {
    /// See [`displacement`]; shape and values have been checked.
    fn displacement(coefficients: FloatTensor<Self>, basis: Vec<f32>) -> FloatTensor<Self>;
}

/// The pullback of [`displacement`], which a backend has to implement for gradients.
pub trait DisplacementVjp: Displacement {
    /// Gradient of the coefficients from that of the output.
    fn displacement_vjp(v_out: FloatTensor<Self>, basis: Vec<f32>) -> FloatTensor<Self>;
}

impl<B: HostBackend> Displacement for B {
    fn displacement(coefficients: FloatTensor<B>, basis: Vec<f32>) -> FloatTensor<B> {
        let [n, _] = dims::<2>(&coefficients);
        let out = cpu::displacement(&B::values(&coefficients), &basis);
        B::tensor(out, [n, AXES], &coefficients)
    }
}

impl<B: HostBackend> DisplacementVjp for B {
    fn displacement_vjp(v_out: FloatTensor<B>, basis: Vec<f32>) -> FloatTensor<B> {
        let [n, _] = dims::<2>(&v_out);
        let gradient = cpu::displacement_vjp(&B::values(&v_out), &basis);
        B::tensor(gradient, [n, AXES * basis.len()], &v_out)
    }
}
