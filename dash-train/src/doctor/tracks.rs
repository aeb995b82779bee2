//! One pass over the pictures: each camera's in the order of time, and what changes from one to the
//! next.

use std::collections::BTreeMap;

use rayon::prelude::*;

use super::contents::is_rig;
use super::span::Span;
use crate::Error;
use crate::dataset::{Dataset, View};
use crate::numbers::median;

/// Pixels that are decoded at most; of longer captures, every camera's first frames.
const MAX_PIXELS: usize = 2_000_000_000;
/// Frames of a camera that are decoded in any case.
const MIN_FRAMES: usize = 24;
/// Longer side of the small pictures that are compared.
const SMALL_SIDE: usize = 96;
/// Pixels that are compared exactly.
const EXACT_SAMPLES: usize = 4096;
/// Brightness above which a pixel tells about exposure, and below which about clipping.
const EXPOSED: [f32; 2] = [0.06, 0.94];
/// Share of the small picture that must be exposed for a change of brightness to mean something.
const MIN_EXPOSED: f64 = 0.05;
/// Logarithm of a factor that is next to none.
const NO_CHANGE: f64 = 0.01;
/// A common factor is known to this part of its logarithm (median deviation).
const SPREAD: f64 = 0.35;
/// Least change of a small picture's pixel that is motion, not noise.
pub(super) const MOVED: f32 = 0.04;
/// The change that is motion where pictures are noisy, in standard deviations of the noise.
const ABOVE_NOISE: f32 = 6.0;
/// The quarter of the changes by noise that are the smallest are below so many standard deviations.
const SMALLEST_QUARTER: f32 = 0.3186;
/// Most change that noise explains: above it, all of the picture moves.
const MOST_BY_NOISE: f32 = 0.25;

/// A picture in figures.
#[derive(Debug, Clone)]
pub(super) struct Look {
    /// Index of the time.
    pub(super) frame: usize,
    /// Mean brightness in [0, 1].
    pub(super) mean: f64,
    /// Brightest pixel of the small picture.
    pub(super) brightest: f32,
    /// Share of the pixels that count, where there is a mask.
    pub(super) counted: Option<f64>,
}

/// What changes between two successive pictures of a track.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Step {
    /// Mean absolute change of brightness.
    pub(super) energy: f64,
    /// Share of the picture that changes visibly.
    pub(super) moved: f64,
    /// Share of the pixels that have exactly the same colour.
    pub(super) same: f64,
    /// The factor by which most of the picture gets brighter; `None` where it is too dark to tell, and
    /// where parts change by different factors, as they do by motion.
    pub(super) gain: Option<f64>,
}

/// The pictures of one camera, or of one that is carried along, in the order of time.
#[derive(Debug, Clone)]
pub(super) struct Track {
    pub(super) name: String,
    pub(super) looks: Vec<Look>,
    /// One less than the looks.
    pub(super) steps: Vec<Step>,
    /// Share of the picture that changes over the clip.
    pub(super) span_moved: f64,
}

impl Track {
    /// The usual amount of change.
    pub(super) fn usual_energy(&self) -> f64 {
        median(self.steps.iter().map(|step| step.energy)).unwrap_or(0.0)
    }
}

/// What all pictures look like.
pub(super) struct Tracks {
    pub(super) tracks: Vec<Track>,
    /// Whether each track is a camera that stands still.
    pub(super) standing: bool,
    /// Whether the tracks' frames are those of the same times.
    pub(super) rig: bool,
    /// Frames per track that were not looked at.
    pub(super) left_out: usize,
    /// Pictures that could not be read.
    pub(super) broken: Vec<Error>,
}

/// Looks at every picture, or at the first of every camera if there are very many.
pub(super) fn look(dataset: &Dataset) -> Tracks {
    let mut by_camera: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
    for (index, view) in dataset.views.iter().enumerate() {
        by_camera.entry(view.camera_index).or_default().push(index);
    }
    let carried = dataset.n_frames > 1 && by_camera.values().all(|views| views.len() == 1);
    if carried {
        by_camera = BTreeMap::from([(0, (0..dataset.views.len()).collect())]);
    }
    let pixels: usize = dataset
        .views
        .iter()
        .map(|v| v.camera.width * v.camera.height)
        .sum();
    let longest = by_camera.values().map(Vec::len).max().unwrap_or(0);
    let share = (MAX_PIXELS as f64 / pixels.max(1) as f64).min(1.0);
    let kept = ((longest as f64 * share) as usize)
        .max(MIN_FRAMES)
        .min(longest);
    let background = dataset.background.unwrap_or([0.0; 3]);
    let followed: Vec<(Track, Vec<Error>)> = by_camera
        .into_par_iter()
        .map(|(_, mut views)| {
            views.sort_by(|&a, &b| {
                let time = |i: usize| dataset.views[i].time;
                time(a).total_cmp(&time(b)).then(a.cmp(&b))
            });
            views.truncate(kept);
            follow(dataset, &views, carried, background)
        })
        .collect();
    let (tracks, broken): (Vec<Track>, Vec<Vec<Error>>) = followed.into_iter().unzip();
    Tracks {
        tracks,
        standing: !carried,
        rig: is_rig(&dataset.views, dataset.n_frames),
        left_out: longest - kept,
        broken: broken.into_iter().flatten().collect(),
    }
}

