//! Rasterization of packed 2D splats: tiles, front-to-back blending, early stop.

mod autodiff;
pub mod cpu;
#[cfg(feature = "cube")]
mod cube;
mod needle;
pub mod reference;
#[cfg(test)]
mod tests;
pub(crate) mod tiles;

use std::fmt::Debug;

use burn::backend::tensor::FloatTensor;
use burn::backend::{Backend, Dispatch, backend_extension};
use burn::tensor::Tensor;

use crate::KernelError;
use crate::host::{HostBackend, dims};
use crate::limits::check_values;
use crate::splats::{N_COLUMNS, N_DIFFERENTIABLE};

const OP: &str = "rasterize";

/// Channels of the rendered image: red, green, blue, alpha, depth.
pub const N_CHANNELS: usize = 5;
/// Channel of the accumulated alpha.
pub const CHANNEL_ALPHA: usize = 3;
/// Channel of the depth: the sum of visibility times depth, not divided by alpha.
pub const CHANNEL_DEPTH: usize = 4;

/// Options of [`rasterize`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RasterizeOptions {
    /// Image width in pixels.
    pub width: usize,
    /// Image height in pixels.
    pub height: usize,
    /// Colour behind the splats.
    pub background: [f32; 3],
}

/// Draws packed splats front to back; the columns are those of [`splats`](crate::splats).
///
/// A splat's visibility in a pixel is its alpha times the transmittance of the splats in front of it.
/// A splat's alpha at a pixel's centre is `min(0.99, opacity * exp(-sigma))` with
/// `sigma = a dx^2 / 2 + b dx dy + c dy^2 / 2`, or that of its axes where it is a needle, see
/// [`ACROSS_X`](crate::splats::ACROSS_X); it is skipped where alpha is under 1/255 or sigma
/// is negative by more than rounding, and where the radii say that this is so. Splats are ordered by depth, equal
/// depths by row. A pixel is finished before the splat that would bring its transmittance under
/// 1e-4. Rows with a radius of zero, an opacity under 1/255 or a value that is not finite draw
/// nothing.
///
/// # Shapes
/// `splats [N, C]` -> `[H, W, 5]`: red, green, blue (over the background), alpha, depth (sum of
/// visibility times depth).
///
/// # Gradient
/// To all columns but the radii; zero to opacity, mean and conic where alpha was clamped to 0.99. A needle's goes to
/// its shape in the frame of its axes, and not to the conic.
///
/// # Errors
/// [`KernelError::Shape`] when the rows have another width, [`KernelError::Config`] when the image
/// size or the background is out of range, [`KernelError::Limit`] when the image or the
/// splats outgrow the device's largest buffer.
///
/// # Source
/// Kerbl et al. 2023 (3DGS).
///
/// # Example
/// ```
/// use burn::tensor::{Device, Tensor};
/// use dash_kernels::rasterize::{N_CHANNELS, RasterizeOptions, rasterize};
///
/// let options = RasterizeOptions { width: 8, height: 6, background: [0.0, 0.0, 1.0] };
/// // A red splat with its centre on that of the pixel in column 3 and row 2; see `splats` for the columns.
/// let splat = [3.5, 2.5, 1.0, 0.0, 1.0, 0.75, 1.0, 0.0, 0.0, 2.0, 4.0, 4.0, 0.0, 0.0, 0.0, 0.0];
/// let splats = Tensor::from_floats([splat], &Device::flex());
/// let image = rasterize(splats, &options)?;
/// assert_eq!(image.dims(), [6, 8, N_CHANNELS]);
/// let pixel = image.slice([2..3, 3..4]).into_data().try_into_vec::<f32>()?;
/// assert_eq!(pixel, [0.75, 0.0, 0.25, 0.75, 1.5]);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn rasterize(splats: Tensor<2>, options: &RasterizeOptions) -> Result<Tensor<3>, KernelError> {
    let found = splats.dims();
    if found[1] != N_COLUMNS {
        return Err(KernelError::Shape {
            op: OP,
            tensor: "splats",
            expected: format!("[N, {N_COLUMNS}]"),
            found: found.to_vec(),
        });
    }
    let refuse = |what: String| Err(KernelError::Config { op: OP, what });
    let sizes = 1..=tiles::MAX_IMAGE_SIDE;
    if !sizes.contains(&options.width) || !sizes.contains(&options.height) {
        return refuse(format!(
            "the image is {} x {}, expected 1 to {} pixels a side",
            options.width,
            options.height,
            tiles::MAX_IMAGE_SIDE
        ));
    }
    if !options.background.iter().all(|value| value.is_finite()) {
        return refuse(format!(
            "the background must be finite, found {:?}",
            options.background
        ));
    }
    let device = splats.device();
    let n_values = options.width * options.height * N_CHANNELS;
    check_values("the image", n_values, "draw a smaller one", &device)?;
    let n_values = found[0] * N_COLUMNS;
    check_values("the splats", n_values, "draw fewer Gaussians", &device)?;
    Ok(Tensor::from_dispatch(Dispatch::rasterize(
        splats.into_dispatch(),
        *options,
    )))
}

/// Dispatch of [`rasterize`] over the enabled backends.
#[backend_extension(Autodiff, Flex: cfg(feature = "flex"), NdArray: cfg(feature = "ndarray"), Cube: cfg(feature = "cube"))]
pub trait Rasterize: Backend {
    /// See [`rasterize`].
    fn rasterize(splats: FloatTensor<Self>, options: RasterizeOptions) -> FloatTensor<Self>;
}

/// The pullback of [`rasterize`], which a backend has to implement for gradients.
pub trait RasterizeVjp: Rasterize {
    /// State of the forward pass for the backward pass.
    type Saved: Clone + Send + Debug + 'static;

    /// The image, and what [`rasterize_vjp`](Self::rasterize_vjp) needs.
    fn rasterize_saving(
        splats: FloatTensor<Self>,
        options: RasterizeOptions,
    ) -> (FloatTensor<Self>, Self::Saved);

    /// Gradient of the splats from that of the image.
    fn rasterize_vjp(saved: Self::Saved, v_image: FloatTensor<Self>) -> FloatTensor<Self>;
}

impl<B: HostBackend> Rasterize for B {
    fn rasterize(splats: FloatTensor<B>, options: RasterizeOptions) -> FloatTensor<B> {
        let image = cpu::rasterize(&B::values(&splats), &options);
        B::tensor(image, [options.height, options.width, N_CHANNELS], &splats)
    }
}

impl<B: HostBackend> RasterizeVjp for B {
    type Saved = cpu::Saved;

    fn rasterize_saving(
        splats: FloatTensor<B>,
        options: RasterizeOptions,
    ) -> (FloatTensor<B>, cpu::Saved) {
        let (image, saved) = cpu::rasterize_saving(&B::values(&splats), &options);
        let shape = [options.height, options.width, N_CHANNELS];
        (B::tensor(image, shape, &splats), saved)
    }

    fn rasterize_vjp(saved: cpu::Saved, v_image: FloatTensor<B>) -> FloatTensor<B> {
        debug_assert_eq!(dims::<3>(&v_image)[2], N_CHANNELS);
        let v_splats = cpu::rasterize_vjp(&saved, &B::values(&v_image));
        B::tensor(v_splats, [saved.n_splats(), N_COLUMNS], &v_image)
    }
}

const _: () = assert!(
    N_DIFFERENTIABLE < N_COLUMNS,
    "the radii come after the columns with a gradient"
);
