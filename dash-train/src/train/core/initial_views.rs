//! The views that training starts from: what points they show, and whether a cloud is of them.

use std::sync::OnceLock;

use dash_kernels::Camera;
use glam::DVec3;
use rand::seq::index;
use rand_pcg::Pcg64;
use rayon::prelude::*;

use super::points::InitialPoints;
use super::stereo::{self, Picture};
use crate::Error;
use crate::cameras::{focus_point, in_one_place};
use crate::dataset::View;

/// Longest side of the pictures that are compared, pixels: larger ones cost more and confirm fewer points.
const MAX_SIDE: usize = 256;
/// Points of a cloud that are compared with the pictures.
const SAMPLES: usize = 2_000;
/// Mean difference between colours of a cloud below which they are all alike.
const MIN_CONTRAST: f32 = 0.02;
/// Difference between a cloud and the pictures, as a share of that of a cloud with its colours
/// interchanged, from which on it is a random one.
const MAX_CHANCE: f32 = 0.9;
/// Standard errors by which the pictures must show the own colours of points better than interchanged ones, where the poses are of the
/// same model: then a cloud is theirs even if most of it is hidden in most pictures.
const CLEARLY: f32 = 5.0;
/// Mean colour difference between times from which on a pixel changes.
const MIN_CHANGE: f32 = 0.03;
/// Pixels more transparent than this show nothing.
const MIN_ALPHA: f32 = 0.5;

/// Views to look for points in.
pub(crate) struct InitialViews {
    pictures: Vec<Picture>,
    /// Their colours smoothed, so that one pixel stands for its surroundings.
    smoothed: Vec<Vec<[f32; 3]>>,
    alpha: Vec<Option<Vec<f32>>>,
    focus: DVec3,
    /// Whether all of them are taken from one place, so that they agree at every depth.
    in_one_place: bool,
    /// For each picture the point of each pixel that is known.
    depth: OnceLock<Vec<Vec<Option<[f32; 3]>>>>,
}

impl InitialViews {
    /// Prepares views.
    pub(crate) fn new(views: &[&View], background: [f32; 3]) -> Result<Self, Error> {
        let cameras: Vec<Camera> = views.iter().map(|view| view.camera.clone()).collect();
        let small = views
            .par_iter()
            .map(|view| view.at_most(MAX_SIDE, background))
            .collect::<Result<Vec<_>, Error>>()?;
        let positions: Vec<DVec3> = cameras.iter().map(|c| c.position().into()).collect();
        Ok(Self {
            smoothed: small.iter().map(|s| smoothed(&s.rgb, &s.camera)).collect(),
            pictures: small
                .iter()
                .map(|s| {
                    let alpha = s.alpha.iter().flatten();
                    let is_cut_out = alpha.into_iter().any(|&alpha| alpha < MIN_ALPHA);
                    Picture::new(s.camera.clone(), &s.rgb, is_cut_out)
                })
                .collect(),
            alpha: small.into_iter().map(|s| s.alpha).collect(),
            focus: focus_point(&cameras).into(),
            in_one_place: in_one_place(&positions),
            depth: OnceLock::new(),
        })
    }

    /// At most `n` points that views agree on, and their colours.
    pub(crate) fn points(&self, n: usize, rng: &mut Pcg64) -> InitialPoints {
        let pixels = self.smoothed.iter().enumerate();
        let pixels = pixels.flat_map(|(view, colors)| (0..colors.len()).map(move |k| (view, k)));
        self.points_of(pixels, n, rng)
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
        let changes: Vec<Vec<(usize, usize)>> = others
            .par_iter()
            .map(|&(view, other)| {
                let other = other.at_most(MAX_SIDE, background)?;
                let others = smoothed(&other.rgb, &other.camera);
                let pairs = self.smoothed[view].iter().zip(&others).enumerate();
                let changed = pairs.filter(|(_, (a, b))| difference(**a, **b) > MIN_CHANGE);
                Ok(changed.map(|(pixel, _)| (view, pixel)).collect())
            })
            .collect::<Result<_, Error>>()?;
        let mut pixels = changes.concat();
        if pixels.is_empty() {
            return Ok(InitialPoints::default());
        }
        pixels.sort_unstable();
        pixels.dedup();
        Ok(self.points_of(pixels.into_iter(), n, rng))
    }

