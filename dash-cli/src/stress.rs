//! `dash stress`: extreme inputs for every operation, scene and training.

use clap::Args;
use dash_train::stress::{Case, Outcome, cases, long_cases, run as run_case};
use serde::Serialize;

use crate::Shared;
use crate::failure::{self, Failure};

/// Run extreme inputs through every operation and through training, and say how far each is off
#[derive(Args)]
#[command(after_help = "Examples:
  dash stress
  dash stress --device wgpu --only training
  dash stress --json > stress.json

One line per case: the part of it that is nearest to its tolerance, or furthest beyond. The exit code is 1
when something that came out was not finite or beyond its tolerance, else 0.")]
pub struct StressArgs {
    /// Write JSON: an object with device, passes and cases, each with family, case, extreme, passes, finite,
    /// parts (name, error, tolerance), failure and ms
    #[arg(long)]
    json: bool,
    /// Run the cases alone whose family or name holds this
    #[arg(long, value_name = "NAME")]
    only: Option<String>,
    /// Train for 10,000 steps on the worst of the cases instead
    #[arg(long)]
    long: bool,
}

#[derive(Serialize)]
struct Report {
    device: String,
    passes: bool,
    cases: Vec<Outcome>,
}

pub fn run(args: &StressArgs, shared: &Shared) -> Result<String, Failure> {
    let choice = shared.device.unwrap_or_default().resolved();
    let device = choice.device()?;
    let mut chosen: Vec<Case> = match args.long {
        true => long_cases(),
        false => cases(),
    };
    if let Some(only) = &args.only {
        let names = names(&chosen);
        chosen.retain(|case| case.family.contains(only) || case.name.contains(only));
        if chosen.is_empty() {
            return Err(Failure::usage(format!(
                "--only {only}: expected part of a family's or a case's name, found none of {names}"
            )));
        }
    }
    let mut outcomes = Vec::new();
    if !args.json {
        // At once: some cases take minutes.
        failure::print(&heading())?;
    }
    for case in &chosen {
        let outcome = run_case(case, &device);
        if !args.json {
            failure::print(&line(&outcome))?;
        }
        outcomes.push(outcome);
    }
    let failed = outcomes.iter().filter(|outcome| !outcome.passes).count();
    let n = outcomes.len();
    if args.json {
        let report = Report {
            device: choice.to_string(),
            passes: failed == 0,
            cases: outcomes,
        };
        let text = serde_json::to_string_pretty(&report)
            .map_err(|e| Failure::new(format!("the cases cannot be written as JSON: {e}")))?;
        failure::print(&text)?;
    }
    match failed {
        0 if args.json => Ok(String::new()),
        0 => Ok(format!("\n{n} of {n} pass on {choice}")),
        _ => Err(Failure::new(format!(
            "{failed} of {n} cases fail on {choice}"
        ))),
    }
}

fn names(cases: &[Case]) -> String {
    let names: Vec<String> = cases
        .iter()
        .map(|case| format!("{}/{}", case.family, case.name))
        .collect();
    names.join(", ")
}

/// Columns as Markdown has them, so that the output is a table anywhere.
fn heading() -> String {
    format!(
        "| {:13} | {:27} | {:69} | {:>8} | {:>9} | {:36} | {:6} | {:>8} | {:6} |\n|{}|",
        "family",
        "case",
        "extreme",
        "error",
        "tolerance",
        "of",
        "finite",
        "ms",
        "result",
        [15, 29, 71, 10, 11, 38, 8, 10, 8]
            .map(|n| "-".repeat(n))
            .join("|")
    )
}

fn line(outcome: &Outcome) -> String {
    let number = |value: f64| match value {
        0.0 => "0".to_string(),
        value if (0.01..1e4).contains(&value) => format!("{value:.3}"),
        value => format!("{value:.1e}"),
    };
    let (error, tolerance, part) = match (outcome.worst(), &outcome.failure) {
        (_, Some(failure)) => ("-".into(), "-".into(), failure.clone()),
        (Some(part), None) => (
            number(part.error),
            number(part.tolerance),
            part.name.clone(),
        ),
        (None, None) => ("-".into(), "-".into(), "nothing".into()),
    };
    format!(
        "| {:13} | {:27} | {:69} | {error:>8} | {tolerance:>9} | {part:36} | {:6} | {:8.1} | {:6} |",
        outcome.family,
        outcome.case,
        outcome.extreme,
        if outcome.finite { "yes" } else { "no" },
        outcome.ms,
        if outcome.passes { "pass" } else { "FAIL" },
    )
}
