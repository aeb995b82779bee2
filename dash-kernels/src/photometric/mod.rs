//! The photometric loss of 3D Gaussian Splatting, with its gradient, in one pass over the pixels.

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
use crate::limits::check_values;

/// Losses of an image.
#[derive(Debug, Clone)]
pub struct Photometric {
    /// `(1 - dssim) L1 + dssim (1 - SSIM)`, `[1]`.
    pub loss: Tensor<1>,
    /// Mean squared error, `[1]`. Not differentiable: its gradient counts as zero.
    pub mse: Tensor<1>,
}

/// The training loss of 3D Gaussian Splatting: `(1 - dssim) L1 + dssim (1 - SSIM)`, with the mean absolute error L1 and
/// the mean [structural similarity](crate::ssim::ssim).
///
/// # Shapes
/// `image [H, W, C + E]`, `target [H, W, C]` -> two numbers. Channels beyond the target's, such as the alpha and depth of
/// [`rasterize`](crate::rasterize::rasterize), are ignored.
///
/// # Gradient
/// To the image; the target is a constant. The gradient of the absolute error is zero where both are equal, that of the
/// similarity is [`ssim`](crate::ssim::ssim)'s. A pixel that is not finite makes the loss not finite and has no
/// gradient. A target that is not finite makes the loss not finite, too; there the gradient is that of the similarity
/// alone.
///
/// # Errors
/// [`KernelError::Shape`] when the heights or widths differ, the image has fewer channels or a size is zero, [`KernelError::Config`] when `dssim` is
/// not in [0, 1], [`KernelError::Limit`] when the images outgrow the device's largest buffer.
///
/// # Source
/// Kerbl et al. 2023, Eq. 7.
///
/// # Example
/// ```
/// use burn::tensor::{Device, Tensor};
/// use dash_kernels::photometric::photometric;
///
/// let device = Device::flex().autodiff();
/// let image = Tensor::<3>::full([16, 16, 3], 0.5, &device).require_grad();
/// let target = Tensor::full([16, 16, 3], 0.75, &device);
/// let found = photometric(image.clone(), target, 0.2)?;
/// assert_eq!(found.mse.into_data().try_into_vec::<f32>()?, [0.0625]);
/// let gradients = found.loss.backward();
/// // Each brighter pixel would bring the image nearer to the target.
/// let v_image = image.grad(&gradients).expect("tracked");
/// assert!(v_image.max().into_scalar::<f32>() < 0.0);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn photometric(
    image: Tensor<3>,
    target: Tensor<3>,
    dssim: f32,
) -> Result<Photometric, KernelError> {
    let (found, of_image) = (target.dims(), image.dims());
    let [height, width, channels] = of_image;
    if found[..2] != of_image[..2] || found[2] > channels || found.contains(&0) {
        return Err(KernelError::Shape {
            op: "photometric",
            tensor: "target",
            expected: format!("[{height}, {width}, 1 to {channels}] with no zero"),
            found: found.to_vec(),
        });
    }
    if !(0.0..=1.0).contains(&dssim) {
        return Err(KernelError::Config {
            op: "photometric",
            what: format!("`dssim` is {dssim}, expected it in [0, 1]"),
        });
    }
    let n_values = of_image.iter().product();
    let device = image.device();
    check_values("the image", n_values, "compare smaller ones", &device)?;
    let (loss, mse) = Dispatch::photometric(image.into_dispatch(), target.into_dispatch(), dssim);
    Ok(Photometric {
        loss: Tensor::from_dispatch(loss),
        mse: Tensor::from_dispatch(mse),
    })
}

/// Dispatch of [`photometric`] over the enabled backends.
#[backend_extension(Autodiff, Flex: cfg(feature = "flex"), NdArray: cfg(feature = "ndarray"), Cube: cfg(feature = "cube"))]
pub trait PhotometricLoss: Backend {
    /// Loss and mean squared error, `[1]` each; see [`photometric`]. Shapes and `dssim` have been checked.
    fn photometric(
        image: FloatTensor<Self>,
        target: FloatTensor<Self>,
        dssim: f32,
    ) -> (FloatTensor<Self>, FloatTensor<Self>);
}

/// The pullback of [`photometric`], which a backend has to implement for gradients.
pub trait PhotometricVjp: PhotometricLoss {
    /// Loss and mean squared error, `[1]` each, and the loss's gradient to the image, of the image's shape.
    fn photometric_and_gradient(
        image: FloatTensor<Self>,
        target: FloatTensor<Self>,
        dssim: f32,
    ) -> ([FloatTensor<Self>; 2], FloatTensor<Self>);
}

impl<B: HostBackend> PhotometricLoss for B {
    fn photometric(
        image: FloatTensor<B>,
        target: FloatTensor<B>,
        dssim: f32,
    ) -> (FloatTensor<B>, FloatTensor<B>) {
        let ([loss, mse], _) = B::photometric_and_gradient(image, target, dssim);
        (loss, mse)
    }
}

impl<B: HostBackend> PhotometricVjp for B {
    fn photometric_and_gradient(
        image: FloatTensor<B>,
        target: FloatTensor<B>,
        dssim: f32,
    ) -> ([FloatTensor<B>; 2], FloatTensor<B>) {
        let (of_image, shape) = (dims::<3>(&image), dims::<3>(&target));
        let (all, target) = (B::values(&image), B::values(&target));
        let (wide, channels) = (of_image[2], shape[2]);
        let (both, gradient) = if wide == channels {
            cpu::photometric(&all, &target, dssim, shape)
        } else {
            let looked_at = |pixel| <[f32]>::split_at(pixel, channels).0;
            let first: Vec<f32> = all
                .chunks_exact(wide)
                .flat_map(looked_at)
                .copied()
                .collect();
            let (both, v_first) = cpu::photometric(&first, &target, dssim, shape);
            let mut gradient = vec![0.0; all.len()];
            let pixels = gradient.chunks_exact_mut(wide);
            for (pixel, v) in pixels.zip(v_first.chunks_exact(channels)) {
                pixel[..channels].copy_from_slice(v);
            }
            (both, gradient)
        };
        let both = both.map(|value| B::tensor(vec![value], [1], &image));
        (both, B::tensor(gradient, of_image, &image))
    }
}
