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
use std::num::NonZeroU64;
use std::path::Path;
use std::sync::Arc;

use burn::tensor::Device;
use dash_model::{DynamicScene, TimeWindows};
use serde::{Deserialize, Serialize};

pub use clip::WindowedClip;

use crate::Error;
use crate::dataset::{Dataset, FrameRange, LoadOptions, Partition, load};
use crate::evaluate::Perceptual;
use crate::files::{claim, read_owner, write_owner};
use crate::results::{take_up, train_and_score};
use crate::train::core::is_synchronized;
use crate::train::{
    Budget, DataConfig, OnTrial, RunConfig, StepReport, TYPICAL_POWER, TrainConfig, TrainOptions,
    check_dataset,
};

/// The file of a folder of windows.
const FILE: &str = "windows.toml";
/// Fewest frames of a window.
pub const MIN_LENGTH: usize = 4;
/// Frames of a window, if nothing else is said.
pub const LENGTH: usize = 60;
/// Frames above which a clip is long: the clips of benchmarks have no more.
const LONG: usize = 300;
/// Fewest steps that a window gets where nobody says how many. With fewer it shows little.
pub const MIN_STEPS: usize = 1_000;
/// Steps of the room for each of a window. What windows share is as good as it will be.
const ROOM_STEPS: usize = 3;
/// Windows from which on they share a room, if nothing else is said: its steps are then a third of theirs, or less.
const MIN_SHARING: usize = 9;

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
    /// What is trained first, and whose static Gaussians all windows share; `None`: each window trains its own.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub room: Option<Room>,
    /// The data of the whole clip.
    pub data: DataConfig,
    /// How every window is trained.
    pub train: TrainConfig,
}

/// The room of a clip: what is the same all the time.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Room {
    /// It is trained on each so many-th frame.
    pub every: NonZeroU64,
    /// Its steps.
    pub iterations: usize,
}

/// One of the runs of a clip.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ClipRun {
    /// What is the same all the time; the other runs need it.
    Room,
    /// A window, by its number.
    Window(usize),
}

impl ClipRun {
    /// The runs of so many windows, in the order in which they are trained.
    pub fn all(windows: usize, has_room: bool) -> impl Iterator<Item = Self> {
        let room = has_room.then_some(Self::Room);
        room.into_iter().chain((0..windows).map(Self::Window))
    }

    /// The name of its run.
    pub fn run_name(self) -> String {
        match self {
            Self::Room => "room".into(),
            Self::Window(number) => format!("window-{number:03}"),
        }
    }
}

/// A span of a clip.
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

/// Told how a run goes on.
pub trait Observer {
    /// It begins or goes on, of so many steps.
    fn begin(&mut self, run: ClipRun, iterations: usize);
    /// A step of it is done.
    fn step(&mut self, report: &StepReport, seconds: f64);
}

impl Windows {
    /// Whether a clip is trained in windows where nobody says so: a long one of a rig, with cameras held out.
    pub fn suit(dataset: &Dataset) -> bool {
        let has_test = dataset.views_of(Partition::Test).next().is_some();
        dataset.n_frames > LONG && has_test && is_synchronized(dataset)
    }

