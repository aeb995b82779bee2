//! `dash compare`: several methods on one dataset.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use clap::{ArgGroup, Args};
use dash_train::Error;
use dash_train::compare::{
    self, ComparedRun, Comparison, Length, Method, Observer, RunOptions, median_over_seeds, tables,
};
use dash_train::dataset::{Dataset, LoadOptions, load};
use dash_train::device::DeviceChoice;
use dash_train::jobs::{Plan, Tally, Which, Work};
use dash_train::process::stop;
use dash_train::report::{Block, RunGroup, compared, read_run};
use dash_train::train::{Preset, StepReport};

use crate::Shared;
use crate::configuration::{ConfigFile, Overrides, ValueArgs};
use crate::data::DataArgs;
use crate::failure::{Failure, unless_stopped};
use crate::lpips::LpipsArgs;
use crate::progress::RunsProgress;
use crate::summary;
use crate::values;
use crate::work::On;

/// Train several methods on the same data for the same time or the same steps, and compare them
#[derive(Args)]
#[command(group = ArgGroup::new("length").required(true), after_help = "Examples:
  dash compare out/room --budget 60s --out out/compare
  dash compare out/room --iterations 3000 --methods dash,hash,grid4d+dec,grid4d --out out/equal-steps
  dash compare zju313 --methods dash,hexplane,static --budget 120 --downscale 2 --out out/zju

Methods: dash (the preset); w/o-dec, w/o-ctrl, w/o-reg (without the decomposition, density control of what
moves, the regulariser); hash (its 4D grid alone, without following and decomposition); hexplane (4DGaussians'
planes), grid4d, and both with +dec; embedding (E-D3DGS); static (3DGS). All use this project's rasterizer and
density control; sizes, learning rates and schedules of other methods are their authors'. Each run is a run's
folder, OUT/METHOD/seed-S; OUT/report.html is a page of all; the same command again trains what is missing.
Below the table stands where dash is ahead, level or behind, by its seeds.")]
#[command(mut_arg("preset", |arg| arg.help("What every method changes [default: quick]")))]
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
    #[command(flatten)]
    values: ValueArgs,
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

/// How a stopped comparison goes on.
const WAY_ON: &str = "the same command goes on with the runs that are missing";

impl CompareArgs {
    /// The folder of the comparison.
    pub fn out(&self) -> &Path {
        &self.out
    }

    /// The comparison and its dataset, whose images are decoded only once they are asked for with `to_look`.
    fn comparison(
        &self,
        choice: DeviceChoice,
        to_look: bool,
    ) -> Result<(Comparison, Dataset), Failure> {
        let file = ConfigFile::read(self.values.config.as_deref())?;
        let overrides = Overrides {
            preset: self.values.preset.or(Some(Preset::Quick)),
            iterations: self.iterations.map(|steps| steps as usize),
            ..self.values.overrides()
        };
        let preset = overrides.resolve(&file)?;
        let (data, dataset) = match to_look {
            true => self.data.look(&self.dataset, &file.data, choice)?,
            false => self.data.load(&self.dataset, &file.data, choice)?,
        };
        let comparison = Comparison {
            length: match self.budget {
                Some(seconds) => Length::Seconds(seconds),
                None => Length::Steps(preset.iterations),
            },
            curve: self.curve,
            data,
            preset,
        };
        Ok((comparison, dataset))
    }

    fn methods(&self) -> Vec<Method> {
        let mut methods = match self.methods.as_slice() {
            [] => Method::ALL.to_vec(),
            chosen => chosen.to_vec(),
        };
        methods.sort();
        methods.dedup();
        methods
    }
}

pub fn run(args: &CompareArgs, shared: &Shared) -> Result<String, Failure> {
    let files = args.lpips.files();
    files.check()?;
    let choice = shared.device.unwrap_or_default().resolved();
    let device = choice.device()?;
    let (comparison, dataset) = args.comparison(choice, false)?;
    let perceptual = files.load(&device)?;
    let methods = args.methods();
    let asked = stop::Asked::default();
    let options = RunOptions {
        methods: &methods,
        seeds: args.seeds,
        perceptual: &perceptual,
        stop: &|| asked.now(),
    };
    let mut found = compare::Common::default();
    let on = compare::On {
        dataset: &Arc::new(dataset),
        device: &device,
        found: &mut found,
    };
    let mut told = Told {
        progress: RunsProgress::new(shared),
    };
    stop::set_way_on(Some(WAY_ON.into()));
    let outcome = comparison.run(&options, &args.out, on, &mut told);
    told.progress.end();
    let runs = unless_stopped(outcome, asked, WAY_ON)?;
    written(
        comparison.length,
        (&methods, &runs),
        args.had_a_say,
        &args.out,
    )
}

