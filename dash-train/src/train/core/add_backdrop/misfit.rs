//! Where a room differs from the pictures of a run.

use burn::tensor::{Tensor, TensorData};
use dash_kernels::Camera;
use dash_kernels::splats::{GREEN, N_COLUMNS, RED};
use dash_model::DynamicScene;
use rayon::prelude::*;

use super::super::optimizer::to_host;
use super::super::run::Run;
use super::super::visibility::gradient_of;
use crate::Error;
use crate::dataset::View;
use crate::numbers::median;

/// Spans of the clip of each of which some views are looked at.
const SPANS: usize = 8;
/// Views of each span.
const VIEWS: usize = 12;
/// How many times the median difference of the room's Gaussians is too large for one to be kept: what is hard to show is no
/// other thing.
const MOST: f32 = 2.0;
/// The least and the largest value of that, as a mean over channels in [0, 1]: rooms that fit well or badly, such as where the
/// light is another.
const BOUNDS: (f32, f32) = (0.04, 0.08);
/// Least of a Gaussian that a view must show to judge it, in pixels.
const LEAST_SHOWN: f32 = 0.1;
/// Share of a span's views to which a Gaussian has to be right: a passing object hides it from the others.
const SHARE: f64 = 0.25;

/// What a view shows against the room.
struct Difference {
    camera: Camera,
    /// Mean difference of the channels, `[H * W]`.
    pixels: Vec<f32>,
}

impl Difference {
    /// Around where a point is seen, if it is.
    fn at(&self, point: [f32; 3]) -> Option<f32> {
        let ([u, v], _) = self.camera.project_inside(point.map(f64::from))?;
        let (width, height) = (self.camera.width, self.camera.height);
        let near =
            |at: f64, size: usize| (at as usize).saturating_sub(1)..(at as usize + 2).min(size);
        let rows = near(v, height);
        let columns = near(u, width);
        let n = rows.len() * columns.len();
        let of_row = |row: usize| {
            self.pixels[row * width..][columns.clone()]
                .iter()
                .sum::<f32>()
        };
        Some(rows.map(of_row).sum::<f32>() / n as f32)
    }
}

/// How a room differs from some of a run's training views, by span of the clip.
pub(super) struct Misfit {
    /// Of each Gaussian that the views show, its mean difference: in a span of the clip that of the views to which it fits well
    /// ([`SHARE`]), and of all spans the median, since a flickering Gaussian fits at some time, too.
    gaussians: Vec<Option<f32>>,
    /// The views of each span.
    spans: Vec<Vec<Difference>>,
    /// The difference from which on there is something else.
    threshold: f32,
}

impl Misfit {
    /// Draws the room for some views of all spans of the clip.
    pub(super) fn of<M>(room: &DynamicScene, run: &Run<M>) -> Result<Self, Error> {
        let n = room.static_set.len();
        let mut of_spans: Vec<Vec<&View>> = vec![Vec::new(); SPANS];
        for view in run.views() {
            of_spans[((view.time * SPANS as f32) as usize).min(SPANS - 1)].push(view);
        }
        let (mut gaussians, mut spans) = (vec![Vec::new(); n], Vec::new());
        for views in of_spans {
            let mut of_views = vec![Vec::new(); n];
            let count = views.len().min(VIEWS);
            let mut differences = Vec::new();
            for k in 0..count {
                let view = views[(2 * k + 1) * views.len() / (2 * count)];
                let (pixels, weights) = compare(room, view, run)?;
                for (means, row) in of_views.iter_mut().zip(weights.chunks_exact(N_COLUMNS)) {
                    if row[GREEN] >= LEAST_SHOWN {
                        means.push(row[RED] / row[GREEN]);
                    }
                }
                let camera = view.camera.clone();
                differences.push(Difference { camera, pixels });
            }
            for (means, of_views) in gaussians.iter_mut().zip(of_views) {
                means.extend(where_it_fits(of_views));
            }
            spans.push(differences);
        }
        let gaussians: Vec<Option<f32>> = gaussians.into_iter().map(median).collect();
        let typical = median(gaussians.iter().flatten().copied()).unwrap_or(0.0);
        Ok(Self {
            gaussians,
            spans,
            threshold: (MOST * typical).clamp(BOUNDS.0, BOUNDS.1),
        })
    }

    /// The difference from which on there is something else, as a mean over channels in [0, 1].
    pub(super) fn threshold(&self) -> f32 {
        self.threshold
    }

    /// The rows of Gaussians that show something else than the pictures have, in order.
    pub(super) fn of_gaussians(&self) -> Vec<usize> {
        let differs = |row: &usize| self.gaussians[*row].is_some_and(|mean| mean > self.threshold);
        (0..self.gaussians.len()).filter(differs).collect()
    }

    /// The points that lie where most views of some span of the clip differ from the room, in order: those that differ most
    /// where these are fewer than `least`.
    pub(super) fn of_points(&self, points: &[[f32; 3]], least: usize) -> Vec<usize> {
        let differences: Vec<f32> = points.par_iter().map(|&p| self.at(p)).collect();
        let mut order: Vec<usize> = (0..points.len()).collect();
        order.sort_by(|&a, &b| differences[b].total_cmp(&differences[a]).then(a.cmp(&b)));
        let n = order
            .iter()
            .take_while(|&&row| differences[row] > self.threshold)
            .count();
        order.truncate(n.max(least));
        order.sort_unstable();
        order
    }

    /// The median over the views that have a point in sight, in the span of the clip where it is largest.
    fn at(&self, point: [f32; 3]) -> f32 {
        let of_span = |views: &Vec<Difference>| {
            let seen = views.iter().filter_map(|view| view.at(point));
            median(seen).unwrap_or(0.0)
        };
        self.spans.iter().map(of_span).fold(0.0, f32::max)
    }
}

/// A Gaussian's difference to the views to which it fits well.
fn where_it_fits(mut of_views: Vec<f32>) -> Option<f32> {
    of_views.sort_by(f32::total_cmp);
    let place = (SHARE * of_views.len() as f64) as usize;
    of_views.get(place).copied()
}

/// Mean difference of the channels at each pixel of a view, 0 where pixels don't count; and per Gaussian, in the columns of
/// red and green, that difference and 1, both summed with the weights of blending.
fn compare<M>(
    room: &DynamicScene,
    view: &View,
    run: &Run<M>,
) -> Result<(Vec<f32>, Vec<f32>), Error> {
    let camera = &view.camera;
    let shape = [camera.height, camera.width, 1];
    let (truth, counted) = view.rgb_and_counted(run.scene.settings.background)?;
    let counted = counted.unwrap_or_else(|| vec![1.0; camera.width * camera.height]);
    let of_pixel = |((drawn, truth), counts): ((&[f32], &[f32]), &f32)| {
        let sum: f32 = drawn.iter().zip(truth).map(|(a, b)| (a - b).abs()).sum();
        counts * sum / 3.0
    };
    let on_device =
        |values: Vec<f32>| Tensor::<3>::from_data(TensorData::new(values, shape), &run.device);
    let mut pixels = Vec::new();
    let weights = gradient_of(room, room.static_splats(camera)?, camera, |image| {
        let drawn = to_host(image.clone().narrow(2, 0, 3).inner());
        let colors = drawn.chunks_exact(3).zip(truth.chunks_exact(3));
        pixels = colors.zip(&counted).map(of_pixel).collect();
        let channel = |k: usize| image.clone().narrow(2, k, 1);
        let differences = (channel(0) * on_device(pixels.clone())).sum();
        differences + (channel(1) * on_device(counted.clone())).sum()
    })?;
    Ok((pixels, weights))
}
