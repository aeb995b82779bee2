//! The `dash` command line: arguments in, one library call, a few lines out.
//!
//! Each command has a file of its own. `data` holds the options of a dataset, `configuration`
//! resolves the training configuration from its sources, `values` parses what the arguments hold,
//! `progress` reports long work, `summary` lays out what is printed, `failure` is how a command
//! fails.

mod bench;
mod benchmark;
mod compare;
mod config;
mod configuration;
mod data;
mod doctor;
mod eval;
mod event_log;
mod export;
mod failure;
mod info;
mod join;
mod lpips;
mod plan;
mod prepare;
mod progress;
mod quickstart;
#[cfg(feature = "view")]
mod ration;
mod render;
mod report;
#[cfg(feature = "view")]
mod serve;
mod stress;
mod summary;
mod synth;
mod train;
#[cfg(feature = "view")]
mod train_window;
mod values;
#[cfg(feature = "view")]
mod view;
mod watch;
#[cfg(feature = "view")]
mod web;
mod windows;
mod work;

use std::io::{IsTerminal, Write};
use std::process::ExitCode;

use clap::{Args, Parser, Subcommand};
use dash_train::device::DeviceChoice;
use dash_train::process::stop;
use tracing::level_filters::LevelFilter;
use tracing_subscriber::filter::Targets;
use tracing_subscriber::prelude::*;

use failure::Failure;

/// Stack of a thread: as much as systems give a program's first, on which commands would run otherwise.
const STACK_BYTES: usize = 8 << 20;

/// Dynamic-scene reconstruction from videos and poses to a 4D scene that renders in real time.
#[derive(Parser)]
#[command(name = "dash", version, propagate_version = true, after_help = EXAMPLE)]
struct Cli {
    #[command(flatten)]
    shared: Shared,
    #[command(subcommand)]
    command: Command,
}

const EXAMPLE: &str = "Examples, from nothing to pictures:
  dash quickstart

  dash synth out/room
  dash train out/room --out runs/room --preset quick
  dash render runs/room --cameras spiral --out out/room.mp4

`dash COMMAND --help` shows an example of each command.";

/// Options of every command.
#[derive(Args)]
#[command(next_help_heading = "Options of every command")]
struct Shared {
    /// Where to compute: auto (a GPU if there is one), wgpu, cuda[:N] or cuda:all (GPU), ndarray or flex (CPU)
    #[arg(long, global = true, value_name = "DEVICE")]
    device: Option<DeviceChoice>,
    /// CPU threads; all that there are when left out
    #[arg(long, global = true, value_name = "N", value_parser = values::count, allow_negative_numbers = true)]
    threads: Option<usize>,
    /// On a GPU: the same bits on every run, at some cost in time. The CPU always gives them
    #[arg(long, global = true)]
    deterministic: bool,
    /// Say more
    #[arg(short, long, global = true, conflicts_with = "quiet")]
    verbose: bool,
    /// Say nothing but errors and results
    #[arg(short, long, global = true)]
    quiet: bool,
}

#[derive(Subcommand)]
enum Command {
    Quickstart(quickstart::QuickstartArgs),
    Synth(synth::SynthArgs),
    Prepare(prepare::PrepareArgs),
    Doctor(doctor::DoctorArgs),
    Train(train::TrainArgs),
    Compare(compare::CompareArgs),
    Benchmark(benchmark::BenchmarkArgs),
    Plan(plan::PlanArgs),
    Work(work::WorkArgs),
    Join(join::JoinArgs),
    Eval(eval::EvalArgs),
    Render(render::RenderArgs),
    Export(export::ExportArgs),
    Report(report::ReportArgs),
    Bench(bench::BenchArgs),
    Info(info::InfoArgs),
    Config(config::ConfigArgs),
    Stress(stress::StressArgs),
    #[cfg(feature = "view")]
    View(view::ViewArgs),
}

fn main() -> ExitCode {
    dash_train::process::prepare();
    stop::listen();
    report_faults_on_one_line();
    let cli = Cli::parse();
    let outcome = std::panic::catch_unwind(|| run(&cli));
    stop::wait_if_ending();
    let outcome = outcome.map(|done| done.and_then(|text| failure::print(&text)));
    match outcome {
        Ok(Ok(())) => ExitCode::SUCCESS,
        Ok(Err(failure)) => {
            let _ = writeln!(std::io::stderr(), "error: {}", failure.line());
            ExitCode::from(failure.exit_code())
        }
        // The hook has reported it.
        Err(_) => ExitCode::FAILURE,
    }
}

