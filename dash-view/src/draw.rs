//! One layer at one time in 8 bits.

use std::fmt;

use burn::tensor::Tensor;
use dash_kernels::Camera;
use dash_kernels::splats;
use dash_model::{DynamicScene, Layer, ModelError, NO_SURFACE_ALPHA, Rendering, to_host};

pub use crate::speed::SpeedColors;
use crate::speed::render_speed;

/// The ellipsoid that is drawn of a Gaussian, standard deviations.
const ELLIPSOID: f32 = 1.0;
/// Opacity below which none is drawn: what hardly shows would hide the rest.
const FAINT: f32 = 0.1;
/// How much steeper than a Gaussian its edge is.
const EDGE: f32 = 8.0;
/// Of red, green and blue in a packed pixel.
const PLACES: [f32; 3] = [1.0, 256.0, 65_536.0];

/// What a picture shows.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum ViewLayer {
    /// The whole scene.
    #[default]
    Full,
    /// The Gaussians that never move.
    Static,
    /// The dynamic Gaussians.
    Dynamic,
    /// Distance along the camera's axis: the nearest surface white, the farthest and none black.
    Depth,
    /// Opacity.
    Alpha,
    /// The dynamic Gaussians by their speed, the static ones in gray.
    Speed,
    /// Each Gaussian as an ellipsoid with an edge.
    Ellipsoids,
}

impl ViewLayer {
    /// All of them, in the order of their keys.
    pub const ALL: [Self; 7] = [
        Self::Full,
        Self::Static,
        Self::Dynamic,
        Self::Depth,
        Self::Alpha,
        Self::Speed,
        Self::Ellipsoids,
    ];

    /// What it shows, in one line.
    pub fn description(self) -> &'static str {
        match self {
            Self::Full => "the whole scene",
            Self::Static => "the Gaussians that never move",
            Self::Dynamic => "the dynamic Gaussians",
            Self::Depth => "depth: near is white, far is black",
            Self::Alpha => "opacity",
            Self::Speed => "speed of the dynamic Gaussians: violet is slow, yellow is fast",
            Self::Ellipsoids => "each Gaussian as an ellipsoid, one standard deviation",
        }
    }
}

impl fmt::Display for ViewLayer {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Full => "full",
            Self::Static => "static",
            Self::Dynamic => "dynamic",
            Self::Depth => "depth",
            Self::Alpha => "alpha",
            Self::Speed => "speed",
            Self::Ellipsoids => "ellipsoids",
        })
    }
}

/// A picture in 8 bits, rows first.
#[derive(Debug, Clone, PartialEq)]
pub struct Frame {
    /// Width in pixels.
    pub width: usize,
    /// Height in pixels.
    pub height: usize,
    /// `[H, W, 3]`, sRGB.
    pub rgb: Vec<u8>,
}

/// A picture that the device draws: what it shows is on its way.
pub struct Shown {
    width: usize,
    height: usize,
    /// `[H, W, 1]`: red, 256 times green and 65,536 times blue, in whole levels of 8 bits, which f32 holds.
    packed: Tensor<3>,
}

/// Draws one layer of the scene from `camera` at `time` in [0, 1]; does not wait for the device.
///
/// # Errors
/// When a kernel refuses its input.
pub fn show(
    scene: &DynamicScene,
    camera: &Camera,
    time: f32,
    layer: ViewLayer,
    colors: &SpeedColors,
) -> Result<Shown, ModelError> {
    let rendering = match layer {
        ViewLayer::Full | ViewLayer::Depth | ViewLayer::Alpha => scene.render(camera, time)?,
        ViewLayer::Static => scene.render_layer(camera, time, Layer::Static)?,
        ViewLayer::Dynamic => scene.render_layer(camera, time, Layer::Dynamic)?,
        ViewLayer::Speed => render_speed(scene, camera, time, colors)?,
        ViewLayer::Ellipsoids => render_ellipsoids(scene, camera, time)?,
    };
    let packed = match layer {
        ViewLayer::Depth => levels(nearness(&rendering)) * PLACES.iter().sum::<f32>(),
        ViewLayer::Alpha => levels(rendering.alpha()) * PLACES.iter().sum::<f32>(),
        _ => {
            let rgb = levels(rendering.rgb());
            let places = Tensor::<1>::from_floats(PLACES, &rgb.device());
            (rgb * places.reshape([1, 1, 3])).sum_dim(2)
        }
    };
    Ok(Shown {
        width: camera.width,
        height: camera.height,
        packed,
    })
}

