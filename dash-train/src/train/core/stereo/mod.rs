//! Depth maps of the views that training starts from, by plane sweep and semi-global matching.
//!
//! For each view, planes of equal depth are swept through space, and the views beside it are compared on them ([`cost`]).
//! Neighbouring pixels then agree on their planes ([`semi_global`]; Hirschmüller 2008), which carries depth into surfaces
//! without texture. Depths that another view confirms become points ([`fusion`]).

mod cost;
mod fusion;
mod semi_global;

use dash_kernels::Camera;
use glam::{DMat3, DVec3};
use rayon::prelude::*;

/// Planes on which views are compared, evenly in inverse depth.
const PLANES: usize = 192;
/// Depths between which they lie, in units of the distance to where the cameras look.
const DEPTHS: [f64; 2] = [0.25, 8.0];
/// Views that a view is compared with.
const NEIGHBOURS: usize = 6;
/// The angle between the viewing rays of two views that is best for matching, degrees; how far smaller and larger ones
/// may be off. Source: MVSNet (Yao et al. 2018), whose smaller side is narrower.
const BEST_ANGLE: f64 = 10.0;
const ANGLE_SPREADS: [f64; 2] = [5.0, 20.0];

/// A view to match.
pub(crate) struct Picture {
    camera: Camera,
    /// Red, green, blue and luma of each pixel, row by row. Luma is from -0.5 to 0.5: squares of small numbers lose less.
    colors: Vec<[f32; 4]>,
    /// Whether the background is transparent, and so needs no depth.
    is_cut_out: bool,
}

impl Picture {
    /// Of RGB in [0, 1] `[H, W, 3]`. `is_cut_out`: whether the background is transparent.
    pub(crate) fn new(camera: Camera, rgb: &[f32], is_cut_out: bool) -> Self {
        let with_luma = |c: &[f32]| {
            let luma = 0.299 * c[0] + 0.587 * c[1] + 0.114 * c[2];
            [c[0], c[1], c[2], luma - 0.5]
        };
        Self {
            camera,
            colors: rgb.chunks_exact(3).map(with_luma).collect(),
            is_cut_out,
        }
    }

    /// Where it was taken.
    pub(crate) fn camera(&self) -> &Camera {
        &self.camera
    }
}

/// The planes of a view, in inverse depth.
#[derive(Debug, Clone, Copy)]
struct Planes {
    /// Inverse depth of the farthest.
    far: f64,
    /// From one to the next.
    step: f64,
}

impl Planes {
    fn of(camera: &Camera, focus: DVec3) -> Self {
        let distance = focus.distance(camera.position().into()).max(1e-6);
        let [near, far] = DEPTHS.map(|depth| 1.0 / (depth * distance));
        Self {
            far,
            step: (near - far) / (PLANES - 1) as f64,
        }
    }

    /// Inverse depth at a place between planes.
    fn inverse(self, plane: f64) -> f64 {
        self.far + plane * self.step
    }
}

/// The depth of each pixel of a view.
struct DepthMap {
    planes: Planes,
    /// Inverse depth of each pixel.
    inverse: Vec<f32>,
}

/// The points of each picture's pixels, world units, where another picture confirms them. The cameras look at `focus`.
pub(crate) fn points(pictures: &[Picture], focus: DVec3) -> Vec<Vec<Option<[f32; 3]>>> {
    let neighbours: Vec<Vec<usize>> = (0..pictures.len())
        .map(|index| neighbours(pictures, index, focus))
        .collect();
    let maps: Vec<DepthMap> = pictures
        .par_iter()
        .zip(&neighbours)
        .map(|(picture, neighbours)| {
            let planes = Planes::of(&picture.camera, focus);
            let others: Vec<&Picture> = neighbours.iter().map(|&other| &pictures[other]).collect();
            let volume = cost::volume(picture, &others, planes);
            let inverse = semi_global::planes(&volume, picture)
                .into_iter()
                .map(|plane| planes.inverse(f64::from(plane)) as f32)
                .collect();
            DepthMap { planes, inverse }
        })
        .collect();
    (0..pictures.len())
        .into_par_iter()
        .map(|index| fusion::confirmed(pictures, &maps, index, &neighbours[index]))
        .collect()
}

/// The points of each picture's pixels where all pictures are taken from one place: as far away as what the cameras look
/// at, a depth that is made up, where another picture shows the same.
pub(crate) fn points_at_distance(pictures: &[Picture], focus: DVec3) -> Vec<Vec<Option<[f32; 3]>>> {
    let of_picture = |index: usize| {
        let picture = &pictures[index];
        let distance = focus.distance(picture.camera.position().into()).max(1e-6);
        let shows = |other: &Picture, point: DVec3, color: &[f32; 4]| {
            let seen = other.camera.project_inside(point.to_array());
            seen.is_some_and(|([u, v], _)| {
                let seen = v as usize * other.camera.width + u as usize;
                fusion::alike([color, &other.colors[seen]])
            })
        };
        let points = picture.colors.iter().enumerate().map(|(pixel, color)| {
            let point = fusion::point(&picture.camera, pixel, 1.0 / distance as f32);
            let mut others = (0..pictures.len()).filter(|&other| other != index);
            let is_shown = others.any(|other| shows(&pictures[other], point, color));
            is_shown.then(|| point.as_vec3().to_array())
        });
        points.collect()
    };
    (0..pictures.len())
        .into_par_iter()
        .map(of_picture)
        .collect()
}

/// The views that are compared with one: those whose rays meet its own at the best angles.
fn neighbours(pictures: &[Picture], index: usize, focus: DVec3) -> Vec<usize> {
    let camera = &pictures[index].camera;
    let here = DVec3::from(camera.position());
    let ahead = DVec3::from(camera.rotation[2]);
    // What the camera looks at, as far away as what all look at.
    let target = here + ahead * focus.distance(here).max(1e-6);
    let mut scored: Vec<(f64, usize)> = (0..pictures.len())
        .filter(|&other| other != index)
        .filter_map(|other| {
            let camera = &pictures[other].camera;
            let there = DVec3::from(camera.position());
            let angle = (here - target).angle_between(there - target).to_degrees();
            let looks_along = ahead.dot(camera.rotation[2].into()) > 0.0;
            let spread = ANGLE_SPREADS[usize::from(angle > BEST_ANGLE)];
            let score = (-0.5 * ((angle - BEST_ANGLE) / spread).powi(2)).exp();
            (looks_along && here != there).then_some((score, other))
        })
        .collect();
    scored.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
    let best = scored.into_iter().take(NEIGHBOURS);
    best.map(|(_, other)| other).collect()
}

/// Of `[x, y, 1]` in pixels of a camera, times a matrix, plus inverse depth times a vector: homogeneous pixels of
/// another camera.
fn transfer(from: &Camera, to: &Camera) -> (DMat3, DVec3) {
    let intrinsics = |camera: &Camera| {
        DMat3::from_cols(
            DVec3::new(camera.fx, 0.0, 0.0),
            DVec3::new(0.0, camera.fy, 0.0),
            DVec3::new(camera.cx, camera.cy, 1.0),
        )
    };
    let relative = to.camera_from_world() * from.camera_from_world().inverse();
    let onto = intrinsics(to);
    (
        onto * relative.matrix3 * intrinsics(from).inverse(),
        onto * relative.translation,
    )
}

#[cfg(test)]
mod tests;
