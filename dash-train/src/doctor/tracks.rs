//! One pass over the pictures: each camera's in the order of time, and what changes from one to the
//! next.

use std::collections::BTreeMap;

use rayon::prelude::*;

use super::contents::is_rig;
use super::small::{Small, Step};
use super::span::Span;
use crate::Error;
use crate::dataset::Dataset;
use crate::numbers::median;

/// Pixels that are decoded at most; of longer captures, every camera's first frames.
const MAX_PIXELS: usize = 2_000_000_000;
/// Frames of a camera that are decoded in any case.
const MIN_FRAMES: usize = 24;
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
