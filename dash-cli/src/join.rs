//! `dash join`: the page of a plan's runs.

use std::path::PathBuf;

use clap::Args;
use dash_train::jobs::{Plan, Work};

use crate::failure::Failure;
use crate::{benchmark, compare, windows};

/// Most missing tasks that an error names.
const MOST_NAMED: usize = 8;

/// Put the runs of a plan together, as `dash compare` or `dash benchmark` does; say which are missing
#[derive(Args)]
#[command(after_help = "Example:
  dash join runs/all

Writes OUT/report.html, and what else the command writes whose runs were planned; of windows it tells the scores. Fails
while a task is not done, and names it.")]
pub struct JoinArgs {
    /// The plan's folder
    plan: PathBuf,
}

pub fn run(args: &JoinArgs) -> Result<String, Failure> {
    let (plan, out) = (Plan::read(&args.plan)?, &args.plan);
    Plan::tidy(out)?;
    let missing = plan.missing(out)?;
    if !missing.is_empty() {
        let named = missing.iter().take(MOST_NAMED).copied();
        let named = named.collect::<Vec<_>>().join(", ");
        let more = if missing.len() > MOST_NAMED {
            ", .."
        } else {
            ""
        };
        return Err(Failure::new(format!(
            "{}: expected {} finished tasks, found {} missing: {named}{more}; do them with `dash work {}`",
            out.display(),
            plan.tasks().len(),
            missing.len(),
            out.display()
        )));
    }
    match &plan.work {
        Work::Compare { methods, had_a_say } => compare::join(&plan, methods, *had_a_say, out),
        Work::Benchmark { scenes } => benchmark::join(&plan, scenes, out),
        Work::Windows { .. } => windows::join(out),
    }
}
