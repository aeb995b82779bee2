//! One camera at one time.

use std::fmt;
use std::time::Instant;

use burn::tensor::Tensor;
use dash_kernels::Camera;
use dash_model::{DynamicScene, Layer, Rendering};

use crate::Error;

/// Below this alpha a pixel shows no surface, and its depth is 0.
pub const NO_SURFACE_ALPHA: f32 = 1e-3;

/// What a picture shows.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, clap::ValueEnum)]
pub enum PictureLayer {
    /// The whole scene.
    Full,
    /// The Gaussians that never move.
    Static,
    /// The dynamic Gaussians.
    Dynamic,
    /// Distance along the camera's axis to the whole scene.
    Depth,
    /// Opacity of the whole scene.
    Alpha,
}

impl PictureLayer {
    /// The Gaussians that it is drawn from.
    pub(super) fn drawn_from(self) -> Layer {
        match self {
            Self::Full | Self::Depth | Self::Alpha => Layer::Full,
            Self::Static => Layer::Static,
            Self::Dynamic => Layer::Dynamic,
        }
    }
}

impl fmt::Display for PictureLayer {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Full => "full",
            Self::Static => "static",
            Self::Dynamic => "dynamic",
            Self::Depth => "depth",
            Self::Alpha => "alpha",
        })
    }
}

/// A rendered picture in host memory, rows first.
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

/// Renders one layer of the scene from `camera` at `time` in [0, 1].
///
/// # Errors
/// When a kernel refuses its input.
pub fn render(
    scene: &DynamicScene,
    camera: &Camera,
    time: f32,
    layer: Layer,
) -> Result<Picture, Error> {
    Ok(to_picture(scene.render_layer(camera, time, layer)?, camera))
}

/// [`render`], and the seconds until the device had finished; copying to the host excluded.
pub(crate) fn render_timed(
    scene: &DynamicScene,
    camera: &Camera,
    time: f32,
    layer: Layer,
) -> Result<(Picture, f64), Error> {
    let start = Instant::now();
    let rendering = scene.render_layer(camera, time, layer)?;
    let device = rendering.image.device();
    device
        .sync()
        .map_err(|e| Error::DeviceFault(e.to_string()))?;
    let secs = start.elapsed().as_secs_f64();
    Ok((to_picture(rendering, camera), secs))
}

fn to_picture(rendering: Rendering, camera: &Camera) -> Picture {
    let alpha = to_host(rendering.alpha());
    let weighted = to_host(rendering.depth());
    let depth = alpha
        .iter()
        .zip(weighted)
        .map(|(&alpha, depth)| {
            if alpha < NO_SURFACE_ALPHA {
                0.0
            } else {
                depth / alpha
            }
        })
        .collect();
    let rgb = to_host(rendering.rgb());
    Picture {
        width: camera.width,
        height: camera.height,
        rgb,
        alpha,
        depth,
    }
}

fn to_host(tensor: Tensor<3>) -> Vec<f32> {
    tensor
        .into_data()
        .try_into_vec::<f32>()
        .unwrap_or_else(|error| panic!("rendered tensors are f32: {error:?}"))
}
