//! Methods for dynamic scenes on the same data, at the same cost.
//!
//! Every method is a change of one preset ([`Method::of`]) and trains as long as the budget says: short
//! runs of its own schedule tell how many steps that is, and its first run is done again with another
//! number of steps while that misses the budget by more than 5 %, three times at most. Seconds are those
//! that the machine would have taken at the speed it had when the comparison began: every two seconds some
//! steps of a reference run are timed (`OUT/speed.toml` keeps what they took at first). Each run is an
//! ordinary run's folder, `OUT/METHOD/seed-S`.

mod budget;
mod gauge;
mod method;

use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use burn::tensor::Device;
use dash_model::scene_file::write_atomically;
use serde::{Deserialize, Serialize};

pub use budget::Budget;
use gauge::Gauge;
pub use method::Method;

use crate::TrainError;
use crate::dataset::{Dataset, Partition};
use crate::evaluate::{Process, Results, evaluate_run, read_results, reset_peak_memory};
use crate::train::{
    DataConfig, RunConfig, RunFolder, StepReport, TrainConfig, TrainOptions, train,
};

/// What is compared: `OUT/compare.toml`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Comparison {
    /// Training seconds that each run should take, at the speed that the machine has when the comparison begins.
    pub budget_secs: f64,
    /// Measurements along each run.
    pub curve: usize,
    /// The data and the device.
    pub data: DataConfig,
    /// What every method changes. Its iterations and seed are replaced.
    pub preset: TrainConfig,
}

/// How fast the machine was when a comparison began: `OUT/speed.toml`.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Speed {
    /// Seconds of a step of the reference run.
    reference_step_secs: f64,
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

/// Told how a comparison goes on.
pub trait Observer {
    /// A run begins, of so many steps; `trial` when it only finds out how many fit the budget.
    fn begin(&mut self, method: Method, seed: u64, iterations: usize, trial: bool);
    /// A step of it is done.
    fn step(&mut self, report: &StepReport, seconds: f64);
}

