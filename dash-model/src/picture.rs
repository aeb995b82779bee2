//! A rendered picture in host memory.

use burn::tensor::Tensor;

use crate::{ModelError, Rendering};

/// Below this alpha a pixel shows no surface, and its depth is 0.
pub const NO_SURFACE_ALPHA: f32 = 1e-3;

/// A rendered picture in host memory, rows first.
///
/// # Example
/// ```
/// use dash_model::{Picture, rgb8};
///
/// let picture = Picture {
///     width: 3,
///     height: 1,
///     rgb: vec![0.0, 0.5, 2.0].repeat(3),
///     alpha: vec![1.0, 1.0, 0.0],
///     depth: vec![2.0, 4.0, 0.0],
/// };
/// assert_eq!(rgb8(&picture.rgb)[..3], [0, 128, 255]);
/// // The nearest surface, the farthest, and none.
/// assert_eq!(picture.nearness(), [1.0, 0.0, 0.0]);
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct Picture {
    /// Width in pixels.
    pub width: usize,
    /// Height in pixels.
    pub height: usize,
    /// `[H, W, 3]`, sRGB over the scene's background, as rendered: not clamped.
    pub rgb: Vec<f32>,
    /// `[H, W]` in [0, 1].
    pub alpha: Vec<f32>,
    /// `[H, W]`, world units along the camera's axis: the mean over what the pixel shows; 0 where
    /// alpha is below [`NO_SURFACE_ALPHA`].
    pub depth: Vec<f32>,
}

impl Picture {
    /// Copies a rendering to the host; waits for the device.
    ///
    /// # Errors
    /// [`ModelError::Device`] when the device failed.
    pub fn of(rendering: Rendering) -> Result<Self, ModelError> {
        let [height, width, n_channels] = rendering.image.dims();
        let image = to_host(rendering.image)?;
        let n = height * width;
        let mut picture = Self {
            width,
            height,
            rgb: Vec::with_capacity(3 * n),
            alpha: Vec::with_capacity(n),
            depth: Vec::with_capacity(n),
        };
        for pixel in image.chunks_exact(n_channels) {
            let (alpha, weighted) = (pixel[3], pixel[4]);
            picture.rgb.extend_from_slice(&pixel[..3]);
            picture.alpha.push(alpha);
            picture.depth.push(match alpha < NO_SURFACE_ALPHA {
                true => 0.0,
                false => weighted / alpha,
            });
        }
        Ok(picture)
    }

    /// `[H, W]`: 1 for the nearest surface of the picture, 0 for the farthest and for none.
    pub fn nearness(&self) -> Vec<f32> {
        let surfaces = || {
            let depths = self.depth.iter().copied();
            depths.filter(|d| *d > 0.0 && d.is_finite())
        };
        let near = surfaces().fold(f32::INFINITY, f32::min);
        let far = surfaces().fold(0.0, f32::max);
        // A flat wall is all near.
        let range = if far > near { far - near } else { 1.0 };
        let nearness = |&d: &f32| match d > 0.0 {
            true => 1.0 - (d - near) / range,
            false => 0.0,
        };
        self.depth.iter().map(nearness).collect()
    }
}

/// 8-bit values of an image in [0, 1], rounded; what is below or above is clamped, NaN is 0.
pub fn rgb8(image: &[f32]) -> Vec<u8> {
    // A float-to-integer `as` saturates and takes NaN to 0.
    image.iter().map(|v| (v * 255.0).round() as u8).collect()
}

/// Values of a tensor of this crate in host memory; waits for the device.
///
/// # Errors
/// [`ModelError::Device`] when the device failed.
pub fn to_host<const D: usize>(tensor: Tensor<D>) -> Result<Vec<f32>, ModelError> {
    dash_kernels::counts::note_read();
    let data = tensor
        .try_into_data()
        .map_err(|error| ModelError::Device(error.to_string()))?;
    Ok(data
        .try_into_vec::<f32>()
        .unwrap_or_else(|error| panic!("tensors of a model are f32: {error:?}")))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rounding_and_clamping() {
        let values = [0.0, 1.0, 0.5, -3.0, 7.0, f32::NAN, 0.001, f32::INFINITY];
        assert_eq!(rgb8(&values), [0, 255, 128, 0, 255, 0, 0, 255]);
    }

    #[test]
    fn nearness_spans_the_surfaces() {
        let nearness = |depth: &[f32]| {
            let picture = Picture {
                width: depth.len(),
                height: 1,
                rgb: Vec::new(),
                alpha: Vec::new(),
                depth: depth.to_vec(),
            };
            picture.nearness()
        };
        assert_eq!(nearness(&[0.0, 2.0, 4.0, 3.0]), [0.0, 1.0, 0.0, 0.5]);
        assert_eq!(nearness(&[5.0, 5.0]), [1.0, 1.0]);
        assert_eq!(nearness(&[0.0; 2]), [0.0; 2]);
    }
}
