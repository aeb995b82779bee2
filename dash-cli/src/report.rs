//! `dash report`: what was measured, on one page.

use std::path::PathBuf;

use clap::Args;
use dash_train::report::Report;

use crate::failure::Failure;

/// Draw error against run time: runs and kernel benchmarks on one page, with CSV and PNG
#[derive(Args)]
#[command(after_help = "Examples:
  dash train out/room --out runs/room-s0 --preset quick --curve 20 --seed 0
  dash train out/room --out runs/room-s1 --preset quick --curve 20 --seed 1
  dash report runs/room-s0 runs/room-s1 --out out/report
  dash bench --out out/kernels.json && dash report out/kernels.json --out out/kernels

Runs that differ in nothing but their seed are one group: medians, with a band from the lowest to the
highest. report.html needs no other file. What was not measured is left out, and the page says so.")]
pub struct ReportArgs {
    /// Runs' folders, and files of `dash bench`
    #[arg(required = true, value_name = "RUN|BENCH")]
    inputs: Vec<PathBuf>,
    /// The folder to write into; files of an earlier report are replaced
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
}

pub fn run(args: &ReportArgs) -> Result<String, Failure> {
    let report = Report::of_paths(&args.inputs)?;
    let files = report.write(&args.out)?;
    Ok(format!(
        "{} files written to {}; open {}",
        files.len(),
        args.out.display(),
        files[0].display()
    ))
}
