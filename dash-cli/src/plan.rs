//! `dash plan`: the runs of a comparison, of a benchmark or of a long clip's windows as tasks.

use std::path::Path;

use clap::{Args, Subcommand};
use dash_train::jobs::{Engine, Plan, script};

use crate::Shared;
use crate::benchmark::{self, BenchmarkArgs};
use crate::compare::{self, CompareArgs};
use crate::failure::Failure;
use crate::values;
use crate::windows::{self, PlanTrainArgs};

/// Write down runs as tasks, for any number of processes and machines: those of a comparison, a benchmark, or a long clip
#[derive(Args)]
#[command(after_help = "Examples:
  dash plan compare out/room --iterations 3000 --out runs/all
  dash plan benchmark n3dv neural_3d_video --seeds 3 --out runs/n3dv
  dash plan benchmark n3dv neural_3d_video --seeds 3 --out runs/n3dv --slurm | sh
  dash plan train recording --window 60 --out runs/recording

The arguments of `compare` and `benchmark` are those of `dash compare` and `dash benchmark`, and so are the runs. `train`
divides a long clip into windows of time. OUT/plan.json lists the tasks, a run each. `dash work OUT` does those that nobody works on yet: start it as often, and on as many machines, as there is room
for. `dash join OUT` writes the page of all. Planning again adds seeds, methods or scenes; what is done stays done.")]
pub struct PlanArgs {
    #[command(subcommand)]
    work: Planned,
    /// Print a script that has Slurm do the tasks and join them; arguments of the script go to sbatch
    #[arg(long, global = true, conflicts_with = "kubernetes")]
    slurm: bool,
    /// Print a manifest that has Kubernetes do the tasks
    #[arg(long, global = true)]
    kubernetes: bool,
}

/// What is planned.
#[derive(Subcommand)]
enum Planned {
    Compare(CompareArgs),
    Benchmark(BenchmarkArgs),
    Train(PlanTrainArgs),
}

pub fn run(args: &PlanArgs, shared: &Shared) -> Result<String, Failure> {
    let (plan, out) = match &args.work {
        Planned::Compare(args) => (compare::plan(args, shared)?, args.out()),
        Planned::Benchmark(args) => (benchmark::plan(args, shared)?, args.out()),
        Planned::Train(args) => (windows::plan(args, shared)?, args.out()),
    };
    let told = told(&plan, out);
    let engine = match (args.slurm, args.kubernetes) {
        (true, _) => Engine::Slurm,
        (_, true) => Engine::Kubernetes,
        _ => return Ok(told),
    };
    // The script alone goes to the standard output.
    told.lines().for_each(|line| tracing::info!("{line}"));
    // By its path: nodes of a cluster may have another `dash`, Debian's shell.
    let program = std::env::current_exe();
    let program = program.map_err(|e| Failure::new(format!("this program's own path: {e}")))?;
    let out = values::absolute(out)?;
    let needs_first = plan.needed().is_some();
    let n = plan.tasks().len();
    Ok(script(engine, &program, &out, n, needs_first))
}

fn told(plan: &Plan, out: &Path) -> String {
    let (n, out) = (plan.tasks().len(), out.display());
    let tasks = plan.tasks().iter().enumerate();
    let mut lines: Vec<String> = tasks
        .map(|(number, task)| format!("{number:6}  {}", task.run))
        .collect();
    lines.insert(0, format!("{n} tasks in {out}/plan.json:"));
    lines.push(format!(
        "do them, in as many processes as there is room for: dash work {out}"
    ));
    lines.push(format!("or one: dash work {out} --task 0"));
    lines.push(format!("then: dash join {out}"));
    lines.join("\n")
}
