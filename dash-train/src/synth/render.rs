//! Pictures of a scene, and what of them can be shared between the frames of a camera.

use super::scene::Scene;
use super::shape::Ray;
use super::tracer::Tracer;
use dash_kernels::Camera;
use glam::DVec3;

pub use super::tracer::SAMPLES_PER_SIDE;

/// A rendered view. All buffers are row-major, one entry per pixel.
#[derive(Debug, Clone, PartialEq)]
pub struct Rendered {
    /// Picture width.
    pub width: usize,
    /// Picture height.
    pub height: usize,
    /// sRGB, three bytes per pixel, samples averaged in linear light.
    pub rgb: Vec<u8>,
    /// Whether a moving object is the nearest surface in at least half of the pixel's samples.
    pub moving: Vec<bool>,
    /// Whether it is in any sample; elsewhere the colour does not depend on moving objects.
    pub touched: Vec<bool>,
    /// Depth (camera z, metres) of the pixel's centre; infinite where nothing is hit.
    pub depth: Vec<f32>,
}

/// Renders `scene` as `camera` sees it at `time` in [0, 1].
pub fn render(scene: &Scene, camera: &Camera, time: f64) -> Rendered {
    let mut view = Rendered::empty(camera);
    render_over(scene, camera, time, None, &mut view);
    view
}

/// What a camera sees of the objects that rest, shared by all of its frames.
pub(super) struct Rest {
    /// The view without the moving objects.
    pub(super) view: Rendered,
    /// Per pixel, a depth that no sample's surface is nearer than.
    pub(super) nearest: Vec<f32>,
    /// Per pixel, a depth that no sample's surface is further than.
    pub(super) farthest: Vec<f32>,
}

impl Rest {
    /// Renders the view without the moving objects.
    pub(super) fn new(scene: &Scene, camera: &Camera) -> Self {
        let mut rest = Self {
            view: Rendered::empty(camera),
            nearest: vec![f32::INFINITY; camera.width * camera.height],
            farthest: vec![f32::INFINITY; camera.width * camera.height],
        };
        let instant = scene.at(0.0);
        Tracer::new(&instant, camera, |moving| !moving).render_rest(&mut rest);
        rest
    }
}

/// As [`render`] into `view`, whose content does not matter, but keeps the pixels of `rest` (of the
/// same scene and camera) wherever no sample sees a moving object.
pub(super) fn render_over(
    scene: &Scene,
    camera: &Camera,
    time: f64,
    rest: Option<&Rest>,
    view: &mut Rendered,
) {
    let instant = scene.at(time);
    Tracer::new(&instant, camera, |_| true).render(rest, view);
}

/// The ray through a picture point; a hit's distance is its depth.
pub(super) fn pixel_ray(camera: &Camera, u: f64, v: f64) -> Ray {
    let rows = camera.rotation.map(DVec3::from);
    let direction =
        rows[0] * ((u - camera.cx) / camera.fx) + rows[1] * ((v - camera.cy) / camera.fy) + rows[2];
    Ray {
        origin: camera.position().into(),
        direction,
    }
}

impl Rendered {
    /// A picture of the camera's size in which nothing is seen.
    pub(super) fn empty(camera: &Camera) -> Self {
        let pixels = camera.width * camera.height;
        Self {
            width: camera.width,
            height: camera.height,
            rgb: vec![0; 3 * pixels],
            moving: vec![false; pixels],
            touched: vec![false; pixels],
            depth: vec![f32::INFINITY; pixels],
        }
    }

    /// Becomes a copy of a view of the same size.
    pub(super) fn copy_from(&mut self, other: &Self) {
        self.rgb.copy_from_slice(&other.rgb);
        self.moving.copy_from_slice(&other.moving);
        self.touched.copy_from_slice(&other.touched);
        self.depth.copy_from_slice(&other.depth);
    }

    /// Share of the pixels that are moving.
    pub fn moving_share(&self) -> f64 {
        let moving = self.moving.iter().filter(|m| **m).count();
        moving as f64 / self.moving.len().max(1) as f64
    }
}
