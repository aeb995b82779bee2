//! One camera at one time.

use std::fmt;
use std::time::Instant;

use dash_kernels::Camera;
use dash_model::{DynamicScene, Layer, Picture, Rendering};

use crate::{Drawn, Error, SceneOverTime};

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

/// Renders one layer of the scene from `camera` at `time` in [0, 1].
///
/// # Errors
/// When a kernel refuses its input.
///
/// ```
/// use burn::tensor::Device;
/// use dash_kernels::Camera;
/// use dash_model::{DynamicScene, GaussianRows, Gaussians, Layer, SceneSettings};
/// use dash_train::render::render;
///
/// let rows = GaussianRows::from_points(&[[0.0, 0.0, 2.0]], &[[1.0, 0.0, 0.0]], 0, 0.5);
/// let scene = DynamicScene {
///     static_set: Gaussians::from_rows(&rows, &Device::flex()),
///     dynamic: None,
///     settings: SceneSettings::default(),
/// };
/// let camera = Camera::new(32.0, 32.0, 8.0, 8.0, 16, 16);
/// let picture = render(&scene, &camera, 0.0, Layer::Full)?;
/// assert_eq!((picture.width, picture.height), (16, 16));
/// # Ok::<(), dash_train::Error>(())
/// ```
pub fn render(
    scene: &DynamicScene,
    camera: &Camera,
    time: f32,
    layer: Layer,
) -> Result<Picture, Error> {
    Ok(Picture::of(scene.render_layer(camera, time, layer)?)?)
}

/// [`render`] of whatever can be drawn at any time.
///
/// # Errors
/// When a file can't be read, or a kernel refuses its input.
pub fn render_over_time(
    scene: &dyn SceneOverTime,
    camera: &Camera,
    time: f32,
    layer: Layer,
) -> Result<Picture, Error> {
    render_mixed(&scene.drawn_at(time)?, camera, layer)
}

/// [`render`] of scenes whose pictures are mixed by their shares; there is one at least.
pub(super) fn render_mixed(
    drawn: &[Drawn<'_>],
    camera: &Camera,
    layer: Layer,
) -> Result<Picture, Error> {
    Ok(Picture::of(mixed(drawn, camera, layer)?)?)
}

fn mixed(drawn: &[Drawn<'_>], camera: &Camera, layer: Layer) -> Result<Rendering, Error> {
    let pictures = drawn.iter().map(|Drawn { scene, time, share }| {
        let picture = scene.render_layer(camera, *time, layer)?;
        Ok::<_, Error>((picture, *share))
    });
    Ok(Rendering::faded(pictures)?.expect("a scene is drawn"))
}

/// A picture of a scene over time, and the seconds until the device had finished; reading files and copying to the host
/// excluded.
pub(crate) fn render_timed(
    scene: &dyn SceneOverTime,
    camera: &Camera,
    time: f32,
    layer: Layer,
) -> Result<(Picture, f64), Error> {
    let drawn = scene.drawn_at(time)?;
    let start = Instant::now();
    let rendering = mixed(&drawn, camera, layer)?;
    let device = rendering.image.device();
    device
        .sync()
        .map_err(|e| Error::DeviceFault(e.to_string()))?;
    let secs = start.elapsed().as_secs_f64();
    Ok((Picture::of(rendering)?, secs))
}
