//! `dash work`: tasks of a plan.

use std::path::{Path, PathBuf};

use burn::tensor::Device;
use clap::Args;
use dash_train::device::DeviceChoice;
use dash_train::evaluate::Perceptual;
use dash_train::jobs::{Plan, Tally, Which, Work};
use dash_train::process::stop;

use crate::Shared;
use crate::failure::{Failure, unless_stopped};
use crate::{benchmark, compare, windows};

/// Do tasks of a plan: train and score their runs
#[derive(Args)]
#[command(after_help = "Examples:
  dash work runs/all
  dash work runs/all --task 3
  seq 0 11 | xargs -P 4 -I N dash work runs/all --task N --device cuda:all

Without --task it does all tasks that are not done, except those that other processes work on; one that fails does not keep
the others from being done. With --task it does one, and waits where another process works on it. A task that is done is not
done again. One that was stopped, or killed, goes on from its newest checkpoint. Each process uses all CPU threads: give
each its share with --threads. --device cuda:all takes a GPU that no other process on this machine has taken
so.")]
pub struct WorkArgs {
    /// The plan's folder
    plan: PathBuf,
    /// One task, by its number [default: all that nobody works on]
    #[arg(long, value_name = "N")]
    task: Option<usize>,
}

impl WorkArgs {
    /// All tasks of a plan.
    pub fn all(plan: &Path) -> Self {
        Self {
            plan: plan.to_path_buf(),
            task: None,
        }
    }

    /// One task of a plan.
    pub fn one(plan: &Path, task: usize) -> Self {
        Self {
            task: Some(task),
            ..Self::all(plan)
        }
    }
}

/// What tasks are done with.
pub struct On<'a> {
    /// The device as named.
    pub choice: DeviceChoice,
    /// The device.
    pub device: &'a Device,
    /// What LPIPS is measured with.
    pub perceptual: &'a Perceptual,
    /// Asked before and after every step whether to stop there.
    pub stop: &'a dyn Fn() -> bool,
}

/// How stopped work goes on.
const WAY_ON: &str = "the same command goes on from there";

pub fn run(args: &WorkArgs, shared: &Shared) -> Result<String, Failure> {
    let (plan, out) = (Plan::read(&args.plan)?, &args.plan);
    let which = args.task.map_or(Which::All, Which::One);
    if let Some(number) = args.task {
        plan.of_task(number)?;
    }
    let choice = shared.device.unwrap_or_default().resolved();
    let device = choice.device()?;
    let perceptual = plan.lpips.load(&device)?;
    let asked = stop::Asked::default();
    let on = On {
        choice,
        device: &device,
        perceptual: &perceptual,
        stop: &|| asked.now(),
    };
    stop::set_way_on(Some(WAY_ON.into()));
    let outcome = match &plan.work {
        Work::Compare { methods, .. } => compare::work((&plan, methods), which, out, &on, shared),
        Work::Benchmark { scenes } => benchmark::work((&plan, scenes), which, out, &on, shared),
        Work::Windows { .. } => windows::work(&plan, which, out, &on, shared),
    };
    if matches!(&outcome, Ok(tally) if tally.held > 0) {
        return match asked.end() {
            Some(signal) => {
                let told = "stopped while another process worked on a task";
                Err(Failure::stopped(signal, told))
            }
            None => told(outcome?),
        };
    }
    told(unless_stopped(outcome, asked, WAY_ON)?)
}

/// What became of the tasks.
///
/// # Errors
/// When one has failed.
fn told(tally: Tally) -> Result<String, Failure> {
    let Tally {
        done,
        before,
        held,
        failed,
    } = tally;
    let mut parts = vec![format!("{done} done")];
    for (n, what) in [(before, "done before"), (held, "in others' hands")] {
        if n > 0 {
            parts.push(format!("{n} {what}"));
        }
    }
    let told = format!("tasks: {}", parts.join(", "));
    let more = failed.len().saturating_sub(1);
    match failed.into_iter().next() {
        None => Ok(told),
        Some((run, error)) => {
            let others = match more {
                0 => String::new(),
                n => format!("; so did {n} more"),
            };
            Err(Failure::new(format!(
                "{run} failed: {error}{others} ({told})"
            )))
        }
    }
}
