//! The camera in the precision of the computation.

use num_traits::Float;

use crate::Camera;
use crate::splats::{ALPHA_MIN, LOW_PASS_PX2};

use super::{Activation, ProjectOptions};

/// How far beyond the image's border the projection's Jacobian still follows the Gaussian, as a
/// part of the half field of view's tangent: 1.3 tan(fov / 2) in 3DGS when the principal point is
/// central; gsplat's form for any other.
const BORDER: f64 = 0.3;

/// Cameras further than this from the world's origin see Gaussians relative to their own centre, in world units: the
/// product of rotation and mean loses digits that the difference of two near points keeps.
const FAR_FROM_ORIGIN: f64 = 64.0;

/// Camera and options, converted once.
#[derive(Debug, Clone, Copy)]
pub struct View<T> {
    /// The point that means are taken relative to, before anything else: the world's origin, or the camera's centre,
    /// rounded to single precision, where it is far from there.
    pub origin: [T; 3],
    /// Rotation of `camera_from_world`.
    pub rotation: [[T; 3]; 3],
    /// Translation of `camera_from_world`, from `origin`.
    pub translation: [T; 3],
    /// The camera's centre in the world, from `origin`.
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
    /// The camera in double precision, for needles.
    pub exact: ExactView,
}

/// What [`View`] rounds.
#[derive(Debug, Clone, Copy)]
pub struct ExactView {
    /// See [`View::rotation`].
    pub rotation: [[f64; 3]; 3],
    /// See [`View::translation`].
    pub translation: [f64; 3],
    /// See [`View::focal`].
    pub focal: [f64; 2],
    /// See [`View::principal`].
    pub principal: [f64; 2],
    /// See [`View::lowest`].
    pub lowest: [f64; 2],
    /// See [`View::highest`].
    pub highest: [f64; 2],
}

impl ExactView {
    fn new(camera: &Camera, origin: [f64; 3]) -> Self {
        let focal = [camera.fx, camera.fy];
        let principal = [camera.cx, camera.cy];
        let size = [camera.width as f64, camera.height as f64];
        let border: [f64; 2] = std::array::from_fn(|i| BORDER * 0.5 * size[i] / focal[i]);
        Self {
            rotation: camera.rotation,
            translation: camera.transform(origin),
            focal,
            principal,
            lowest: std::array::from_fn(|i| -principal[i] / focal[i] - border[i]),
            highest: std::array::from_fn(|i| (size[i] - principal[i]) / focal[i] + border[i]),
        }
    }
}

impl<T: Float> View<T> {
    /// The view of `camera` for colours of `sh_degree`.
    pub fn new(camera: &Camera, options: &ProjectOptions, sh_degree: usize) -> Self {
        let c = |value: f64| T::from(value).expect("every float type converts from f64");
        let position = camera.position();
        let is_far = position.iter().any(|x| x.abs() > FAR_FROM_ORIGIN);
        let origin = match is_far {
            true => position.map(|x| f64::from(x as f32)),
            false => [0.0; 3],
        };
        let exact = ExactView::new(camera, origin);
        Self {
            origin: origin.map(c),
            rotation: exact.rotation.map(|row| row.map(c)),
            translation: exact.translation.map(c),
            position: std::array::from_fn(|k| c(position[k] - origin[k])),
            focal: exact.focal.map(c),
            principal: exact.principal.map(c),
            size: [camera.width, camera.height].map(|side| c(side as f64)),
            lowest: exact.lowest.map(c),
            highest: exact.highest.map(c),
            near_plane: c(options.near_plane),
            low_pass: c(LOW_PASS_PX2),
            alpha_min: c(ALPHA_MIN),
            activation: options.activation,
            sh_degree,
            exact,
        }
    }
}
