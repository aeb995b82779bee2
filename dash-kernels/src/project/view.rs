//! The camera in the precision of the computation.

use num_traits::Float;

use crate::Camera;
use crate::splats::{ALPHA_MIN, LOW_PASS_PX2};

use super::{Activation, ProjectOptions};

/// How far beyond the image's border the projection's Jacobian still follows the Gaussian, as a
/// part of the half field of view's tangent: 1.3 tan(fov / 2) in 3DGS when the principal point is
/// central; gsplat's form for any other.
const BORDER: f64 = 0.3;

/// Camera and options, converted once.
#[derive(Debug, Clone, Copy)]
pub struct View<T> {
    /// Rotation of `camera_from_world`.
    pub rotation: [[T; 3]; 3],
    /// Translation of `camera_from_world`.
    pub translation: [T; 3],
    /// The camera's centre in the world.
    pub position: [T; 3],
    /// Focal lengths in pixels.
    pub focal: [T; 2],
    /// Principal point in pixels.
    pub principal: [T; 2],
    /// Image size in pixels.
    pub size: [T; 2],
    /// Lowest x/z and y/z that the Jacobian follows.
    pub lowest: [T; 2],
    /// Highest x/z and y/z that the Jacobian follows.
    pub highest: [T; 2],
    /// Nearest depth that is drawn.
    pub near_plane: T,
    /// Variance added to both image axes.
    pub low_pass: T,
    /// Smallest alpha that is drawn.
    pub alpha_min: T,
    /// What scales and opacities pass through.
    pub activation: Activation,
    /// SH degree that is evaluated.
    pub sh_degree: usize,
}

impl<T: Float> View<T> {
    /// The view of `camera` for colours of `sh_degree`.
    pub fn new(camera: &Camera, options: &ProjectOptions, sh_degree: usize) -> Self {
        let c = |value: f64| T::from(value).expect("every float type converts from f64");
        let focal = [camera.fx, camera.fy];
        let principal = [camera.cx, camera.cy];
        let size = [camera.width as f64, camera.height as f64];
        let border: [f64; 2] = std::array::from_fn(|i| BORDER * 0.5 * size[i] / focal[i]);
        Self {
            rotation: camera.rotation.map(|row| row.map(c)),
            translation: camera.translation.map(c),
            position: camera.position().map(c),
            focal: focal.map(c),
            principal: principal.map(c),
            size: size.map(c),
            lowest: std::array::from_fn(|i| c(-principal[i] / focal[i] - border[i])),
            highest: std::array::from_fn(|i| c((size[i] - principal[i]) / focal[i] + border[i])),
            near_plane: c(options.near_plane),
            low_pass: c(LOW_PASS_PX2),
            alpha_min: c(ALPHA_MIN),
            activation: options.activation,
            sh_degree,
        }
    }
}
