//! The runs of a comparison, of a benchmark or of a long clip's windows as tasks that any number of processes share, on one
//! machine or on many that see one folder.
//!
//! A [`Plan`] is `OUT/plan.json`: which runs there are, beside `compare.toml`, `benchmark.toml` or `windows.toml`, which
//! say how each is trained. A task is one run. Whoever trains it [holds](Hold) it; a process that ends, however it does,
//! holds nothing any more. A task is done once its run is scored. One that was interrupted goes on from its newest checkpoint.
//!
//! # Map
//! - this file: plans and tasks; `hold`: who works on what; `engines`: scripts for Slurm, Kubernetes and `xargs`.

mod engines;
mod hold;
#[cfg(test)]
mod tests;

use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};

use dash_model::scene_file::write_atomically;
use dash_model::unfinished::remove_left;
use serde::{Deserialize, Serialize};

pub use engines::{Engine, script};
pub use hold::Hold;

use crate::Error;
use crate::compare::Method;
use crate::evaluate::PerceptualFiles;
use crate::results::{remove_checkpoints, scored};
use crate::train::RunFolder;
use crate::windows::ClipRun;

/// The only version of `plan.json`.
const FORMAT_VERSION: u32 = 1;
/// The plan's file.
const FILE: &str = "plan.json";
/// The folder of the files that processes hold.
const HELD: &str = "held";

/// What the tasks are runs of.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Work {
    /// A comparison, `compare.toml`.
    Compare {
        /// The methods.
        methods: Vec<Method>,
        /// Whether the data had a say in the choice of a method's values.
        had_a_say: bool,
    },
    /// A benchmark, `benchmark.toml`.
    Benchmark {
        /// The scenes' names.
        scenes: Vec<String>,
    },
    /// A long clip, `windows.toml`.
    Windows {
        /// How many windows it has.
        windows: usize,
        /// Whether they share a room, which is trained first.
        #[serde(default)]
        room: bool,
    },
}

/// `OUT/plan.json`.
///
/// ```
/// use dash_train::jobs::{Plan, Work};
///
/// let work = Work::Windows { windows: 2, room: true };
/// let plan = Plan::new(work, 1, None, Default::default());
/// let runs: Vec<&str> = plan.tasks().iter().map(|task| task.run.as_str()).collect();
/// assert_eq!(runs, ["room", "window-000", "window-001"]);
/// ```
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Plan {
    format_version: u32,
    /// What the tasks are runs of.
    pub work: Work,
    /// Seeds of each method or scene, from 0; 1 of windows.
    pub seeds: u64,
    /// Memory for the images of a dataset, bytes; see [`LoadOptions::memory`](crate::dataset::LoadOptions::memory).
    pub memory: Option<u64>,
    /// What LPIPS is measured with.
    pub lpips: PerceptualFiles,
    /// The tasks; a task's number is its place.
    tasks: Vec<Task>,
}

/// One run.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Task {
    /// Its folder, below the plan's: `METHOD/seed-S`, `SCENE/seed-S`, `room` or `window-NNN`.
    pub run: String,
}

impl Plan {
    /// The runs of each method or scene from so many seeds, or of windows.
    pub fn new(work: Work, seeds: u64, memory: Option<u64>, lpips: PerceptualFiles) -> Self {
        let tasks = tasks(&work, seeds);
        Self {
            format_version: FORMAT_VERSION,
            work,
            seeds,
            memory,
            lpips,
            tasks,
        }
    }

    /// Writes `out/plan.json`. `out` is there, with the file that says how runs are trained.
    ///
    /// # Errors
    /// [`Error::Model`] when it can't be written; what was there before stays.
    pub fn write(&self, out: &Path) -> Result<(), Error> {
        let json = serde_json::to_vec_pretty(self).map_err(|e| Error::Config(e.to_string()))?;
        write_atomically(&out.join(FILE), |mut file| file.write_all(&json))?;
        Ok(())
    }

