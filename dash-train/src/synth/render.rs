//! Renders pictures of a scene.

use super::rendered::{Rendered, Rest};
use super::scene::Scene;
use super::shape::Ray;
use super::tracer::Tracer;
use dash_kernels::Camera;
use glam::DVec3;

/// Renders `scene` as `camera` sees it at `time` in [0, 1].
pub fn render(scene: &Scene, camera: &Camera, time: f64) -> Rendered {
    let mut view = Rendered::empty(camera);
    render_over(scene, camera, time, None, &mut view);
    view
}

impl Rest {
    /// Renders the view without what moves or changes its colour, in the light of `time`.
    pub(super) fn new(scene: &Scene, camera: &Camera, time: f64) -> Self {
        let mut rest = Self {
            view: Rendered::empty(camera),
            nearest: vec![f32::INFINITY; camera.width * camera.height],
            farthest: vec![f32::INFINITY; camera.width * camera.height],
        };
        let instant = scene.at(time);
        Tracer::new(&instant, camera, |changes| !changes).render_rest(&mut rest);
        rest
    }
}

/// As [`render`] into `view`, whose content does not matter, but keeps the pixels of `rest` (of the
/// same scene, camera and light) wherever no sample sees an object that moves or changes.
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
