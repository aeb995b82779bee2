//! A long clip in windows of time.
//!
//! One canonical scene and one field hold what a minute of people shows badly. So a long clip is trained in overlapping
//! windows, each a run of its own on some of its frames. [`Windows`] is `OUT/windows.toml`, beside the plan whose tasks the
//! runs are. [`WindowedClip`] draws them as one clip: where two windows overlap, the picture of one fades into that of the
//! other.

mod clip;
mod scores;
#[cfg(test)]
mod tests;

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

use burn::tensor::Device;
use serde::{Deserialize, Serialize};

pub use clip::WindowedClip;

use crate::Error;
use crate::dataset::{Dataset, FrameRange, LoadOptions, Partition, load};
use crate::evaluate::Perceptual;
use crate::files::{claim, read_owner};
use crate::results::{take_up, train_and_score};
use crate::train::{DataConfig, RunConfig, StepReport, TrainConfig, TrainOptions, check_dataset};

/// The file of a folder of windows.
const FILE: &str = "windows.toml";
/// Fewest frames of a window.
pub const MIN_LENGTH: usize = 4;

/// A long clip and its windows: `OUT/windows.toml`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Windows {
    /// The dataset's name.
    pub name: String,
    /// Frames of the clip.
    pub n_frames: usize,
    /// The windows, in the order of time.
    pub windows: Vec<Window>,
    /// The data of the whole clip.
    pub data: DataConfig,
    /// How every window is trained.
    pub train: TrainConfig,
}

/// A part of a clip.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Window {
    /// Its first frame, counted from 0.
    pub first: usize,
    /// Its last frame.
    pub last: usize,
    /// The time of its first frame, in [0, 1] over the clip.
    pub from: f32,
    /// That of its last frame.
    pub to: f32,
}

impl Window {
    /// Frames of it.
    pub fn n_frames(&self) -> usize {
        self.last + 1 - self.first
    }

    /// A time of the clip as one of the window, in [0, 1].
    pub fn local(&self, time: f32) -> f32 {
        ((time - self.from) / (self.to - self.from)).clamp(0.0, 1.0)
    }
}

/// What a window's run is made with.
pub struct RunOptions<'a> {
    /// Networks of LPIPS.
    pub perceptual: &'a Perceptual,
    /// Memory for the window's images, bytes; see [`LoadOptions::memory`].
    pub memory: Option<u64>,
    /// The device, and its name.
    pub device: (&'a Device, &'a str),
    /// Asked before and after every step whether to stop there, with a checkpoint.
    pub stop: &'a dyn Fn() -> bool,
}

/// Told how a window's run goes on.
pub trait Observer {
    /// It begins or goes on, of so many steps.
    fn begin(&mut self, window: usize, iterations: usize);
    /// A step of it is done.
    fn step(&mut self, report: &StepReport, seconds: f64);
}

impl Windows {
    /// Divides a clip into windows of `length` frames, or one less, of which neighbours share `overlap` or more.
    ///
    /// # Errors
    /// When the clip is no longer than a window, a window is shorter than [`MIN_LENGTH`] or no longer than two overlaps, or
    /// the dataset has no test views.
    pub fn new(
        dataset: &Dataset,
        data: DataConfig,
        train: TrainConfig,
        [length, overlap]: [usize; 2],
    ) -> Result<Self, Error> {
        check_dataset(dataset)?;
        if dataset.views_of(Partition::Test).next().is_none() {
            return Err(Error::run(
                &dataset.root,
                "expected test views to score each window, found none; hold cameras out with --test-cameras",
            ));
        }
        let refuse = |option, expected: String, found: usize| {
            let found = found.to_string();
            Err(Error::Setting {
                option,
                expected,
                found,
            })
        };
        let n = dataset.n_frames;
        if !(MIN_LENGTH..n).contains(&length) {
            let expected = format!(
                "{MIN_LENGTH} to {} frames of the clip's {n}",
                n.saturating_sub(1)
            );
            return refuse("--window", expected, length);
        }
        if overlap == 0 || 2 * overlap >= length {
            let expected = format!("1 to {} frames, less than half a window", (length - 1) / 2);
            return refuse("--overlap", expected, overlap);
        }
        let mut times = BTreeMap::new();
        for view in &dataset.views {
            times.entry(view.frame).or_insert(view.time);
        }
        let windows = divide(n, length, overlap)
            .into_iter()
            .map(|(first, last)| Window {
                first,
                last,
                from: times.get(&first).copied().unwrap_or_default(),
                to: times.get(&last).copied().unwrap_or(1.0),
            });
        Ok(Self {
            name: dataset.name.clone(),
            n_frames: n,
            windows: windows.collect(),
            data,
            train,
        })
    }

