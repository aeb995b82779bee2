//! Points where the dataset brings too few: along the rays of pixels, at the depth where other views
//! show the same colour (a plane sweep, one ray at a time).

use dash_kernels::Camera;
use rand::Rng;
use rand::seq::SliceRandom;
use rand_pcg::Pcg64;
use rayon::prelude::*;

use super::points::InitialPoints;
use crate::Error;
use crate::cameras::{focus_point, in_one_place};
use crate::dataset::View;

/// Depths between which points are looked for, in units of the distance to where the cameras look.
const DEPTHS: [f64; 2] = [0.25, 8.0];
/// Depths that are tried on a ray, evenly in inverse depth.
const CANDIDATES: usize = 192;
/// Views that a ray is compared with.
const WITNESSES: usize = 12;
/// Witnesses that must have a point in sight.
const MIN_WITNESSES: usize = 2;
/// Longest side of the pictures that are compared: larger ones say no more about where points are,
/// and many of them are held at once.
const MAX_SIDE: usize = 512;
/// Mean colour difference from which on views don't agree.
const MAX_DIFFERENCE: f32 = 0.15;
/// Differences this close count as equal; the farthest depth is taken, where a point hides nothing.
const TIE: f32 = 0.01;
/// Rays that are drawn for each point that is wanted.
const DRAWS_PER_POINT: usize = 3;
/// Points of a cloud that are compared with the pictures.
const SAMPLES: usize = 2_000;
/// Mean difference between colours of a cloud below which they are all alike.
const MIN_CONTRAST: f32 = 0.02;
/// Difference between a cloud and the pictures, as a share of that of a cloud with its colours
/// interchanged, from which on it is a random one.
const MAX_CHANCE: f32 = 0.9;
/// Mean colour difference between times from which on a pixel changes.
const MIN_CHANGE: f32 = 0.03;
/// Pixels more transparent than this show nothing.
const MIN_ALPHA: f32 = 0.5;

/// A view with its colours smoothed, so that one pixel stands for its surroundings.
struct Picture {
    camera: Camera,
    colors: Vec<[f32; 3]>,
    alpha: Option<Vec<f32>>,
    witnesses: Vec<usize>,
}

impl Picture {
    /// The colour where a point would be; `None` out of sight.
    fn color_at(&self, point: [f64; 3]) -> Option<[f32; 3]> {
        let ([u, v], _) = self.camera.project_inside(point)?;
        Some(self.colors[v as usize * self.camera.width + u as usize])
    }
}

/// Views to look for points in.
pub(crate) struct Sweep {
    pictures: Vec<Picture>,
    focus: glam::DVec3,
    /// Whether all of them are taken from one place, so that they agree at every depth.
    in_one_place: bool,
}

impl Sweep {
    /// Prepares views.
    pub(crate) fn new(views: &[&View], background: [f32; 3]) -> Result<Self, Error> {
        let cameras: Vec<Camera> = views.iter().map(|view| view.camera.clone()).collect();
        let pictures = views
            .par_iter()
            .enumerate()
            .map(|(index, view)| {
                let small = view.at_most(MAX_SIDE, background)?;
                Ok(Picture {
                    colors: smoothed(&small.rgb, &small.camera),
                    camera: small.camera,
                    alpha: small.alpha,
                    witnesses: witnesses(&cameras, index),
                })
            })
            .collect::<Result<_, Error>>()?;
        let focus = glam::DVec3::from(focus_point(&cameras));
        let positions: Vec<glam::DVec3> = cameras.iter().map(|c| c.position().into()).collect();
        Ok(Self {
            pictures,
            focus,
            in_one_place: in_one_place(&positions),
        })
    }

    /// At most `n` points, and their colours, that several of the views agree on.
    pub(crate) fn points(&self, n: usize, rng: &mut Pcg64) -> InitialPoints {
        let rays: Vec<(usize, usize, usize)> = (0..DRAWS_PER_POINT * n)
            .map(|draw| {
                let picture = draw % self.pictures.len();
                let camera = &self.pictures[picture].camera;
                let x = rng.random_range(0..camera.width);
                (picture, x, rng.random_range(0..camera.height))
            })
            .collect();
        self.points_on(&rays, n)
    }