    /// Divides a clip into windows of `length` frames, or one less, of which neighbours share `overlap` or more. `room` is
    /// whether they share a room that is trained before them; `None`: if there are many. Where steps follow from the number of
    /// views, the windows share those of the whole clip, a thousand each at least.
    ///
    /// # Errors
    /// When the clip is no longer than a window, a window is shorter than [`MIN_LENGTH`] or no longer than two overlaps, or
    /// the dataset has no test views.
    pub fn new(
        dataset: &Dataset,
        data: DataConfig,
        train: TrainConfig,
        [length, overlap]: [usize; 2],
        room: Option<bool>,
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
        let (n, whole_steps) = (dataset.n_frames, train.steps_for(dataset));
        if !(MIN_LENGTH..n).contains(&length) {
            let expected = match n > MIN_LENGTH {
                true => format!("{MIN_LENGTH} to {} frames of the clip's {n}", n - 1),
                false => format!("a clip of more than {MIN_LENGTH} frames, or none (it has {n})"),
            };
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
        let windows: Vec<Window> = windows.collect();
        let mut train = train;
        if train.visits.take().is_some() {
            train.iterations = (whole_steps / windows.len()).max(MIN_STEPS);
        }
        let has_room = room.unwrap_or(windows.len() >= MIN_SHARING);
        // Of as many frames as a window has, so that it takes no more memory.
        let every = NonZeroU64::new(n.div_ceil(length) as u64).filter(|_| has_room);
        let iterations = ROOM_STEPS * train.iterations;
        Ok(Self {
            name: dataset.name.clone(),
            n_frames: n,
            room: every.map(|every| Room { every, iterations }),
            windows,
            data,
            train,
        })
    }

    /// Sets the steps of each window, and those of the room, which go with them.
    pub fn set_iterations(&mut self, iterations: usize) {
        self.train.iterations = iterations;
        if let Some(room) = &mut self.room {
            room.iterations = ROOM_STEPS * iterations;
        }
    }

    /// Makes `out` the folder of these windows, or finds that it is.
    ///
    /// # Errors
    /// When it holds others, or other files.
    pub fn claim(&self, out: &Path) -> Result<(), Error> {
        claim(out, FILE, self, "clip")
    }

    /// Writes them in the place of those that `out` is the folder of.
    ///
    /// # Errors
    /// When the file can't be written; what was there before stays.
    pub fn rewrite(&self, out: &Path) -> Result<(), Error> {
        write_owner(out, FILE, self)
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

    /// When each window begins and ends.
    pub fn times(&self) -> TimeWindows {
        let spans = self.windows.iter().map(|window| [window.from, window.to]);
        TimeWindows::new(spans.collect())
    }

    /// The runs, in the order of their tasks.
    pub fn runs(&self) -> impl Iterator<Item = ClipRun> {
        ClipRun::all(self.windows.len(), self.room.is_some())
    }

    /// Steps of each window with which all that is not trained yet is so about `secs` seconds from now, one after the other. Short
    /// trials on the window in the middle find it out; scores take their time besides that. `room` is the trained room: before
    /// there is one, steps of windows are taken for as long as without.
    ///
    /// # Errors
    /// When its frames can't be loaded, or training fails.
    pub fn steps_within(
        &self,
        secs: f64,
        room: Option<&DynamicScene>,
        memory: Option<u64>,
        (device, name): (&Device, &str),
        on_trial: OnTrial<'_>,
    ) -> Result<usize, Error> {
        let data = DataConfig {
            backdrop: None,
            ..self.data_of(ClipRun::Window(self.windows.len() / 2), name)
        };
        let dataset = dataset_of(&data, memory)?;
        let of_room = match room.is_none() && self.room.is_some() {
            true => (ROOM_STEPS as f64).powf(TYPICAL_POWER),
            false => 0.0,
        };
        let budget = Budget {
            secs,
            runs: self.windows.len() as f64 + of_room,
            backdrop: room,
            first_points: None,
        };
        budget.steps(&self.train, &dataset, device, on_trial)
    }

    /// Trains and scores a run, which nobody else works on, in its folder below `out`; from its newest checkpoint where
    /// that was interrupted. Only its own frames are loaded. That of the room comes first.
    ///
    /// # Errors
    /// When its frames can't be loaded, or training fails or is stopped.
    pub fn run_one(
        &self,
        run: ClipRun,
        out: &Path,
        options: &RunOptions<'_>,
        observer: &mut dyn Observer,
    ) -> Result<(), Error> {
        let data = self.data_of(run, options.device.1);
        let dataset = dataset_of(&data, options.memory)?;
        let train = TrainConfig {
            iterations: match (run, self.room) {
                (ClipRun::Room, Some(room)) => room.iterations,
                _ => self.train.iterations,
            },
            ..self.train.clone()
        };
        observer.begin(run, train.iterations);
        let config = RunConfig::new(data, train);
        let run = take_up(&out.join(run.run_name()), &config, "clip")?;
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

    /// The data of a run.
    fn data_of(&self, run: ClipRun, device: &str) -> DataConfig {
        let (frames, backdrop) = match run {
            ClipRun::Room => (self.room.map(|room| FrameRange::Every(room.every)), None),
            ClipRun::Window(number) => {
                let Window { first, last, .. } = self.windows[number];
                let [first, last] = [first, last].map(|frame| frame as u64);
                let room = self
                    .room
                    .map(|_| Path::new("..").join(ClipRun::Room.run_name()));
                (Some(FrameRange::Places { first, last }), room)
            }
        };
        DataConfig {
            frames,
            backdrop,
            device: device.into(),
            ..self.data.clone()
        }
    }
}

/// The frames of a run.
fn dataset_of(data: &DataConfig, memory: Option<u64>) -> Result<Arc<Dataset>, Error> {
    let options = LoadOptions {
        memory,
        ..data.load_options()
    };
    let dataset = Arc::new(load(&data.dataset, &options)?);
    check_dataset(&dataset)?;
    Ok(dataset)
}

/// First and last frames of windows that cover `n` frames, evenly apart.
fn divide(n: usize, length: usize, overlap: usize) -> Vec<(usize, usize)> {
    let gaps = (n - length).div_ceil(length - overlap);
    let first = |k: usize| (k * (n - length) + gaps / 2) / gaps;
    (0..=gaps)
        .map(|k| (first(k), first(k) + length - 1))
        .collect()
}