    /// Makes `out` the folder of these windows, or finds that it is.
    ///
    /// # Errors
    /// When it holds others, or other files.
    pub fn claim(&self, out: &Path) -> Result<(), Error> {
        claim(out, FILE, self, "clip")
    }

    /// Whether a folder holds windows.
    pub fn are_in(folder: &Path) -> bool {
        folder.join(FILE).is_file()
    }

    /// The windows of a folder.
    ///
    /// # Errors
    /// When its file can't be read, or names no window.
    pub fn read(out: &Path) -> Result<Self, Error> {
        let windows: Self = read_owner(out, FILE)?;
        let is_sound = |w: &Window| w.first < w.last && w.last < windows.n_frames && w.from < w.to;
        if windows.windows.is_empty() || !windows.windows.iter().all(is_sound) {
            return Err(Error::run(
                &out.join(FILE),
                "expected windows with a first and a last frame of the clip, found others; plan the clip again",
            ));
        }
        Ok(windows)
    }

    /// The name of a window's run.
    pub fn run_name(number: usize) -> String {
        format!("window-{number:03}")
    }

    /// Trains and scores a window, which nobody else works on, in its folder below `out`; from its newest checkpoint where
    /// that was interrupted. Only its own frames are loaded.
    ///
    /// # Errors
    /// When its frames can't be loaded, or training fails or is stopped.
    pub fn run_one(
        &self,
        number: usize,
        out: &Path,
        options: &RunOptions<'_>,
        observer: &mut dyn Observer,
    ) -> Result<(), Error> {
        let data = self.data_of(number, options.device.1);
        let load_options = LoadOptions {
            memory: options.memory,
            ..data.load_options()
        };
        let dataset = Arc::new(load(&data.dataset, &load_options)?);
        check_dataset(&dataset)?;
        let train = TrainConfig {
            iterations: self.train.steps_for(&dataset),
            ..self.train.clone()
        };
        observer.begin(number, train.iterations);
        let config = RunConfig::new(data, train);
        let run = take_up(&out.join(Self::run_name(number)), &config, "window")?;
        let train_options = TrainOptions {
            resume: true,
            curve: 0,
            on_step: &mut |report, secs| observer.step(report, secs),
            watch: None,
            stop: options.stop,
            clock: None,
            additions: Default::default(),
        };
        let device = options.device.0;
        let perceptual = options.perceptual;
        train_and_score(&run, &config, &dataset, device, perceptual, train_options)?;
        Ok(())
    }

    /// The data of a window's run.
    fn data_of(&self, number: usize, device: &str) -> DataConfig {
        let Window { first, last, .. } = self.windows[number];
        DataConfig {
            frames: Some(FrameRange::Places {
                first: first as u64,
                last: last as u64,
            }),
            device: device.into(),
            ..self.data.clone()
        }
    }

    /// The windows that show a time of the clip, and the share of each in the picture; the shares add up to 1.
    pub fn shares(&self, time: f32) -> Vec<(usize, f32)> {
        for k in 0..self.windows.len() - 1 {
            let [from, to] = self.fade(k);
            if time <= from {
                return vec![(k, 1.0)];
            }
            if time < to {
                let share = (time - from) / (to - from);
                return vec![(k, 1.0 - share), (k + 1, share)];
            }
        }
        vec![(self.windows.len() - 1, 1.0)]
    }

    /// From when to when a window fades into the next: in the middle of what both show, before the next fade begins.
    fn fade(&self, k: usize) -> [f32; 2] {
        let middle = |k: usize| 0.5 * (self.windows[k].to + self.windows[k + 1].from);
        let mut width = self.windows[k].to - self.windows[k + 1].from;
        if k > 0 {
            width = width.min(middle(k) - middle(k - 1));
        }
        if k + 2 < self.windows.len() {
            width = width.min(middle(k + 1) - middle(k));
        }
        let half = 0.5 * width.max(0.0);
        [middle(k) - half, middle(k) + half]
    }
}

/// First and last frames of windows that cover `n` frames, evenly apart.
fn divide(n: usize, length: usize, overlap: usize) -> Vec<(usize, usize)> {
    let gaps = (n - length).div_ceil(length - overlap);
    let first = |k: usize| (k * (n - length) + gaps / 2) / gaps;
    (0..=gaps)
        .map(|k| (first(k), first(k) + length - 1))
        .collect()
}