/// Whole levels of 8 bits.
fn levels(values: Tensor<3>) -> Tensor<3> {
    (values.clamp(0.0, 1.0) * 255.0 + 0.5).floor()
}

/// `[H, W, 1]`: as [`Picture::nearness`](dash_model::Picture::nearness), on the device.
fn nearness(rendering: &Rendering) -> Tensor<3> {
    let alpha = rendering.alpha();
    let depth = rendering.depth() / alpha.clone().clamp_min(NO_SURFACE_ALPHA);
    let hidden = alpha.lower_scalar(NO_SURFACE_ALPHA);
    let near = depth.clone().mask_fill(hidden.clone(), f32::MAX).min();
    let far = depth.clone().mask_fill(hidden.clone(), 0.0).max();
    // A flat wall is all near.
    let range = (far - near.clone()).clamp_min(f32::MIN_POSITIVE);
    let from_near = (depth - near.reshape([1, 1, 1])) / range.reshape([1, 1, 1]);
    (-from_near + 1.0).mask_fill(hidden, 0.0)
}

impl Shown {
    /// The picture; waits for the device.
    ///
    /// # Errors
    /// [`ModelError::Device`] when the device failed.
    pub fn frame(self) -> Result<Frame, ModelError> {
        let packed = to_host(self.packed)?;
        let rgb = packed.iter().flat_map(|&pixel| {
            let [red, green, blue, _] = (pixel as u32).to_le_bytes();
            [red, green, blue]
        });
        Ok(Frame {
            width: self.width,
            height: self.height,
            rgb: rgb.collect(),
        })
    }

    /// The picture's pixels as RGBA, opaque, once they are there.
    ///
    /// # Errors
    /// [`ModelError::Device`] when the device failed.
    pub async fn rgba(self) -> Result<Vec<u8>, ModelError> {
        let data = self.packed.into_data_async().await;
        let data = data.map_err(|error| ModelError::Device(error.to_string()))?;
        let pixels = data.iter::<f32>();
        Ok(pixels
            .flat_map(|pixel| ((pixel as u32) | 0xff00_0000).to_le_bytes())
            .collect())
    }
}

/// One layer of the scene from `camera` at `time` in [0, 1]; waits for the device.
///
/// # Errors
/// When a kernel refuses its input, or the device fails.
pub fn draw(
    scene: &DynamicScene,
    camera: &Camera,
    time: f32,
    layer: ViewLayer,
    colors: &SpeedColors,
) -> Result<Frame, ModelError> {
    show(scene, camera, time, layer, colors)?.frame()
}

/// Splats whose edge is steep: the opacity is as much higher as the Gaussian is narrower, and drawing clamps it.
fn render_ellipsoids(
    scene: &DynamicScene,
    camera: &Camera,
    time: f32,
) -> Result<Rendering, ModelError> {
    let splats = scene.splats(camera, time, Layer::Full)?;
    let device = splats.device();
    let opacities = splats.clone().narrow(1, splats::OPACITY, 1);
    let shown = opacities.clone().greater_equal_scalar(FAINT).float();
    // Alpha is the largest where the exponent is that of the edge.
    let opacity = (0.5 * EDGE * ELLIPSOID * ELLIPSOID).exp();
    let own_extent = (opacities.clone() * 255.0)
        .clamp_min(1.0 + f32::EPSILON)
        .log();
    let extent = (255.0 * opacity).ln() / EDGE;
    let radii = (own_extent.recip() * extent).sqrt() * shown;
    let ones = |columns| Tensor::<2>::ones([splats.dims()[0], columns], &device);
    let conic = splats::CONIC_C + 1 - splats::CONIC_A;
    let factors = Tensor::cat(
        vec![
            ones(splats::CONIC_A),
            ones(conic) * EDGE,
            opacities.recip().clamp_max(255.0) * opacity,
            ones(splats::RADIUS_X - splats::RED),
            radii.clone(),
            radii,
            ones(splats::ALONG - splats::ACROSS_X),
            ones(1) * EDGE,
        ],
        1,
    );
    scene.rasterize(splats * factors, camera)
}