    /// At most `n` of them where views differ from those of the same cameras at other times: `others` has
    /// them, each beside the index of the view that it is compared with.
    pub(crate) fn changing_points(
        &self,
        n: usize,
        others: &[(usize, &View)],
        background: [f32; 3],
        rng: &mut Pcg64,
    ) -> Result<InitialPoints, Error> {
        let changes: Vec<Vec<(usize, usize, usize)>> = others
            .par_iter()
            .map(|&(index, other)| {
                let (picture, other) =
                    (&self.pictures[index], other.at_most(MAX_SIDE, background)?);
                let width = picture.camera.width;
                let others = smoothed(&other.rgb, &other.camera);
                let pairs = picture.colors.iter().zip(&others);
                let changed = pairs
                    .enumerate()
                    .filter(|(_, (a, b))| difference(**a, **b) > MIN_CHANGE);
                Ok(changed
                    .map(|(k, _)| (index, k % width, k / width))
                    .collect())
            })
            .collect::<Result<_, Error>>()?;
        let mut rays = changes.concat();
        rays.sort_unstable();
        rays.dedup();
        rays.shuffle(rng);
        rays.truncate(DRAWS_PER_POINT * n);
        Ok(self.points_on(&rays, n))
    }

    /// At most `n` points on rays, each of a view and a pixel's x and y.
    fn points_on(&self, rays: &[(usize, usize, usize)], n: usize) -> InitialPoints {
        let found: Vec<([f32; 3], [f32; 3])> = rays
            .par_iter()
            .filter_map(|&(index, x, y)| {
                let picture = &self.pictures[index];
                let pixel = y * picture.camera.width + x;
                let (difference, point) = self.best(index, x, y)?;
                let shows = picture.alpha.as_ref().is_none_or(|a| a[pixel] >= MIN_ALPHA);
                let agrees = shows && difference < MAX_DIFFERENCE;
                agrees.then(|| (point.as_vec3().to_array(), picture.colors[pixel]))
            })
            .collect();
        let (positions, colors) = found.into_iter().take(n).unzip();
        InitialPoints {
            positions,
            colors,
            given: 0,
        }
    }

    /// Whether all views are taken from one place: then the points have a depth that is made up.
    pub(crate) fn in_one_place(&self) -> bool {
        self.in_one_place
    }

    /// Whether any of the points is in a picture.
    pub(crate) fn has_in_sight(&self, points: &InitialPoints) -> bool {
        let mut all = points.positions.iter().map(|point| point.map(f64::from));
        all.any(|point| self.pictures.iter().any(|p| p.color_at(point).is_some()))
    }

    /// Whether the pictures show the colours of points where they are, better than the colours of
    /// other points there. A cloud drawn at random, as some datasets carry, does no better.
    pub(crate) fn shows(&self, points: &InitialPoints) -> bool {
        let n = points.positions.len();
        let (mut own, mut other, mut alike, mut count) = (0.0, 0.0, 0.0, 0);
        for row in (0..n).step_by(n.div_ceil(SAMPLES).max(1)) {
            let stranger = points.colors[(row + n / 2) % n];
            let point = points.positions[row].map(f64::from);
            let seen: Vec<[f32; 3]> = self
                .pictures
                .iter()
                .filter_map(|picture| picture.color_at(point))
                .collect();
            // Nearer half only: the others may have something in front.
            let nearest = |color: [f32; 3]| {
                let mut all: Vec<f32> = seen.iter().map(|&s| difference(s, color)).collect();
                all.sort_by(f32::total_cmp);
                all.truncate(seen.len().div_ceil(2));
                all.iter().sum::<f32>() / all.len().max(1) as f32
            };
            own += nearest(points.colors[row]);
            other += nearest(stranger);
            alike += difference(points.colors[row], stranger);
            count += 1;
        }
        // Points all of one colour say nothing by it.
        let is_plausible = alike <= MIN_CONTRAST * count as f32 || own < MAX_CHANCE * other;
        is_plausible && (n == 0 || self.has_in_sight(points))
    }