    /// Reads `out/plan.json`.
    ///
    /// # Errors
    /// When there is none, or it is damaged.
    pub fn read(out: &Path) -> Result<Self, Error> {
        let path = out.join(FILE);
        let json = fs::read(&path).map_err(|e| match e.kind() {
            std::io::ErrorKind::NotFound => Error::run(
                out,
                "expected a folder with plan.json in it, found none; make one with `dash plan`",
            ),
            _ => Error::io(&path, "read", e),
        })?;
        let damaged = |found: String| {
            let told = format!("expected a plan, found {found}; write it again with `dash plan`");
            Error::run(&path, told)
        };
        let plan: Self = serde_json::from_slice(&json).map_err(|e| damaged(e.to_string()))?;
        if plan.format_version != FORMAT_VERSION {
            let found = plan.format_version;
            return Err(damaged(format!("version {found}, not {FORMAT_VERSION}")));
        }
        // A damaged file could name any number of seeds.
        let is_as_many = plan.tasks.len() as u128 == n_tasks(&plan.work, plan.seeds);
        if !is_as_many || plan.tasks != tasks(&plan.work, plan.seeds) {
            return Err(damaged("tasks that are not those of its seeds".into()));
        }
        Ok(plan)
    }

    /// The tasks; a task's number is its place.
    pub fn tasks(&self) -> &[Task] {
        &self.tasks
    }

    /// The method's, scene's or window's place, and the seed, of a task.
    ///
    /// # Errors
    /// When there is no such task.
    pub fn of_task(&self, number: usize) -> Result<(usize, u64), Error> {
        let n = self.tasks.len();
        if number >= n {
            return Err(Error::Setting {
                option: "--task",
                expected: format!("a number from 0 to {}", n.saturating_sub(1)),
                found: number.to_string(),
            });
        }
        let seeds = self.seeds as usize;
        Ok((number / seeds, (number % seeds) as u64))
    }

    /// Whether a task's run is scored.
    ///
    /// # Errors
    /// When its scores can't be read.
    pub fn is_done(&self, out: &Path, number: usize) -> Result<bool, Error> {
        Ok(scored(&self.run_path(out, number))?.is_some())
    }

    /// The folder of a task's run.
    pub fn run_path(&self, out: &Path, number: usize) -> PathBuf {
        out.join(&self.tasks[number].run)
    }

    /// The file that whoever works on a task holds.
    pub fn held_path(&self, out: &Path, number: usize) -> PathBuf {
        out.join(HELD)
            .join(self.tasks[number].run.replace('/', "-"))
    }

    /// Removes what killed processes have left beside the plan.
    ///
    /// # Errors
    /// The system's.
    pub fn tidy(out: &Path) -> Result<(), Error> {
        remove_left(out).map_err(|e| Error::io(out, "tidy", e))
    }

    /// Removes what a process killed between scoring a run and its end has left in it, where nobody works on it.
    fn tidy_done(&self, out: &Path, number: usize) -> Result<(), Error> {
        let run = self.run_path(out, number);
        if Hold::take(&self.held_path(out, number))?.is_none() {
            return Ok(());
        }
        remove_checkpoints(&RunFolder::open(&run)?)?;
        Self::tidy(&run)
    }

    /// Tasks that are not done.
    ///
    /// # Errors
    /// When scores can't be read.
    pub fn missing(&self, out: &Path) -> Result<Vec<&str>, Error> {
        let mut missing = Vec::new();
        for (number, task) in self.tasks.iter().enumerate() {
            if !self.is_done(out, number)? {
                missing.push(task.run.as_str());
            }
        }
        Ok(missing)
    }
}

/// Which tasks a process is to do.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Which {
    /// Those that are not done, except those that others work on.
    All,
    /// One, once nobody else works on it.
    One(usize),
}

/// What became of tasks.
#[derive(Debug, Default)]
pub struct Tally {
    /// How many were done.
    pub done: usize,
    /// How many had been done before.
    pub before: usize,
    /// How many others work on.
    pub held: usize,
    /// Runs that failed, and why.
    pub failed: Vec<(String, Error)>,
}

