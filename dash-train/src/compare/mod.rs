//! Compares methods for dynamic scenes on the same data at the same cost.
//!
//! Every method changes one preset ([`Method::of`]) and trains for the same steps or for the same seconds. Short runs of
//! a method's own schedule estimate how many steps fit the seconds. Its first run is repeated with another number of
//! steps while it misses them by more than 5 %, at most three times. Seconds are corrected for the machine's speed: every
//! two seconds the steps of a reference run are timed against those of the comparison's beginning (`OUT/speed.toml`).
//! Each run is an ordinary run folder, `OUT/METHOD/seed-S`. [`tables`] says where `dash` stands.

mod budget;
mod gauge;
mod lead;
mod method;
#[cfg(test)]
mod page;
mod tables;
mod training;

use std::fmt;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use burn::tensor::Device;
use serde::{Deserialize, Serialize};

pub use budget::Budget;
use gauge::Gauge;
pub use lead::{Lead, Standing};
pub use method::Method;
pub use tables::tables;
use training::Training;

use crate::Error;
use crate::dataset::{Dataset, Partition};
use crate::evaluate::Perceptual;
use crate::files::{claim, read_owner};
use crate::numbers::median_and_range;
use crate::results::{Results, scored};
use crate::train::{DataConfig, FirstPoints, RunFolder, StepReport, TrainConfig, check_dataset};

/// The file of a comparison's folder that says what is compared.
const FILE: &str = "compare.toml";

/// How long each run trains.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Length {
    /// For so many seconds, at the speed that the machine has when the comparison begins.
    Seconds(f64),
    /// For so many steps.
    Steps(usize),
}

impl fmt::Display for Length {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Seconds(seconds) => write!(f, "{seconds} s"),
            Self::Steps(steps) => write!(f, "{steps} steps"),
        }
    }
}

/// What is compared: `OUT/compare.toml`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Comparison {
    /// How long each run trains.
    pub length: Length,
    /// Measurements along each run.
    pub curve: usize,
    /// The data and the device.
    pub data: DataConfig,
    /// What every method changes. Its iterations and seed are replaced.
    pub preset: TrainConfig,
}

/// Which runs a comparison has, and how they are made.
pub struct RunOptions<'a> {
    /// What is trained.
    pub methods: &'a [Method],
    /// Runs of each method, of seeds from 0.
    pub seeds: u64,
    /// Networks of LPIPS.
    pub perceptual: &'a Perceptual,
    /// Asked before and after every step whether to stop there, with a checkpoint; not where runs are to take a time.
    pub stop: &'a dyn Fn() -> bool,
}

/// The data and the device of a comparison's runs.
pub struct On<'a> {
    /// The data.
    pub dataset: &'a Arc<Dataset>,
    /// The device.
    pub device: &'a Device,
    /// What the runs before it found.
    pub found: &'a mut Common,
}

/// What runs of one process share.
#[derive(Default)]
pub struct Common {
    /// The machine's speed, from the first run on.
    pace: Option<Gauge>,
    first_points: FirstPoints,
}

/// A run of a comparison.
#[derive(Debug, Clone)]
pub struct ComparedRun {
    /// What was trained.
    pub method: Method,
    /// From which seed.
    pub seed: u64,
    /// Its folder.
    pub run: RunFolder,
    /// Its scores over all test views.
    pub results: Results,
}

/// The median of what `value` gives of each run, between the middle two of an even number; `None` where it
/// gives no finite number.
pub fn median_over_seeds(
    runs: &[&ComparedRun],
    value: impl Fn(&ComparedRun) -> Option<f64>,
) -> Option<f64> {
    let values = runs.iter().filter_map(|run| value(run));
    median_and_range(values).map(|[median, ..]| median)
}

/// Told how a comparison goes on.
pub trait Observer {
    /// A run begins, of so many steps; `trial` when it only finds out how many fit the budget.
    fn begin(&mut self, method: Method, seed: u64, iterations: usize, trial: bool);
    /// A step of it is done.
    fn step(&mut self, report: &StepReport, seconds: f64);
}

