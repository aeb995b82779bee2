//! Structural similarity with an 11x11 Gaussian window.

mod autodiff;
mod blur;
pub mod cpu;
#[cfg(feature = "cube")]
pub(crate) mod cube;
pub mod reference;
pub(crate) mod terms;
#[cfg(test)]
mod tests;
mod window;

use burn::backend::tensor::FloatTensor;
use burn::backend::{Backend, Dispatch, backend_extension};
use burn::tensor::Tensor;

use crate::KernelError;
use crate::host::{HostBackend, dims};
use crate::limits::check_values;

/// Per-pixel, per-channel structural similarity of two images.
///
/// The window is a normalised Gaussian of 11x11 taps and sigma 1.5, zero-padded at the border;
/// C1 = 0.01^2 and C2 = 0.03^2, for values in [0, 1]. The two variances are clamped together at
/// zero from below. A pixel that is not finite counts as zero.
///
/// # Shapes
/// `x [H, W, C]`, `y [H, W, C]` -> `[H, W, C]`, values in [-1, 1].
///
/// # Gradient
/// To both images, each worked out only where it is tracked. Zero through the variances where
/// they were clamped, and at pixels that are not finite; the final clamp to [-1, 1] only removes
/// rounding and passes the gradient on. A gradient of the output that is not finite counts as zero.
///
/// # Errors
/// [`KernelError::Shape`] when the shapes differ or a size is zero, [`KernelError::Limit`] when the
/// images outgrow the device's largest buffer.
///
/// # Source
/// Wang et al. 2004, with the window and the padding of 3D Gaussian Splatting.
///
/// # Example
/// ```
/// use burn::tensor::{Device, Distribution, Tensor};
/// use dash_kernels::ssim::ssim;
///
/// let image = Tensor::<3>::random([24, 32, 3], Distribution::Uniform(0.0, 1.0), &Device::flex());
/// let same = ssim(image.clone(), image.clone())?.mean().into_scalar::<f32>();
/// assert!((same - 1.0).abs() < 1e-5);
/// let inverted = ssim(image.clone(), 1.0 - image)?.mean().into_scalar::<f32>();
/// assert!(inverted < 0.0);
/// # Ok::<(), dash_kernels::KernelError>(())
/// ```
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
    let n_values = expected.iter().product();
    check_values("the image", n_values, "compare smaller ones", &x.device())?;
    Ok(Tensor::from_dispatch(Dispatch::ssim(
        x.into_dispatch(),
        y.into_dispatch(),
    )))
}

/// Dispatch of [`ssim`] over the enabled backends.
#[backend_extension(Autodiff, Flex: cfg(feature = "flex"), NdArray: cfg(feature = "ndarray"), Cube: cfg(feature = "cube"))]
pub trait Ssim: Backend {
    /// See [`ssim`].
    fn ssim(x: FloatTensor<Self>, y: FloatTensor<Self>) -> FloatTensor<Self>;
}

/// The pullback of [`ssim`], which a backend has to implement for gradients.
pub trait SsimVjp: Ssim {
    /// Gradients `[v_x, v_y]` from the gradient of the output, where `needed`.
    fn ssim_vjp(
        x: FloatTensor<Self>,
        y: FloatTensor<Self>,
        v_out: FloatTensor<Self>,
        needed: [bool; 2],
    ) -> [Option<FloatTensor<Self>>; 2];
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
        [needs_x, needs_y]: [bool; 2],
    ) -> [Option<FloatTensor<B>>; 2] {
        let shape = dims::<3>(&x);
        let (x_values, y_values, v) = (B::values(&x), B::values(&y), B::values(&v_out));
        let gradient = |own, other| {
            let v_own = cpu::ssim_vjp(own, other, &v, shape);
            B::tensor(v_own, shape, &x)
        };
        [
            needs_x.then(|| gradient(&x_values, &y_values)),
            needs_y.then(|| gradient(&y_values, &x_values)),
        ]
    }
}
