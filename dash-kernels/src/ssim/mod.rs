//! Structural similarity with an 11x11 Gaussian window.

mod autodiff;
pub mod cpu;

use burn::backend::tensor::FloatTensor;
use burn::backend::{Backend, Dispatch, backend_extension};
use burn::tensor::Tensor;

use crate::KernelError;
use crate::host::{HostBackend, dims};

/// Per-pixel, per-channel structural similarity of two images.
///
/// # Shapes
/// `x [H, W, C]`, `y [H, W, C]` -> `[H, W, C]`, values in [-1, 1].
///
/// # Gradient
/// To both images.
///
/// # Errors
/// [`KernelError::Shape`] when the shapes differ or a size is zero.
pub fn ssim(x: Tensor<3>, y: Tensor<3>) -> Result<Tensor<3>, KernelError> {
    let (found, expected) = (y.dims(), x.dims());
    if found != expected || expected.contains(&0) {
        return Err(KernelError::Shape {
            op: "ssim",
            tensor: "y",
            expected: format!("{expected:?} with no zero"),
            found: found.to_vec(),
        });
    }
    Ok(Tensor::from_dispatch(Dispatch::ssim(
        x.into_dispatch(),
        y.into_dispatch(),
    )))
}

/// Dispatch of [`ssim`] over the enabled backends.
#[backend_extension(Autodiff, Flex: cfg(feature = "flex"), NdArray: cfg(feature = "ndarray"))]
pub trait Ssim: Backend {
    /// See [`ssim`].
    fn ssim(x: FloatTensor<Self>, y: FloatTensor<Self>) -> FloatTensor<Self>;
}

/// What a backend brings so that [`ssim`] can be differentiated on it.
pub trait SsimVjp: Ssim {
    /// Gradients `(v_x, v_y)` from the gradient of the output.
    fn ssim_vjp(
        x: FloatTensor<Self>,
        y: FloatTensor<Self>,
        v_out: FloatTensor<Self>,
    ) -> (FloatTensor<Self>, FloatTensor<Self>);
}

impl<B: HostBackend> Ssim for B {
    fn ssim(x: FloatTensor<B>, y: FloatTensor<B>) -> FloatTensor<B> {
        let shape = dims::<3>(&x);
        let out = cpu::ssim(&B::values(&x), &B::values(&y), shape);
        B::tensor(out, shape, &x)
    }
}

impl<B: HostBackend> SsimVjp for B {
    fn ssim_vjp(
        x: FloatTensor<B>,
        y: FloatTensor<B>,
        v_out: FloatTensor<B>,
    ) -> (FloatTensor<B>, FloatTensor<B>) {
        let shape = dims::<3>(&x);
        let (v_x, v_y) = cpu::ssim_vjp(&B::values(&x), &B::values(&y), &B::values(&v_out), shape);
        (B::tensor(v_x, shape, &x), B::tensor(v_y, shape, &x))
    }
}
