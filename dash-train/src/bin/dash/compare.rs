//! `dash compare`: several methods on one dataset.

use std::path::PathBuf;
use std::sync::Arc;

use clap::{ArgGroup, Args};
use dash_train::compare::{
    ComparedRun, Comparison, Length, Method, Observer, RunOptions, median_over_seeds, tables,
};
use dash_train::process::stop;
use dash_train::report::{Block, RunGroup, compared, read_run};
use dash_train::train::{Preset, StepReport};

use crate::Shared;
use crate::configuration::{ConfigFile, Overrides};
use crate::data::DataArgs;
use crate::failure::Failure;
use crate::lpips::LpipsArgs;
use crate::progress::RunsProgress;
use crate::summary;
use crate::values;

/// Train several methods on the same data for the same time or the same steps, and compare them
#[derive(Args)]
#[command(group = ArgGroup::new("length").required(true), after_help = "Examples:
  dash compare out/room --budget 60 --out out/compare
  dash compare out/room --iterations 3000 --methods dash,hash,grid4d+dec,grid4d --out out/equal-steps
  dash compare zju313 --methods dash,hexplane,static --budget 120 --downscale 2 --out out/zju

Methods: dash (the preset); w/o-dec, w/o-ctrl, w/o-reg (without the decomposition, density control of what
moves, the regulariser); hash (its 4D grid alone, without following and decomposition); hexplane (4DGaussians'
planes), grid4d, and both with +dec; embedding (E-D3DGS); static (3DGS). All use this project's rasterizer and
density control; sizes, learning rates and schedules of other methods are their authors'. Each run is a run's
folder, OUT/METHOD/seed-S; OUT/report.html is a page of all; the same command again trains what is missing.
Below the table stands where dash is ahead, level or behind, by its seeds.")]
pub struct CompareArgs {
    /// The dataset's folder, in any of the layouts of `dash train`
    dataset: PathBuf,
    /// The folder of the comparison
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Methods to train [default: all]
    #[arg(long, value_enum, value_delimiter = ',', value_name = "LIST")]
    methods: Vec<Method>,
    /// Runs of each method, from seeds 0, 1, ..
    #[arg(long, value_name = "N", default_value_t = 3, value_parser = clap::value_parser!(u64).range(1..))]
    seeds: u64,
    /// Training time of each run, such as 60s or 5min; how many steps that is, short runs tell
    #[arg(long, value_name = "TIME", group = "length", value_parser = values::seconds)]
    budget: Option<f64>,
    /// Training steps of each run, in place of seconds
    #[arg(long, value_name = "N", group = "length", value_parser = clap::value_parser!(u32).range(1..))]
    iterations: Option<u32>,
    /// Measurements along each run
    #[arg(long, value_name = "N", default_value_t = 12)]
    curve: usize,
    /// What every method changes
    #[arg(long, value_enum, default_value = "quick")]
    preset: Preset,
    /// Values that replace the preset's
    #[arg(long, value_name = "F.toml")]
    config: Option<PathBuf>,
    /// One value that replaces the preset's and the file's; may be repeated
    #[arg(long, value_name = "KEY=VALUE")]
    set: Vec<String>,
    #[command(flatten)]
    lpips: LpipsArgs,
    #[command(flatten)]
    data: DataArgs,
    /// The data had a say in the choice of a method's values: the tables are marked
    #[arg(long)]
    had_a_say: bool,
}

/// What marks tables of data that had a say in the choice of a method's values.
const HAD_A_SAY: &str = "This data had a say in the choice of a method's values.";