    /// How much views differ at the point of a pixel's ray on which they agree most, and that point;
    /// `None` when too few have any of the ray in sight.
    pub(crate) fn best(&self, index: usize, x: usize, y: usize) -> Option<(f32, glam::DVec3)> {
        let picture = &self.pictures[index];
        let camera = &picture.camera;
        let color = picture.colors[y * camera.width + x];
        let position = glam::DVec3::from(camera.position());
        let distance = self.focus.distance(position).max(1e-6);
        let local = glam::DVec3::new(
            (x as f64 + 0.5 - camera.cx) / camera.fx,
            (y as f64 + 0.5 - camera.cy) / camera.fy,
            1.0,
        );
        let rows = camera.rotation.map(glam::DVec3::from);
        let ray = rows[0] * local.x + rows[1] * local.y + rows[2] * local.z;
        let [near, far] = DEPTHS.map(|depth| 1.0 / depth);
        // From far to near, so that the first of equals is the farthest.
        let mut tried = Vec::with_capacity(CANDIDATES);
        let n_candidates = if self.in_one_place { 1 } else { CANDIDATES };
        for k in 0..n_candidates {
            let inverse = match self.in_one_place {
                true => 1.0,
                false => far + (near - far) * (k as f64 + 0.5) / CANDIDATES as f64,
            };
            let point = position + ray * (distance / inverse);
            let difference = disagreement(&self.pictures, picture, point.to_array(), color);
            tried.extend(difference.map(|difference| (difference, point)));
        }
        let least = tried.iter().map(|t| t.0).fold(f32::INFINITY, f32::min);
        tried.into_iter().find(|t| t.0 <= least + TIE)
    }
}

pub(crate) fn difference(a: [f32; 3], b: [f32; 3]) -> f32 {
    (0..3).map(|c| (a[c] - b[c]).abs()).sum::<f32>() / 3.0
}

/// Mean colour difference over the half of the witnesses that agree best: the others may have
/// something in front. `None` when too few have the point in sight.
fn disagreement(
    pictures: &[Picture],
    picture: &Picture,
    point: [f64; 3],
    color: [f32; 3],
) -> Option<f32> {
    let mut differences = [f32::INFINITY; WITNESSES];
    let mut seen = 0;
    for &witness in &picture.witnesses {
        if let Some(other) = pictures[witness].color_at(point) {
            differences[seen] = difference(other, color);
            seen += 1;
        }
    }
    if seen < MIN_WITNESSES.min(picture.witnesses.len()).max(1) {
        return None;
    }
    differences[..seen].sort_by(f32::total_cmp);
    let half = seen.div_ceil(2);
    Some(differences[..half].iter().sum::<f32>() / half as f32)
}

/// Evenly chosen views among the nearer half of the others, which see a ray from similar directions.
fn witnesses(cameras: &[Camera], index: usize) -> Vec<usize> {
    let place = |camera: &Camera| glam::DVec3::from(camera.position());
    let here = place(&cameras[index]);
    let mut others: Vec<usize> = (0..cameras.len()).filter(|&other| other != index).collect();
    others.sort_by(|&a, &b| {
        let distance = |other: usize| place(&cameras[other]).distance_squared(here);
        distance(a).total_cmp(&distance(b)).then(a.cmp(&b))
    });
    others.truncate(others.len().div_ceil(2).max(WITNESSES));
    let kept = others.len().min(WITNESSES);
    (0..kept).map(|k| others[k * others.len() / kept]).collect()
}

/// Colours averaged over 3 x 3 pixels.
pub(crate) fn smoothed(rgb: &[f32], camera: &Camera) -> Vec<[f32; 3]> {
    let (width, height) = (camera.width, camera.height);
    let around = |at: usize, end: usize| at.saturating_sub(1)..(at + 2).min(end);
    let mut colors = Vec::with_capacity(width * height);
    for y in 0..height {
        for x in 0..width {
            let (mut sum, mut count) = ([0.0f32; 3], 0.0);
            for row in around(y, height) {
                for column in around(x, width) {
                    let pixel = 3 * (row * width + column);
                    for (c, sum) in sum.iter_mut().enumerate() {
                        *sum += rgb[pixel + c];
                    }
                    count += 1.0;
                }
            }
            colors.push(sum.map(|s| s / count));
        }
    }
    colors
}

#[cfg(test)]
mod tests;