    /// At most `n` points of pixels, each the index of a view and of a pixel in it.
    fn points_of(
        &self,
        pixels: impl Iterator<Item = (usize, usize)>,
        n: usize,
        rng: &mut Pcg64,
    ) -> InitialPoints {
        let depth = self.depth();
        let known: Vec<([f32; 3], [f32; 3])> = pixels
            .filter(|&(view, pixel)| {
                let alpha = self.alpha[view].as_ref();
                alpha.is_none_or(|alpha| alpha[pixel] >= MIN_ALPHA)
            })
            .filter_map(|(view, pixel)| Some((depth[view][pixel]?, self.smoothed[view][pixel])))
            .collect();
        let chosen = index::sample(rng, known.len(), n.min(known.len()));
        let (positions, colors) = chosen.iter().map(|k| known[k]).unzip();
        InitialPoints {
            positions,
            colors,
            given: 0,
        }
    }

    fn depth(&self) -> &[Vec<Option<[f32; 3]>>] {
        self.depth.get_or_init(|| match self.in_one_place {
            true => stereo::points_at_distance(&self.pictures, self.focus),
            false => stereo::points(&self.pictures, self.focus),
        })
    }

    /// The smoothed colour in a picture where a point would be; `None` out of sight.
    fn color_at(&self, picture: usize, point: [f64; 3]) -> Option<[f32; 3]> {
        let camera = self.pictures[picture].camera();
        let ([u, v], _) = camera.project_inside(point)?;
        Some(self.smoothed[picture][v as usize * camera.width + u as usize])
    }

    /// Whether all views are taken from one place: then the points have a depth that is made up.
    pub(crate) fn in_one_place(&self) -> bool {
        self.in_one_place
    }

    /// Whether any of the points is in a picture.
    pub(crate) fn has_in_sight(&self, points: &InitialPoints) -> bool {
        let mut all = points.positions.iter().map(|point| point.map(f64::from));
        all.any(|point| (0..self.pictures.len()).any(|p| self.color_at(p, point).is_some()))
    }

    /// Whether the pictures show the colours of points where they are, better than the colours of
    /// other points there. A cloud drawn at random, as some datasets carry, does no better. `of_poses`: whether the poses
    /// are said to be of the same model.
    pub(crate) fn shows(&self, points: &InitialPoints, of_poses: bool) -> bool {
        let n = points.positions.len();
        let (mut own, mut other, mut alike, mut count) = (0.0, 0.0, 0.0, 0);
        let mut squares = 0.0;
        for row in (0..n).step_by(n.div_ceil(SAMPLES).max(1)) {
            let stranger = points.colors[(row + n / 2) % n];
            let point = points.positions[row].map(f64::from);
            let seen: Vec<[f32; 3]> = (0..self.pictures.len())
                .filter_map(|picture| self.color_at(picture, point))
                .collect();
            // Nearer half only: the others may have something in front.
            let nearest = |color: [f32; 3]| {
                let mut all: Vec<f32> = seen.iter().map(|&s| difference(s, color)).collect();
                all.sort_by(f32::total_cmp);
                all.truncate(seen.len().div_ceil(2));
                all.iter().sum::<f32>() / all.len().max(1) as f32
            };
            let (of_own, of_other) = (nearest(points.colors[row]), nearest(stranger));
            own += of_own;
            other += of_other;
            squares += (of_other - of_own).powi(2);
            alike += difference(points.colors[row], stranger);
            count += 1;
        }
        // Points all of one colour say nothing by it.
        let is_clear = other - own > CLEARLY * squares.sqrt();
        let is_plausible = alike <= MIN_CONTRAST * count as f32
            || own < MAX_CHANCE * other
            || of_poses && is_clear;
        is_plausible && (n == 0 || self.has_in_sight(points))
    }
}

/// Mean difference of the channels.
pub(crate) fn difference(a: [f32; 3], b: [f32; 3]) -> f32 {
    (0..3).map(|c| (a[c] - b[c]).abs()).sum::<f32>() / 3.0
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
