//! Sums of screen-space gradients over views, by which density control decides where Gaussians are missing.

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
use crate::host::HostBackend;
use crate::splats::N_COLUMNS;

/// Columns of the sums: lengths of gradients, and views.
pub const SUMS: usize = 2;

/// The sums with a view added: to the first column the length of the gradient of a Gaussian's position on the screen, to
/// the second 1, where the view shows the Gaussian and the gradient is finite.
///
/// Not differentiable: on an autodiff device pass `tensor.inner()`. Sums whose storage nobody else holds are updated in
/// place.
///
/// # Shapes
/// `sums [N, 2]`, `splats [N, C]` as [`project`](crate::project::project) packs them, `v_splats [M, C]`: the gradients of several
/// sets' splats, of which these begin at row `first`. `-> [N, 2]`.
///
/// # Units
/// `half_size` is half the picture's width and height in pixels: with it the gradient does not depend on the picture's
/// size.
///
/// # Errors
/// [`KernelError::Shape`] when columns differ or rows are missing.
///
/// # Panics
/// On tensors of an autodiff device.
///
/// # Source
/// 3DGS, and gsplat for the unit.
///
/// # Example
/// ```
/// use burn::tensor::{Device, Tensor};
/// use dash_kernels::{screen_gradients::add_screen_gradients, splats};
///
/// let device = Device::flex();
/// let mut splat = [0.0; splats::N_COLUMNS];
/// splat[splats::RADIUS_X] = 2.0;
/// let mut gradient = [0.0; splats::N_COLUMNS];
/// (gradient[splats::MEAN_X], gradient[splats::MEAN_Y]) = (0.3, 0.8);
/// let row = |values| Tensor::<2>::from_floats([values], &device);
/// let sums = add_screen_gradients(Tensor::zeros([1, 2], &device), row(gradient), 0, row(splat), [10.0, 5.0])?;
/// assert_eq!(sums.into_data().try_into_vec::<f32>()?, [5.0, 1.0]);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn add_screen_gradients(
    sums: Tensor<2>,
    v_splats: Tensor<2>,
    first: usize,
    splats: Tensor<2>,
    half_size: [f32; 2],
) -> Result<Tensor<2>, KernelError> {
    let [n, _] = splats.dims();
    for (name, found, least, width) in [
        ("sums", sums.dims(), None, SUMS),
        ("v_splats", v_splats.dims(), Some(first + n), N_COLUMNS),
        ("splats", splats.dims(), None, N_COLUMNS),
    ] {
        let rows_fit = least.map_or(found[0] == n, |least| found[0] >= least);
        if !rows_fit || found[1] != width {
            let rows = least.map_or_else(|| n.to_string(), |least| format!("{least} or more"));
            return Err(KernelError::Shape {
                op: "add_screen_gradients",
                tensor: name,
                expected: format!("[{rows}, {width}]"),
                found: found.to_vec(),
            });
        }
    }
    if n == 0 {
        return Ok(sums);
    }
    Ok(Tensor::from_dispatch(Dispatch::add_screen_gradients(
        sums.into_dispatch(),
        v_splats.into_dispatch(),
        splats.into_dispatch(),
        first,
        half_size,
    )))
}

/// Dispatch of [`add_screen_gradients`] over the enabled backends.
#[backend_extension(Flex: cfg(feature = "flex"), NdArray: cfg(feature = "ndarray"), Cube: cfg(feature = "cube"))]
pub trait ScreenGradients: Backend {
    /// See [`add_screen_gradients`]; shapes have been checked.
    fn add_screen_gradients(
        sums: FloatTensor<Self>,
        v_splats: FloatTensor<Self>,
        splats: FloatTensor<Self>,
        first: usize,
        half_size: [f32; 2],
    ) -> FloatTensor<Self>;
}

impl<B: HostBackend> ScreenGradients for B {
    fn add_screen_gradients(
        sums: FloatTensor<B>,
        v_splats: FloatTensor<B>,
        splats: FloatTensor<B>,
        first: usize,
        half_size: [f32; 2],
    ) -> FloatTensor<B> {
        let (v_splats, splats) = (B::values(&v_splats), B::values(&splats));
        let [sums] = B::change([sums], |[sums]| {
            let v_splats = &v_splats[first * N_COLUMNS..];
            cpu::add_screen_gradients(sums, v_splats, &splats, half_size);
        });
        sums
    }
}