impl Comparison {
    /// Makes `out` this comparison's folder, or finds that it is.
    ///
    /// # Errors
    /// When it holds another comparison, or other files.
    pub fn claim(&self, out: &Path) -> Result<(), Error> {
        claim(out, FILE, self, "comparison")
    }

    /// The comparison whose folder `out` is.
    ///
    /// # Errors
    /// When its file can't be read.
    pub fn read(out: &Path) -> Result<Self, Error> {
        read_owner(out, FILE)
    }

    /// Whether methods can be compared on a dataset.
    ///
    /// # Errors
    /// When it has no test views, or cannot be trained on.
    pub fn check(dataset: &Dataset) -> Result<(), Error> {
        if dataset.views_of(Partition::Test).next().is_none() {
            return Err(Error::run(
                &dataset.root,
                "expected test views to compare methods on, found none; hold cameras out with \
                 --test-cameras",
            ));
        }
        check_dataset(dataset)
    }

    /// Trains and scores what is not there yet, in folders below `out`.
    ///
    /// # Errors
    /// When `out` holds another comparison, the dataset has no test views, or training fails or is stopped; runs
    /// finished until then remain and are taken as they are next time.
    pub fn run(
        &self,
        options: &RunOptions<'_>,
        out: &Path,
        on: On<'_>,
        observer: &mut dyn Observer,
    ) -> Result<Vec<ComparedRun>, Error> {
        Self::check(on.dataset)?;
        self.claim(out)?;
        let mut training = self.training(options, out, on, observer);
        let mut runs = Vec::new();
        for &method in options.methods {
            // All seeds of a method take the same number of steps.
            let mut iterations = self.steps();
            for seed in 0..options.seeds {
                let (run, results) = match scored(&root(out, method, seed))? {
                    Some(finished) => finished,
                    None => training.run(method, seed, iterations, &root(out, method, seed))?,
                };
                iterations = Some(results.iterations);
                runs.push(ComparedRun {
                    method,
                    seed,
                    run,
                    results,
                });
            }
        }
        Ok(runs)
    }

    /// Trains and scores one run, which nobody else works on, in its folder below `out`.
    ///
    /// # Errors
    /// When runs are to take a time, which trials of the first seed turn into steps; and as [`Comparison::run`].
    pub fn run_one(
        &self,
        (method, seed): (Method, u64),
        options: &RunOptions<'_>,
        out: &Path,
        on: On<'_>,
        observer: &mut dyn Observer,
    ) -> Result<(), Error> {
        let Some(steps) = self.steps() else {
            return Err(Error::run(
                out,
                "expected a comparison of equal steps, found one of equal time, whose runs depend on each other and on \
                 the machine; train them with `dash compare`",
            ));
        };
        Self::check(on.dataset)?;
        let mut training = self.training(options, out, on, observer);
        training.run(method, seed, Some(steps), &root(out, method, seed))?;
        Ok(())
    }

    /// The runs that are scored.
    ///
    /// # Errors
    /// When scores can't be read.
    pub fn finished(methods: &[Method], seeds: u64, out: &Path) -> Result<Vec<ComparedRun>, Error> {
        let mut runs = Vec::new();
        for &method in methods {
            for seed in 0..seeds {
                if let Some((run, results)) = scored(&root(out, method, seed))? {
                    runs.push(ComparedRun {
                        method,
                        seed,
                        run,
                        results,
                    });
                }
            }
        }
        Ok(runs)
    }

    /// Steps of each run, where they are given.
    fn steps(&self) -> Option<usize> {
        match self.length {
            Length::Steps(steps) => Some(steps),
            Length::Seconds(_) => None,
        }
    }

    fn training<'a>(
        &'a self,
        options: &RunOptions<'a>,
        out: &'a Path,
        on: On<'a>,
        observer: &'a mut dyn Observer,
    ) -> Training<'a> {
        Training {
            comparison: self,
            out,
            dataset: on.dataset,
            device: on.device,
            perceptual: options.perceptual,
            observer,
            stop: options.stop,
            found: on.found,
        }
    }
}

/// The folder of a run.
fn root(out: &Path, method: Method, seed: u64) -> PathBuf {
    out.join(method.folder()).join(format!("seed-{seed}"))
}