impl Comparison {
    /// Trains what is not there yet of `methods` with seeds `0..seeds`, into folders below `out`.
    ///
    /// # Errors
    /// When `out` holds another comparison, the dataset has no test views, or training fails; runs
    /// finished until then remain and are taken as they are next time.
    pub fn run(
        &self,
        methods: &[Method],
        seeds: u64,
        out: &Path,
        dataset: &Arc<Dataset>,
        device: &Device,
        observer: &mut dyn Observer,
    ) -> Result<Vec<ComparedRun>, TrainError> {
        if dataset.views_of(Partition::Test).next().is_none() {
            return Err(TrainError::run(
                &dataset.root,
                "expected test views to compare methods on, found none; hold cameras out with \
                 --test-cameras",
            ));
        }
        self.claim(out)?;
        let mut runs = Vec::new();
        let mut gauge = None;
        for &method in methods {
            let mut known = None;
            for seed in 0..seeds {
                let root = out.join(method.folder()).join(format!("seed-{seed}"));
                let (run, results) = match finished(&root)? {
                    Some(finished) => finished,
                    None => {
                        let gauge = match &mut gauge {
                            Some(gauge) => gauge,
                            none => none.insert(self.gauge(out, dataset, device)?),
                        };
                        let mut config = method.of(&self.preset);
                        config.seed = seed;
                        let budget = Budget {
                            seconds: self.budget_secs,
                        };
                        config.iterations = match known {
                            Some(iterations) => iterations,
                            None => {
                                let mut told =
                                    |n: usize, step: Option<(&StepReport, f64)>| match step {
                                        None => observer.begin(method, seed, n, true),
                                        Some((report, secs)) => observer.step(report, secs),
                                    };
                                budget.iterations(&config, dataset, device, gauge, &mut told)?
                            }
                        };
                        let mut tried = Vec::new();
                        loop {
                            observer.begin(method, seed, config.iterations, false);
                            let made = self.train(
                                config.clone(),
                                &root,
                                dataset,
                                device,
                                gauge,
                                observer,
                            )?;
                            let secs = made.1.train_seconds.unwrap_or(self.budget_secs);
                            tried.push((config.iterations, secs));
                            match budget.corrected(&tried) {
                                // All seeds take the same number of steps.
                                Some(iterations) if known.is_none() => {
                                    config.iterations = iterations;
                                    fs::remove_dir_all(&root)
                                        .map_err(|e| TrainError::io(&root, "remove", e))?;
                                }
                                _ => break made,
                            }
                        }
                    }
                };
                known = Some(results.iterations);
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

    fn train(
        &self,
        config: TrainConfig,
        root: &Path,
        dataset: &Arc<Dataset>,
        device: &Device,
        gauge: &mut Gauge,
        observer: &mut dyn Observer,
    ) -> Result<(RunFolder, Results), TrainError> {
        let config = RunConfig::new(self.data.clone(), config);
        if is_left_of(root, &config) {
            fs::remove_dir_all(root).map_err(|e| TrainError::io(root, "remove", e))?;
        }
        let run = RunFolder::create(root, &config)?;
        reset_peak_memory();
        let options = TrainOptions {
            resume: false,
            curve: self.curve,
            on_step: &mut |report, secs| observer.step(report, secs),
            pace: Some(&mut |secs| gauge.paced(secs)),
        };
        train(&run, &config.train, dataset.clone(), device, options)?;
        let name = (device, self.data.device.as_str());
        let results = evaluate_run(
            &run,
            dataset,
            Partition::Test,
            name,
            Process::Trained,
            &Default::default(),
        )?;
        let checkpoints = run.checkpoints_path();
        fs::remove_dir_all(&checkpoints).map_err(|e| TrainError::io(&checkpoints, "remove", e))?;
        Ok((run, results))
    }

    /// The machine's speed, against that when the comparison in `out` began.
    fn gauge(
        &self,
        out: &Path,
        dataset: &Arc<Dataset>,
        device: &Device,
    ) -> Result<Gauge, TrainError> {
        let path = out.join("speed.toml");
        let known = match fs::read_to_string(&path) {
            Ok(text) => {
                let speed = toml::from_str::<Speed>(&text).ok();
                let sound = speed
                    .filter(|s| s.reference_step_secs > 0.0 && s.reference_step_secs.is_finite());
                Some(sound.ok_or_else(|| {
                    TrainError::run(
                        &path,
                        format!(
                            "expected `reference_step_secs = SECONDS`, found `{}`; remove the file to measure \
                             the runs that are missing by the machine's present speed",
                            text.trim()
                        ),
                    )
                })?)
            }
            Err(e) if e.kind() == std::io::ErrorKind::NotFound => None,
            Err(e) => return Err(TrainError::io(&path, "read", e)),
        };
        let first = known.as_ref().map(|speed| speed.reference_step_secs);
        let gauge = Gauge::new(&self.preset, dataset, device, first)?;
        if known.is_none() {
            let speed = Speed {
                reference_step_secs: gauge.first(),
            };
            let text = toml::to_string(&speed).map_err(|e| TrainError::Config(e.to_string()))?;
            write_atomically(&path, |mut file| file.write_all(text.as_bytes()))?;
        }
        Ok(gauge)
    }

    /// Makes `out` this comparison's, or finds that it is.
    fn claim(&self, out: &Path) -> Result<(), TrainError> {
        let path = Self::path(out);
        let text = toml::to_string(self).map_err(|e| TrainError::Config(e.to_string()))?;
        if path.is_file() {
            let found = fs::read_to_string(&path).map_err(|e| TrainError::io(&path, "read", e))?;
            return match toml::from_str::<Self>(&found) {
                Ok(found) if found == *self => Ok(()),
                _ => Err(TrainError::run(
                    out,
                    "expected a new folder or this comparison's, found another one's (compare.toml \
                     differs); choose another --out",
                )),
            };
        }
        let occupied = fs::read_dir(out).is_ok_and(|mut entries| entries.next().is_some());
        if occupied {
            return Err(TrainError::run(
                out,
                "expected a new or empty folder for the comparison, found files in it; choose \
                 another --out",
            ));
        }
        fs::create_dir_all(out).map_err(|e| TrainError::io(out, "create", e))?;
        write_atomically(&path, |mut file| file.write_all(text.as_bytes()))?;
        Ok(())
    }

    fn path(out: &Path) -> PathBuf {
        out.join("compare.toml")
    }
}

/// Whether a folder holds what an interrupted comparison left of this run. What is anything else is not
/// touched.
fn is_left_of(root: &Path, config: &RunConfig) -> bool {
    let found = RunFolder::open(root).and_then(|run| run.config());
    found.is_ok_and(|found| {
        let mut found = found.as_begun();
        // How many steps fit the budget is found anew.
        found.train.iterations = config.train.iterations;
        found == *config
    })
}

/// A run that was trained and scored.
fn finished(root: &Path) -> Result<Option<(RunFolder, Results)>, TrainError> {
    if !root.exists() {
        return Ok(None);
    }
    let Ok(run) = RunFolder::open(root) else {
        return Ok(None);
    };
    Ok(read_results(&run)?.map(|results| (run, results)))
}