impl Plan {
    /// Does tasks one after another: `train` is called with the number of each that is not done, while this process holds
    /// it. One that fails does not keep the others from being done.
    ///
    /// # Errors
    /// When there is no such task, scores can't be read, a file can't be locked, or [`Error::Stopped`] of `train`.
    pub fn work(
        &self,
        out: &Path,
        which: Which,
        stop: &dyn Fn() -> bool,
        train: &mut dyn FnMut(usize) -> Result<(), Error>,
    ) -> Result<Tally, Error> {
        let numbers = match which {
            Which::All => 0..self.tasks.len(),
            Which::One(number) => {
                self.of_task(number)?;
                number..number + 1
            }
        };
        Self::tidy(out)?;
        let mut tally = Tally::default();
        for number in numbers {
            let run = &self.tasks[number].run;
            if let Some(first) = self.needed().filter(|&first| first != number)
                && self.one(out, first, true, stop, train)? == Became::Held
            {
                return Err(Error::Stopped {
                    run: self.run_path(out, first),
                    step: 0,
                });
            }
            match self.one(out, number, which != Which::All, stop, train) {
                Ok(Became::DoneBefore) => tally.before += 1,
                Ok(Became::Held) => tally.held += 1,
                Ok(Became::Done) => tally.done += 1,
                Err(Failed::Run(error)) if !matches!(error, Error::Stopped { .. }) => {
                    tracing::warn!("{run}: {error}");
                    tally.failed.push((run.clone(), error));
                }
                Err(failed) => return Err(failed.into()),
            }
        }
        Ok(tally)
    }
}

/// What became of one task.
#[derive(PartialEq, Eq)]
enum Became {
    Done,
    DoneBefore,
    /// Another process holds it.
    Held,
}

/// Why a task is not done.
enum Failed {
    /// Its run failed, or was stopped.
    Run(Error),
    /// It could not be looked at, or held.
    Task(Error),
}

impl From<Error> for Failed {
    fn from(error: Error) -> Self {
        Self::Task(error)
    }
}

impl From<Failed> for Error {
    fn from(failed: Failed) -> Self {
        match failed {
            Failed::Run(error) | Failed::Task(error) => error,
        }
    }
}

impl Plan {
    /// The task that all others need.
    pub fn needed(&self) -> Option<usize> {
        matches!(self.work, Work::Windows { room: true, .. }).then_some(0)
    }

    /// Does a task that is not done, while this process holds it. `waits` is whether it waits for another process that does;
    /// told to stop meanwhile, it finds the task held.
    fn one(
        &self,
        out: &Path,
        number: usize,
        waits: bool,
        stop: &dyn Fn() -> bool,
        train: &mut dyn FnMut(usize) -> Result<(), Error>,
    ) -> Result<Became, Failed> {
        if self.is_done(out, number)? {
            self.tidy_done(out, number)?;
            return Ok(Became::DoneBefore);
        }
        let (run, path) = (&self.tasks[number].run, self.held_path(out, number));
        let hold = match waits {
            false => Hold::take(&path)?,
            true => Hold::wait(&path, stop, || {
                tracing::info!("waiting for another process, which works on {run}");
            })?,
        };
        if hold.is_none() {
            return Ok(Became::Held);
        }
        // It may have been done since.
        if self.is_done(out, number)? {
            return Ok(Became::DoneBefore);
        }
        train(number).map_err(Failed::Run)?;
        Ok(Became::Done)
    }
}

/// How many runs there are.
fn n_tasks(work: &Work, seeds: u64) -> u128 {
    match work {
        Work::Compare { methods, .. } => methods.len() as u128 * u128::from(seeds),
        Work::Benchmark { scenes } => scenes.len() as u128 * u128::from(seeds),
        Work::Windows { windows, room } => *windows as u128 + u128::from(*room),
    }
}

/// The runs.
fn tasks(work: &Work, seeds: u64) -> Vec<Task> {
    if let Work::Windows { windows, room } = work {
        let runs = ClipRun::all(*windows, *room).map(ClipRun::run_name);
        return runs.map(|run| Task { run }).collect();
    }
    let folders: Vec<String> = match work {
        Work::Compare { methods, .. } => methods.iter().map(|method| method.folder()).collect(),
        Work::Benchmark { scenes } => scenes.clone(),
        Work::Windows { .. } => Vec::new(),
    };
    let of_seed = |(folder, seed)| Task {
        run: format!("{folder}/seed-{seed}"),
    };
    folders
        .iter()
        .flat_map(|folder| (0..seeds).map(move |seed| (folder, seed)))
        .map(of_seed)
        .collect()
}
