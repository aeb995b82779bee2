//! Trains the runs of a comparison, each for so many steps or seconds.

use std::fs;
use std::io::Write;
use std::path::Path;
use std::sync::Arc;

use burn::tensor::Device;
use dash_model::scene_file::write_atomically;
use serde::{Deserialize, Serialize};

use super::gauge::Gauge;
use super::{Budget, Common, Comparison, Length, Method, Observer};
use crate::Error;
use crate::dataset::Dataset;
use crate::evaluate::Perceptual;
use crate::jobs::Hold;
use crate::results::{Results, take_up, train_and_score};
use crate::train::{Additions, RunConfig, RunFolder, StepReport, TrainConfig, TrainOptions};

/// How fast the machine was when a comparison began: `OUT/speed.toml`.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Speed {
    /// Seconds of a step of the reference run.
    reference_step_secs: f64,
}

/// A comparison while its runs are trained.
pub(super) struct Training<'a> {
    pub(super) comparison: &'a Comparison,
    pub(super) out: &'a Path,
    pub(super) dataset: &'a Arc<Dataset>,
    pub(super) device: &'a Device,
    pub(super) perceptual: &'a Perceptual,
    pub(super) observer: &'a mut dyn Observer,
    /// Asked before and after every step of a run of given length whether to stop there, with a checkpoint.
    pub(super) stop: &'a dyn Fn() -> bool,
    /// What the runs before it found.
    pub(super) found: &'a mut Common,
}

impl Training<'_> {
    /// Trains a run of so many steps; without a number, of as many as the seconds allow, again with another number
    /// where the run misses them.
    pub(super) fn run(
        &mut self,
        method: Method,
        seed: u64,
        iterations: Option<usize>,
        root: &Path,
    ) -> Result<(RunFolder, Results), Error> {
        if self.found.pace.is_none() {
            self.found.pace = Some(self.measure_speed()?);
        }
        let mut config = method.of(&self.comparison.preset);
        config.seed = seed;
        match (self.comparison.length, iterations) {
            (_, Some(steps)) | (Length::Steps(steps), None) => {
                config.iterations = steps;
                self.observer.begin(method, seed, steps, false);
                self.train(config, root)
            }
            (Length::Seconds(seconds), None) => {
                self.run_within(Budget { seconds }, method, config, root)
            }
        }
    }

    /// Trains a run of as many steps as a budget allows.
    fn run_within(
        &mut self,
        budget: Budget,
        method: Method,
        mut config: TrainConfig,
        root: &Path,
    ) -> Result<(RunFolder, Results), Error> {
        config.iterations = self.try_budget(budget, method, &config)?;
        let mut tried = Vec::new();
        loop {
            self.observer
                .begin(method, config.seed, config.iterations, false);
            let trained = self.train(config.clone(), root)?;
            let secs = trained.1.train_seconds.unwrap_or(budget.seconds);
            tried.push((config.iterations, secs));
            let Some(corrected) = budget.corrected(&tried) else {
                return Ok(trained);
            };
            config.iterations = corrected;
            fs::remove_dir_all(root).map_err(|e| Error::io(root, "remove", e))?;
        }
    }

    /// Steps of a method that take about the budget, by short trials.
    fn try_budget(
        &mut self,
        budget: Budget,
        method: Method,
        config: &TrainConfig,
    ) -> Result<usize, Error> {
        let observer = &mut *self.observer;
        let mut told = |n: usize, step: Option<(&StepReport, f64)>| match step {
            None => observer.begin(method, config.seed, n, true),
            Some((report, secs)) => observer.step(report, secs),
        };
        let gauge = self.found.pace.as_mut().expect("measured before any run");
        let first_points = &self.found.first_points;
        let on = (self.dataset, self.device);
        budget.iterations(config, on, gauge, first_points, &mut told)
    }

    fn train(&mut self, config: TrainConfig, root: &Path) -> Result<(RunFolder, Results), Error> {
        let data = &self.comparison.data;
        let config = RunConfig::new(data.clone(), config);
        // Where steps are to fit a time, one process trains all of a run.
        let resumes = matches!(self.comparison.length, Length::Steps(_));
        let run = if resumes {
            take_up(root, &config, "comparison")?
        } else {
            if is_left_of(root, &config) {
                fs::remove_dir_all(root).map_err(|e| Error::io(root, "remove", e))?;
            }
            RunFolder::create(root, &config)?
        };
        let gauge = self.found.pace.as_mut().expect("measured before any run");
        let first_points = self.found.first_points.clone();
        let options = TrainOptions {
            resume: resumes,
            curve: self.comparison.curve,
            on_step: &mut |report, secs| self.observer.step(report, secs),
            watch: None,
            clock: Some(&mut |secs| gauge.paced(secs)),
            stop: match resumes {
                true => self.stop,
                false => &|| false,
            },
            additions: Additions {
                first_points,
                ..Default::default()
            },
        };
        let results = train_and_score(
            &run,
            &config,
            self.dataset,
            self.device,
            self.perceptual,
            options,
        )?;
        Ok((run, results))
    }

    /// The machine's speed, against that when the comparison began.
    fn measure_speed(&self) -> Result<Gauge, Error> {
        let path = self.out.join("speed.toml");
        // Several processes may share the comparison; the first of them measures.
        let _turn = Hold::wait(&self.out.join("held/speed"), &|| false, || ())?;
        let known = match fs::read_to_string(&path) {
            Ok(text) => {
                let speed = toml::from_str::<Speed>(&text).ok();
                let sound = speed
                    .filter(|s| s.reference_step_secs > 0.0 && s.reference_step_secs.is_finite());
                Some(sound.ok_or_else(|| {
                    Error::run(
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
            Err(e) => return Err(Error::io(&path, "read", e)),
        };
        let first = known.as_ref().map(|speed| speed.reference_step_secs);
        let gauge = Gauge::new(
            &self.comparison.preset,
            self.dataset,
            self.device,
            first,
            &self.found.first_points,
        )?;
        if known.is_none() {
            let speed = Speed {
                reference_step_secs: gauge.first(),
            };
            let text = toml::to_string(&speed).map_err(|e| Error::Config(e.to_string()))?;
            write_atomically(&path, |mut file| file.write_all(text.as_bytes()))?;
        }
        Ok(gauge)
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