pub fn run(args: &CompareArgs, shared: &Shared) -> Result<String, Failure> {
    let files = args.lpips.files();
    files.check()?;
    let file = ConfigFile::read(args.config.as_deref())?;
    let overrides = Overrides {
        preset: Some(args.preset),
        file: args.config.as_deref(),
        assignments: &args.set,
        iterations: args.iterations.map(|steps| steps as usize),
        seed: None,
        keep: None,
    };
    let preset = overrides.resolve(&file)?;
    let choice = shared.device.unwrap_or_default().resolved();
    let device = choice.device()?;
    let perceptual = files.load(&device)?;
    let (data, dataset) = args.data.load(&args.dataset, &file.data, choice)?;
    let dataset = Arc::new(dataset);
    let length = match args.budget {
        Some(seconds) => Length::Seconds(seconds),
        None => Length::Steps(preset.iterations),
    };
    let comparison = Comparison {
        length,
        curve: args.curve,
        data,
        preset,
    };
    let methods = match args.methods.as_slice() {
        [] => Method::ALL.to_vec(),
        chosen => {
            let mut methods = chosen.to_vec();
            methods.sort();
            methods.dedup();
            methods
        }
    };
    let mut told = Told {
        progress: RunsProgress::new(shared),
    };
    stop::set_way_on(Some(
        "the same command goes on with the runs that are missing".into(),
    ));
    let options = RunOptions {
        methods: &methods,
        seeds: args.seeds,
        perceptual: &perceptual,
    };
    let runs = comparison.run(&options, &args.out, &dataset, &device, &mut told)?;
    told.progress.end();
    let mut groups: Vec<RunGroup> = Vec::new();
    for run in &runs {
        let record = read_run(run.run.root())?;
        let label = run.method.name();
        match groups.iter_mut().find(|group| group.label == label) {
            Some(group) => group.runs.push(record),
            None => groups.push(RunGroup {
                label: label.into(),
                runs: vec![record],
            }),
        }
    }
    let title = format!("{}: methods at {length} of training", dataset.name);
    let mut report = compared(title, &groups);
    let mut told = table(&methods, &runs);
    let mut blocks = Vec::new();
    if args.had_a_say {
        told.push_str(&format!("\n{HAD_A_SAY}"));
        blocks.push(Block::Text(HAD_A_SAY.into()));
    }
    for table in tables(&runs) {
        told.push_str(&format!("\n\n{}", table.text()));
        blocks.push(Block::Table(table));
    }
    // Behind the summary.
    report.blocks.splice(1..1, blocks);
    report.write(&args.out)?;
    Ok(format!(
        "{told}\nwritten to {}; open {}",
        args.out.display(),
        args.out.join("report.html").display()
    ))
}

/// Tells which run is going on, and how far it is.
struct Told<'a> {
    progress: RunsProgress<'a>,
}

impl Observer for Told<'_> {
    fn begin(&mut self, method: Method, seed: u64, iterations: usize, trial: bool) {
        self.progress.end();
        let what = if trial { "trial of" } else { "training" };
        tracing::info!("{what} {method}, seed {seed}, {iterations} steps");
        self.progress.begin(iterations);
    }

    fn step(&mut self, report: &StepReport, seconds: f64) {
        self.progress.step(report, seconds);
    }
}

/// One line per method: medians over its seeds.
fn table(methods: &[Method], runs: &[ComparedRun]) -> String {
    let mut lines = vec![
        "method       seeds    secs   steps   PSNR  moving   SSIM  LPIPS  static + dynamic    fps      size"
            .to_string(),
    ];
    for &method in methods {
        let of: Vec<&ComparedRun> = runs.iter().filter(|run| run.method == method).collect();
        let median = |value: fn(&ComparedRun) -> Option<f64>| median_over_seeds(&of, value);
        let shown = |value: Option<f64>, digits: usize| {
            value.map_or("-".to_string(), |value| format!("{value:.digits$}"))
        };
        lines.push(format!(
            "{:12} {:5} {:>7} {:>7} {:>6} {:>7} {:>6} {:>6} {:>8} + {:<7} {:>6} {:>9}",
            method.name(),
            of.len(),
            shown(median(|run| run.results.train_seconds), 1),
            shown(median(|run| Some(run.results.iterations as f64)), 0),
            shown(median(|run| run.results.evaluation.psnr), 2),
            shown(median(|run| run.results.evaluation.psnr_dynamic), 2),
            shown(median(|run| run.results.evaluation.ssim), 3),
            shown(
                median(|run| {
                    let scores = &run.results.evaluation;
                    scores.lpips_alex.or(scores.lpips_vgg)
                }),
                3
            ),
            shown(
                median(|run| Some(run.results.evaluation.n_static as f64)),
                0
            ),
            shown(
                median(|run| Some(run.results.evaluation.n_dynamic as f64)),
                0
            ),
            shown(median(|run| run.results.evaluation.render_fps), 1),
            median(|run| Some(run.results.storage_bytes as f64))
                .map_or("-".into(), |bytes| summary::bytes(bytes as u64)),
        ));
    }
    lines.join("\n")
}
