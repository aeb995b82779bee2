//! One layer at one time in 8 bits.

use std::fmt;

use burn::tensor::{Device, Tensor};
use dash_kernels::Camera;
use dash_kernels::splats;
use dash_model::{DynamicScene, Layer, ModelError, Picture, Rendering, rgb8};

use crate::speed::{SpeedColors, render_speed};

/// The ellipsoid that is drawn of a Gaussian, standard deviations.
const ELLIPSOID: f32 = 1.0;
/// Opacity below which none is drawn: what hardly shows would hide the rest.
const FAINT: f32 = 0.1;
/// How much steeper than a Gaussian its edge is.
const EDGE: f32 = 8.0;

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

/// One layer of the scene from `camera` at `time` in [0, 1].
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
    let rendering = match layer {
        ViewLayer::Full | ViewLayer::Depth | ViewLayer::Alpha => scene.render(camera, time)?,
        ViewLayer::Static => scene.render_layer(camera, time, Layer::Static)?,
        ViewLayer::Dynamic => scene.render_layer(camera, time, Layer::Dynamic)?,
        ViewLayer::Speed => render_speed(scene, camera, time, colors)?,
        ViewLayer::Ellipsoids => render_ellipsoids(scene, camera, time)?,
    };
    let picture = Picture::of(rendering)?;
    let gray = |plane: &[f32]| rgb8(plane).into_iter().flat_map(|v| [v; 3]).collect();
    Ok(Frame {
        width: picture.width,
        height: picture.height,
        rgb: match layer {
            ViewLayer::Depth => gray(&picture.nearness()),
            ViewLayer::Alpha => gray(&picture.alpha),
            _ => rgb8(&picture.rgb),
        },
    })
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

/// The scene's device.
pub(crate) fn device_of(scene: &DynamicScene) -> Device {
    scene.static_set.means.val().device()
}