fn follow(
    dataset: &Dataset,
    views: &[usize],
    carried: bool,
    background: [f32; 3],
) -> (Track, Vec<Error>) {
    let mut broken = Vec::new();
    let mut track = Track {
        name: String::new(),
        looks: Vec::new(),
        steps: Vec::new(),
        span_moved: 0.0,
    };
    let mut before: Option<Small> = None;
    let mut span = Span::new(views.len());
    let mut gain = 1.0;
    for &index in views {
        let view = &dataset.views[index];
        track.name = match carried {
            true => "the carried camera".into(),
            false => view.camera_name.clone(),
        };
        let (rgb, counted) = match view.rgb_and_counted(background) {
            Ok(picture) => picture,
            Err(error) => {
                broken.push(error);
                continue;
            }
        };
        let small = Small::of(view, &rgb);
        track.looks.push(Look {
            frame: view.frame,
            mean: small.luma.iter().map(|&v| f64::from(v)).sum::<f64>() / small.luma.len() as f64,
            brightest: small.luma.iter().copied().fold(0.0, f32::max),
            counted: counted.map(|counted| {
                counted.iter().map(|&c| f64::from(c)).sum::<f64>() / counted.len() as f64
            }),
        });
        if let Some(before) = &before {
            let step = before.step_to(&small);
            gain *= step.gain.unwrap_or(1.0);
            track.steps.push(step);
        }
        span.add(track.looks.len() - 1, &small, before.as_ref(), gain);
        before = Some(small);
    }
    track.span_moved = span.moved();
    (track, broken)
}

/// A picture made small, and some of its pixels as they are.
pub(super) struct Small {
    pub(super) luma: Vec<f32>,
    exact: Vec<[f32; 3]>,
}

impl Small {
    fn of(view: &View, rgb: &[f32]) -> Self {
        let (width, height) = (view.camera.width, view.camera.height);
        let block = width.max(height).div_ceil(SMALL_SIDE).max(1);
        let mut luma = Vec::with_capacity((width / block + 1) * (height / block + 1));
        for top in (0..height).step_by(block) {
            for left in (0..width).step_by(block) {
                let (mut sum, mut count) = (0.0, 0.0);
                for y in top..(top + block).min(height) {
                    let row =
                        &rgb[3 * (y * width + left)..3 * (y * width + (left + block).min(width))];
                    sum += row.iter().sum::<f32>() / 3.0;
                    count += (row.len() / 3) as f32;
                }
                luma.push(sum / count);
            }
        }
        let stride = (width * height).div_ceil(EXACT_SAMPLES).max(1);
        let exact = rgb
            .chunks_exact(3)
            .step_by(stride)
            .map(|p| [p[0], p[1], p[2]]);
        Self {
            luma,
            exact: exact.collect(),
        }
    }

    /// How much each pixel differs from an earlier picture's.
    pub(super) fn changes_from(&self, before: &Self) -> impl Iterator<Item = f32> {
        let pairs = before.luma.iter().zip(&self.luma);
        pairs.map(|(a, b)| (b - a).abs())
    }

    fn step_to(&self, next: &Self) -> Step {
        let n = self.luma.len().min(next.luma.len()).max(1) as f64;
        let changes = || next.changes_from(self);
        let least = noise_limit(changes().collect());
        let moved = changes().filter(|&change| change > least).count() as f64 / n;
        let same = self
            .exact
            .iter()
            .zip(&next.exact)
            .filter(|(a, b)| a == b)
            .count();
        let exposed = |v: f32| (EXPOSED[0]..EXPOSED[1]).contains(&v);
        let ratios: Vec<f64> = self
            .luma
            .iter()
            .zip(&next.luma)
            .filter(|(a, b)| exposed(**a) && exposed(**b))
            .map(|(a, b)| f64::from(b / a).ln())
            .collect();
        let enough = ratios.len() as f64 >= MIN_EXPOSED * n;
        Step {
            energy: changes().map(f64::from).sum::<f64>() / n,
            moved,
            same: same as f64 / self.exact.len().max(1) as f64,
            gain: enough.then(|| common(ratios)).flatten(),
        }
    }
}

/// The least change that is motion among `changes`. What moves is a part of the picture, or changes by very different
/// amounts; noise is everywhere and alike.
fn noise_limit(mut changes: Vec<f32>) -> f32 {
    let quarter = changes.len() / 4;
    if quarter == 0 {
        return MOVED;
    }
    let smallest = *changes.select_nth_unstable_by(quarter, f32::total_cmp).1;
    (ABOVE_NOISE * smallest / SMALLEST_QUARTER).clamp(MOVED, MOST_BY_NOISE)
}

/// The factor that is common to logarithms of ratios, if there is one.
fn common(ratios: Vec<f64>) -> Option<f64> {
    let middle = median(ratios.clone())?;
    let spread = median(ratios.into_iter().map(|r| (r - middle).abs()))?;
    (middle.abs() < NO_CHANGE || spread < SPREAD * middle.abs()).then(|| middle.exp())
}
