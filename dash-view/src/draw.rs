//! One layer at one time in 8 bits.

use std::fmt;

use burn::tensor::{Int, Tensor};
use dash_kernels::Camera;
use dash_kernels::rgba8::rgba8;
use dash_kernels::splats;
use dash_model::{DynamicScene, Layer, ModelError, NO_SURFACE_ALPHA, Rendering};

pub use crate::speed::SpeedColors;
use crate::speed::render_speed;

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
///
/// ```
/// use dash_view::draw::Frame;
///
/// let frame = Frame::from_rgb(1, 1, &[1, 2, 3]);
/// assert_eq!(frame.rgba, [1, 2, 3, 255]);
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct Frame {
    /// Width in pixels.
    pub width: usize,
    /// Height in pixels.
    pub height: usize,
    /// `[H, W, 4]`, sRGB, opaque.
    pub rgba: Vec<u8>,
}

impl Frame {
    /// Of colours `[H, W, 3]`.
    pub fn from_rgb(width: usize, height: usize, rgb: &[u8]) -> Self {
        let pixels = rgb.as_chunks::<3>().0.iter();
        Self {
            width,
            height,
            rgba: pixels.flat_map(|&[r, g, b]| [r, g, b, 255]).collect(),
        }
    }

    /// The colours alone, `[H, W, 3]`.
    pub fn rgb(&self) -> Vec<u8> {
        let pixels = self.rgba.as_chunks::<4>().0.iter();
        pixels.flat_map(|&[r, g, b, _]| [r, g, b]).collect()
    }
}

/// A picture that the device draws: what it shows is on its way.
pub struct Shown {
    /// `[H, W, C]`: colours first, or one gray.
    image: Tensor<3>,
}

/// A scene that has a share in a picture: one window of time of a clip.
#[derive(Debug, Clone)]
pub struct Faded {
    /// The scene.
    pub scene: DynamicScene,
    /// Its time, in [0, 1] over it.
    pub time: f32,
    /// How long it is, as a share of the clip.
    pub duration: f32,
    /// Its share; those of all parts add up to 1.
    pub share: f32,
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
    Ok(shown(render(scene, camera, time, layer, colors)?, layer))
}

/// The same of scenes that fade into each other; there is at least one.
///
/// # Errors
/// When a kernel refuses its input.
pub fn show_faded(
    parts: &[Faded],
    camera: &Camera,
    layer: ViewLayer,
    colors: &SpeedColors,
) -> Result<Shown, ModelError> {
    let pictures = parts.iter().map(|part| {
        let colors = colors.within(part.duration);
        let picture = render(&part.scene, camera, part.time, layer, &colors)?;
        Ok::<_, ModelError>((picture, part.share))
    });
    let picture = Rendering::faded(pictures)?;
    Ok(shown(picture.expect("a scene is drawn"), layer))
}

fn render(
    scene: &DynamicScene,
    camera: &Camera,
    time: f32,
    layer: ViewLayer,
    colors: &SpeedColors,
) -> Result<Rendering, ModelError> {
    match layer {
        ViewLayer::Full | ViewLayer::Depth | ViewLayer::Alpha => scene.render(camera, time),
        ViewLayer::Static => scene.render_layer(camera, time, Layer::Static),
        ViewLayer::Dynamic => scene.render_layer(camera, time, Layer::Dynamic),
        ViewLayer::Speed => render_speed(scene, camera, time, colors),
        ViewLayer::Ellipsoids => render_ellipsoids(scene, camera, time),
    }
}

/// What a layer shows of a rendering.
fn shown(rendering: Rendering, layer: ViewLayer) -> Shown {
    let image = match layer {
        ViewLayer::Depth => nearness(&rendering),
        ViewLayer::Alpha => rendering.alpha(),
        _ => rendering.image,
    };
    Shown { image }
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
    /// Width and height.
    pub fn size(&self) -> [usize; 2] {
        let [height, width, _] = self.image.dims();
        [width, height]
    }

    /// The pixels on the device, see [`rgba8`]; does not wait for it.
    ///
    /// # Errors
    /// When the pitch is less than the width.
    pub fn packed(&self, pitch: usize) -> Result<Tensor<2, Int>, ModelError> {
        Ok(rgba8(self.image.clone(), pitch)?)
    }

    /// The picture; waits for the device.
    ///
    /// # Errors
    /// [`ModelError::Device`] when the device failed.
    pub fn frame(&self) -> Result<Frame, ModelError> {
        let [width, height] = self.size();
        let data = self.packed(width)?.try_into_data();
        let data = data.map_err(|error| ModelError::Device(error.to_string()))?;
        Ok(Frame {
            width,
            height,
            rgba: data.as_bytes().to_vec(),
        })
    }

    /// The picture's pixels as RGBA, opaque, once they are there.
    ///
    /// # Errors
    /// [`ModelError::Device`] when the device failed.
    pub async fn rgba(self) -> Result<Vec<u8>, ModelError> {
        let [width, _] = self.size();
        let data = self.packed(width)?.into_data_async().await;
        let data = data.map_err(|error| ModelError::Device(error.to_string()))?;
        Ok(data.as_bytes().to_vec())
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

#[cfg(test)]
mod tests {
    use burn::tensor::Device;
    use dash_model::{GaussianRows, Gaussians, SceneSettings};

    use super::*;

    #[test]
    fn windows_fade_into_each_other_in_every_layer() {
        let camera = Camera::new(30.0, 30.0, 12.0, 9.0, 24, 18);
        let scene = |x: f32, color: [f32; 3]| {
            let rows = GaussianRows::from_points(&[[x, 0.0, 3.0]], &[color], 0, 0.4);
            DynamicScene {
                static_set: Gaussians::from_rows(&rows, &Device::flex()),
                dynamic: None,
                settings: SceneSettings::default(),
            }
        };
        let part = |scene: &DynamicScene, share: f32| Faded {
            scene: scene.clone(),
            time: 0.5,
            duration: 0.25,
            share,
        };
        let (left, right) = (scene(-0.5, [1.0, 0.0, 0.0]), scene(0.5, [0.0, 0.0, 1.0]));
        let colors = SpeedColors::new(1.0, 9);
        for layer in ViewLayer::ALL {
            let faded = |parts: &[Faded]| {
                let shown = show_faded(parts, &camera, layer, &colors).expect("sound");
                shown.frame().expect("drawn").rgba
            };
            let alone = |scene| {
                draw(scene, &camera, 0.5, layer, &colors)
                    .expect("drawn")
                    .rgba
            };
            assert_eq!(faded(&[part(&left, 1.0)]), alone(&left), "{layer}");
            let mixed = faded(&[part(&left, 0.25), part(&right, 0.75)]);
            if layer == ViewLayer::Depth {
                continue;
            }
            let both = alone(&left).into_iter().zip(alone(&right));
            let expected = both.map(|(a, b)| 0.25 * f32::from(a) + 0.75 * f32::from(b));
            for (found, expected) in mixed.into_iter().zip(expected) {
                assert!((f32::from(found) - expected).abs() <= 1.5, "{layer}");
            }
        }
    }
}
