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
use std::path::Path;
use std::sync::Arc;

use burn::tensor::Device;
use serde::{Deserialize, Serialize};

pub use budget::Budget;
pub use lead::{Lead, Standing};
pub use method::Method;
pub use tables::tables;
use training::Training;

use crate::Error;
use crate::dataset::{Dataset, Partition};
use crate::evaluate::Perceptual;
use crate::files::claim;
use crate::numbers::median_and_range;
use crate::results::{Results, scored};
use crate::train::{DataConfig, RunFolder, StepReport, TrainConfig, check_dataset};

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

/// Which runs a comparison has, and what scores them.
pub struct RunOptions<'a> {
    /// What is trained.
    pub methods: &'a [Method],
    /// Runs of each method, of seeds from 0.
    pub seeds: u64,
    /// Networks of LPIPS.
    pub perceptual: &'a Perceptual,
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
    /// Trains and scores what is not there yet, in folders below `out`.
    ///
    /// # Errors
    /// When `out` holds another comparison, the dataset has no test views, or training fails; runs
    /// finished until then remain and are taken as they are next time.
    pub fn run(
        &self,
        options: &RunOptions<'_>,
        out: &Path,
        dataset: &Arc<Dataset>,
        device: &Device,
        observer: &mut dyn Observer,
    ) -> Result<Vec<ComparedRun>, Error> {
        if dataset.views_of(Partition::Test).next().is_none() {
            return Err(Error::run(
                &dataset.root,
                "expected test views to compare methods on, found none; hold cameras out with \
                 --test-cameras",
            ));
        }
        check_dataset(dataset)?;
        claim(out, "compare.toml", self, "comparison")?;
        let mut training = Training {
            comparison: self,
            out,
            dataset,
            device,
            perceptual: options.perceptual,
            observer,
            gauge: None,
        };
        let mut runs = Vec::new();
        for &method in options.methods {
            // All seeds of a method take the same number of steps.
            let mut iterations = match self.length {
                Length::Steps(steps) => Some(steps),
                Length::Seconds(_) => None,
            };
            for seed in 0..options.seeds {
                let root = out.join(method.folder()).join(format!("seed-{seed}"));
                let (run, results) = match scored(&root)? {
                    Some(finished) => finished,
                    None => training.run(method, seed, iterations, &root)?,
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
}