fn run(cli: &Cli) -> Result<String, Failure> {
    let shared = &cli.shared;
    start_log(shared);
    dash_kernels::set_deterministic(shared.deterministic);
    start_threads(shared.threads)?;
    // Systems want windows on a program's first thread.
    #[cfg(feature = "view")]
    match &cli.command {
        Command::View(args) => return view::run(args, shared),
        Command::Train(args) if args.watch.view => {
            return train_window::beside_window(|door| train::run_with(args, shared, Some(door)));
        }
        _ => {}
    }
    // On one of them: from outside, every parallel loop would wake a thread and wait for it.
    rayon::scope(|_| carry_out(cli))
}

/// Starts as many threads as were asked for, else as the machine has.
fn start_threads(threads: Option<usize>) -> Result<(), Failure> {
    rayon::ThreadPoolBuilder::new()
        .num_threads(threads.unwrap_or(0))
        .stack_size(STACK_BYTES)
        .build_global()
        .map_err(|e| {
            let asked =
                threads.map_or_else(String::new, |threads| format!("--threads {threads}: "));
            Failure::new(format!(
                "{asked}the system cannot start them: {e}; ask for fewer"
            ))
        })
}

fn carry_out(cli: &Cli) -> Result<String, Failure> {
    let shared = &cli.shared;
    match &cli.command {
        Command::Quickstart(args) => quickstart::run(args, shared),
        Command::Synth(args) => synth::run(args),
        Command::Prepare(args) => prepare::run(args),
        Command::Doctor(args) => doctor::run(args, shared),
        Command::Train(args) => train::run(args, shared),
        Command::Compare(args) => compare::run(args, shared),
        Command::Benchmark(args) => benchmark::run(args, shared),
        Command::Plan(args) => plan::run(args, shared),
        Command::Work(args) => work::run(args, shared),
        Command::Join(args) => join::run(args),
        Command::Eval(args) => eval::run(args, shared),
        Command::Render(args) => render::run(args, shared),
        Command::Export(args) => export::run(args, shared),
        Command::Report(args) => report::run(args),
        Command::Bench(args) => bench::run(args, shared),
        Command::Info(args) => info::run(args, shared),
        Command::Config(args) => config::run(args),
        Command::Stress(args) => stress::run(args, shared),
        #[cfg(feature = "view")]
        Command::View(args) => view::run(args, shared),
    }
}

fn start_log(shared: &Shared) {
    let level = match (shared.quiet, shared.verbose) {
        (true, _) => LevelFilter::ERROR,
        (false, true) => LevelFilter::DEBUG,
        (false, false) => LevelFilter::INFO,
    };
    let lines = tracing_subscriber::fmt::layer()
        .with_writer(std::io::stderr)
        .with_ansi(std::io::stderr().is_terminal())
        .without_time()
        .with_target(false);
    tracing_subscriber::registry()
        .with(lines.with_filter(told(level)))
        .init();
}

/// What is told: our own words up to `level`, of what we build on warnings at most. Compilers of
/// kernels tell every pass over every kernel, millions of lines.
fn told(level: LevelFilter) -> Targets {
    Targets::new()
        .with_default(level.min(LevelFilter::WARN))
        .with_target("dash", level)
}

/// A broken invariant is ours to mend: the user gets one line to report, not a backtrace.
fn report_faults_on_one_line() {
    std::panic::set_hook(Box::new(|fault| {
        let what = fault.payload_as_str().unwrap_or("no message");
        let place = fault
            .location()
            .map(ToString::to_string)
            .unwrap_or_default();
        let line = failure::on_one_line(what);
        let _ = writeln!(
            std::io::stderr(),
            "error: a fault in dash itself ({place}): {line}; please report it with the command and its input"
        );
    }));
}

#[cfg(test)]
mod tests {
    use clap::CommandFactory;
    use tracing::Level;

    use super::*;

    #[test]
    fn compilers_of_kernels_only_warn_however_much_dash_tells() {
        for (level, ours) in [
            (LevelFilter::ERROR, [true, false, false, false]),
            (LevelFilter::INFO, [true, true, true, false]),
            (LevelFilter::DEBUG, [true, true, true, true]),
        ] {
            let filter = told(level);
            let tells = |target| {
                [Level::ERROR, Level::WARN, Level::INFO, Level::DEBUG]
                    .map(|level| filter.would_enable(target, &level))
            };
            assert_eq!(tells("dash_train::train"), ours);
            assert_eq!(tells("cubecl_llvm::shared"), [true, ours[1], false, false]);
        }
    }

    #[test]
    fn the_arguments_are_consistent_and_every_command_shows_an_example() {
        let mut command = Cli::command();
        command.build();
        command.clone().debug_assert();
        for sub in command
            .get_subcommands()
            .filter(|sub| sub.get_name() != "help")
        {
            let example = sub
                .get_after_help()
                .map(ToString::to_string)
                .unwrap_or_default();
            assert!(
                example.contains(&format!("dash {}", sub.get_name())),
                "{}",
                sub.get_name()
            );
        }
    }
}
