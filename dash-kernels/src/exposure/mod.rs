//! Colours of packed splats as a camera with an exposure of its own sees them.

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
use crate::splats::N_COLUMNS;

/// Channels of a colour.
pub const CHANNELS: usize = 3;
/// Numbers of a response: gains beyond 1, then offsets.
pub const RESPONSE: usize = 2 * CHANNELS;

/// The splats with each colour `c` as `c (1 + gain) + offset`; other columns do not change.
///
/// # Shapes
/// `splats [N, C]` as [`project`](crate::project::project) packs them, `response [2, 3]`: gains beyond 1, then offsets, of red,
/// green and blue. `-> [N, C]`.
///
/// # Gradient
/// To both. Gradients of the output that are not finite count as zero for the response; for splats they are passed on, as
/// from [`rasterize`](crate::rasterize::rasterize), which gives none.
///
/// # Errors
/// [`KernelError::Shape`] when a shape is another.
///
/// # Example
/// ```
/// use burn::tensor::{Device, Tensor};
/// use dash_kernels::{exposure::expose, splats};
///
/// let device = Device::flex();
/// let mut splat = [0.0; splats::N_COLUMNS];
/// splat[splats::RED..=splats::BLUE].copy_from_slice(&[0.5, 0.25, 1.0]);
/// let response = Tensor::<2>::from_floats([[1.0, 0.0, 0.0], [0.0, 0.5, 0.0]], &device);
/// let seen = expose(Tensor::from_floats([splat], &device), response)?;
/// let seen = seen.into_data().try_into_vec::<f32>()?;
/// assert_eq!(seen[splats::RED..=splats::BLUE], [1.0, 0.75, 1.0]);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn expose(splats: Tensor<2>, response: Tensor<2>) -> Result<Tensor<2>, KernelError> {
    let [n, width] = splats.dims();
    for (name, found, expected) in [
        ("splats", [n, width], [n, N_COLUMNS]),
        ("response", response.dims(), [2, CHANNELS]),
    ] {
        if found != expected {
            return Err(KernelError::Shape {
                op: "expose",
                tensor: name,
                expected: format!("{expected:?}"),
                found: found.to_vec(),
            });
        }
    }
    if n == 0 {
        return Ok(splats);
    }
    Ok(Tensor::from_dispatch(Dispatch::expose(
        splats.into_dispatch(),
        response.into_dispatch(),
    )))
}

/// Dispatch of [`expose`] over the enabled backends.
#[backend_extension(Autodiff, Flex: cfg(feature = "flex"), NdArray: cfg(feature = "ndarray"), Cube: cfg(feature = "cube"))]
pub trait Expose: Backend {
    /// See [`expose`]; shapes have been checked, and there is a splat.
    fn expose(splats: FloatTensor<Self>, response: FloatTensor<Self>) -> FloatTensor<Self>;
}

/// The pullback of [`expose`], which a backend has to implement for gradients.
pub trait ExposeVjp: Expose {
    /// Gradients of splats and response from that of the output.
    fn expose_vjp(
        splats: FloatTensor<Self>,
        response: FloatTensor<Self>,
        v_out: FloatTensor<Self>,
    ) -> [FloatTensor<Self>; 2];
}

impl<B: HostBackend> Expose for B {
    fn expose(splats: FloatTensor<B>, response: FloatTensor<B>) -> FloatTensor<B> {
        let response = B::values(&response).into_owned();
        let [splats] = B::change([splats], |[splats]| cpu::expose(splats, &response));
        splats
    }
}

impl<B: HostBackend> ExposeVjp for B {
    fn expose_vjp(
        splats: FloatTensor<B>,
        response: FloatTensor<B>,
        v_out: FloatTensor<B>,
    ) -> [FloatTensor<B>; 2] {
        let [n, _] = dims::<2>(&splats);
        let (v_splats, v_response) = cpu::expose_vjp(
            &B::values(&splats),
            &B::values(&response),
            &B::values(&v_out),
        );
        [
            B::tensor(v_splats, [n, N_COLUMNS], &splats),
            B::tensor(v_response.to_vec(), [2, CHANNELS], &splats),
        ]
    }
}