/// Writes the plan of what [`run`] does.
pub fn plan(args: &CompareArgs, shared: &Shared) -> Result<Plan, Failure> {
    if args.budget.is_some() {
        return Err(Failure::usage(
            "--budget: expected --iterations N in a plan, whose tasks may run on different machines; compare at equal time \
             with `dash compare`, on one machine",
        ));
    }
    let files = args.lpips.absolute_files()?;
    files.check()?;
    let choice = shared.device.unwrap_or_default().resolved();
    let (comparison, dataset) = args.comparison(choice, true)?;
    Comparison::check(&dataset)?;
    comparison.claim(&args.out)?;
    let work = Work::Compare {
        methods: args.methods(),
        had_a_say: args.had_a_say,
    };
    let plan = Plan::new(work, args.seeds, args.data.memory, files);
    plan.write(&args.out)?;
    Ok(plan)
}

/// Does tasks of a plan.
pub fn work(
    (plan, methods): (&Plan, &[Method]),
    which: Which,
    out: &Path,
    on: &On<'_>,
    shared: &Shared,
) -> Result<Tally, Error> {
    let mut comparison = Comparison::read(out)?;
    comparison.data.device = on.choice.to_string();
    let options = RunOptions {
        methods,
        seeds: plan.seeds,
        perceptual: on.perceptual,
        stop: on.stop,
    };
    let mut told = Told {
        progress: RunsProgress::new(shared),
    };
    let mut loaded: Option<Arc<Dataset>> = None;
    let mut found = compare::Common::default();
    let tally = plan.work(out, which, on.stop, &mut |number| {
        let (place, seed) = plan.of_task(number)?;
        if loaded.is_none() {
            let load_options = LoadOptions {
                memory: plan.memory,
                ..comparison.data.load_options()
            };
            loaded = Some(Arc::new(load(&comparison.data.dataset, &load_options)?));
        }
        let dataset = loaded.as_ref().expect("loaded above");
        let on = compare::On {
            dataset,
            device: on.device,
            found: &mut found,
        };
        comparison.run_one((methods[place], seed), &options, out, on, &mut told)
    });
    told.progress.end();
    tally
}

/// Puts the runs of a plan together, all of which are done.
pub fn join(
    plan: &Plan,
    methods: &[Method],
    had_a_say: bool,
    out: &Path,
) -> Result<String, Failure> {
    let comparison = Comparison::read(out)?;
    let runs = Comparison::finished(methods, plan.seeds, out)?;
    written(comparison.length, (methods, &runs), had_a_say, out)
}

/// Writes the page of a comparison, and what to say of it.
fn written(
    length: Length,
    (methods, runs): (&[Method], &[ComparedRun]),
    had_a_say: bool,
    out: &Path,
) -> Result<String, Failure> {
    let mut groups: Vec<RunGroup> = Vec::new();
    for run in runs {
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
    let dataset = runs.first().map_or("", |run| &run.results.dataset);
    let title = format!("{dataset}: methods at {length} of training");
    let mut report = compared(title, &groups);
    let mut told = table(methods, runs);
    let mut blocks = Vec::new();
    if had_a_say {
        told.push_str(&format!("\n{HAD_A_SAY}"));
        blocks.push(Block::Text(HAD_A_SAY.into()));
    }
    for table in tables(runs) {
        told.push_str(&format!("\n\n{}", table.text()));
        blocks.push(Block::Table(table));
    }
    // Behind the summary.
    report.blocks.splice(1..1, blocks);
    report.write(out)?;
    Ok(format!(
        "{told}\nwritten to {}; open {}",
        out.display(),
        out.join("report.html").display()
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
