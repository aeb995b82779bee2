//! `dash benchmark`: a published protocol on the scenes that are there.

use std::path::{Path, PathBuf};

use clap::Args;
use dash_train::Error;
use dash_train::benchmark::{
    Benchmark, BenchmarkRows, DroppedCamera, Found, Observer, Prepared, RunOptions, SceneRuns,
    SceneToTrain, find_scenes, finished, page, pinned,
};
use dash_train::device::DeviceChoice;
use dash_train::jobs::{Plan, Tally, Which, Work};
use dash_train::process::stop;
use dash_train::published::{Figures, ProtocolName, Scene};
use dash_train::report::{Beside, published_figures};
use dash_train::train::StepReport;

use crate::Shared;
use crate::configuration::{ConfigFile, Overrides, ValueArgs};
use crate::failure::{Failure, unless_stopped};
use crate::lpips::LpipsArgs;
use crate::progress::RunsProgress;
use crate::summary::{self, Table};
use crate::values;
use crate::work::On;

/// Run a published protocol on a dataset's scenes, and compare with what others published
#[derive(Args)]
#[command(after_help = "Examples:
  dash benchmark n3dv neural_3d_video --out runs/n3dv
  dash benchmark n3dv neural_3d_video --scenes coffee_martini --drop-cameras coffee_martini:cam13 --out runs/coffee
  dash benchmark technicolor technicolor --seeds 3 --preset paper --out runs/technicolor
  dash benchmark panoptic data/basketball --preset quick --out runs/basketball

The protocol pins scenes, held-out views, frames and the pictures' size; OUT/report.html says what, and has our rows
beside the published ones with their sources. Scenes that are not there are told. Each run is a run's folder,
OUT/SCENE/seed-S; the same command again goes on with what is missing, and more seeds or scenes are added.
A run that is scored is not scored again: `dash eval` adds LPIPS to it. [data] of --config is not used.")]
pub struct BenchmarkArgs {
    /// The protocol
    #[arg(value_enum)]
    protocol: ProtocolName,
    /// A folder with the dataset's scenes, or one scene; each folder called as it was published
    data: PathBuf,
    /// The folder of the benchmark
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Scenes to run [default: all that are there]
    #[arg(long, value_delimiter = ',', value_name = "LIST")]
    scenes: Vec<String>,
    /// Runs of each scene, from seeds 0, 1, ..
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u64).range(1..))]
    seeds: u64,
    #[command(flatten)]
    values: ValueArgs,
    /// Optimisation steps of each run
    #[arg(long, value_name = "N", value_parser = values::count, allow_negative_numbers = true)]
    iterations: Option<usize>,
    /// Cameras to leave out of training and testing: CAMERA of every scene, or SCENE:CAMERA
    #[arg(long, value_name = "LIST", value_delimiter = ',')]
    drop_cameras: Vec<DroppedCamera>,
    /// Memory that a scene's images may take, such as 2GiB [default: half of what is free]
    #[arg(long, value_name = "BYTES", value_parser = values::bytes)]
    memory: Option<u64>,
    #[command(flatten)]
    lpips: LpipsArgs,
}

/// How a stopped benchmark goes on.
const WAY_ON: &str = "the same command goes on with what is missing";

impl BenchmarkArgs {
    /// The folder of the benchmark.
    pub fn out(&self) -> &Path {
        &self.out
    }

    fn benchmark(&self, choice: DeviceChoice) -> Result<Benchmark, Failure> {
        let file = ConfigFile::read(self.values.config.as_deref())?;
        let overrides = Overrides {
            iterations: self.iterations,
            ..self.values.overrides()
        };
        Ok(Benchmark {
            train: overrides.resolve(&file)?,
            protocol: self.protocol,
            data: values::absolute(&self.data)?,
            device: choice.to_string(),
            drop_cameras: self.drop_cameras.clone(),
        })
    }
}

pub fn run(args: &BenchmarkArgs, shared: &Shared) -> Result<String, Failure> {
    let files = args.lpips.files();
    files.check()?;
    let choice = shared.device.unwrap_or_default().resolved();
    let device = choice.device()?;
    let found = find_scenes(args.protocol.protocol(), &args.data, &args.scenes)?;
    let benchmark = args.benchmark(choice)?;
    let perceptual = files.load(&device)?;
    let asked = stop::Asked::default();
    let options = RunOptions {
        seeds: args.seeds,
        memory: args.memory,
        perceptual: &perceptual,
        stop: &|| asked.now(),
    };
    let mut told = Told::new(&benchmark, &found, shared);
    stop::set_way_on(Some(WAY_ON.into()));
    let outcome = benchmark.run(&found, &args.out, &device, &options, &mut told);
    told.progress.end();
    let runs = unless_stopped(outcome, asked, WAY_ON)?;
    written(&benchmark, &found, &runs, &args.out)
}

/// Writes the plan of what [`run`] does.
pub fn plan(args: &BenchmarkArgs, shared: &Shared) -> Result<Plan, Failure> {
    let files = args.lpips.absolute_files()?;
    files.check()?;
    let found = find_scenes(args.protocol.protocol(), &args.data, &args.scenes)?;
    let benchmark = args.benchmark(shared.device.unwrap_or_default().resolved())?;
    benchmark.prepare(&found)?;
    benchmark.claim(&args.out)?;
    let scenes = found.scenes.iter();
    let scenes = scenes.map(|(scene, _)| scene.name.to_string()).collect();
    let plan = Plan::new(Work::Benchmark { scenes }, args.seeds, args.memory, files);
    plan.write(&args.out)?;
    Ok(plan)
}

/// Does tasks of a plan.
pub fn work(
    (plan, scenes): (&Plan, &[String]),
    which: Which,
    out: &Path,
    on: &On<'_>,
    shared: &Shared,
) -> Result<Tally, Error> {
    let mut benchmark = Benchmark::read(out)?;
    benchmark.device = on.choice.to_string();
    let found = find_scenes(benchmark.protocol.protocol(), &benchmark.data, scenes)?;
    let prepared = benchmark.prepare(&found)?;
    let options = RunOptions {
        seeds: plan.seeds,
        memory: plan.memory,
        perceptual: on.perceptual,
        stop: on.stop,
    };
    let mut told = Told::new(&benchmark, &found, shared);
    let mut present: Option<(usize, SceneToTrain)> = None;
    let tally = plan.work(out, which, on.stop, &mut |number| {
        let (place, seed) = plan.of_task(number)?;
        let (scene, folder) = &found.scenes[place];
        let of_scene = match &mut present {
            Some((of, scene)) if *of == place => scene,
            other => {
                told.scene(scene, &prepared[place]);
                let folder = folder.as_path();
                let new = SceneToTrain::new(&benchmark, (*scene, folder), &prepared[place], out);
                &mut other.insert((place, new)).1
            }
        };
        of_scene.train(seed, on.device, &options, &mut told)
    });
    told.progress.end();
    tally
}

/// Puts the runs of a plan together, all of which are done.
pub fn join(plan: &Plan, scenes: &[String], out: &Path) -> Result<String, Failure> {
    let benchmark = Benchmark::read(out)?;
    let found = find_scenes(benchmark.protocol.protocol(), &benchmark.data, scenes)?;
    let prepared = benchmark.prepare(&found)?;
    let runs = finished(&found, &prepared, plan.seeds, out)?;
    written(&benchmark, &found, &runs, out)
}

/// Writes the page of a benchmark, and what to say of it.
fn written(
    benchmark: &Benchmark,
    found: &Found,
    runs: &[SceneRuns],
    out: &Path,
) -> Result<String, Failure> {
    let rows = BenchmarkRows::new(benchmark, found, runs);
    rows.write(out)?;
    page(benchmark, &rows, runs).write(out)?;
    Ok(format!(
        "{}\n{}\nwritten to {}; open {}",
        header(benchmark, &rows),
        table(benchmark, &rows, runs),
        out.display(),
        out.join("report.html").display()
    ))
}

/// Tells which run is going on, and how far it is.
struct Told<'a> {
    drops: &'a [DroppedCamera],
    /// What is told before the first scene, once nothing speaks against the benchmark.
    before: Vec<String>,
    progress: RunsProgress<'a>,
}

impl<'a> Told<'a> {
    fn new(benchmark: &'a Benchmark, found: &Found, shared: &'a Shared) -> Self {
        let pinned = pinned(benchmark).into_iter();
        let pinned = pinned.map(|(name, value)| format!("{name}: {value}"));
        let missing = found.missing.iter();
        let missing = missing.map(|scene| format!("not there: {}", scene.name));
        Self {
            drops: &benchmark.drop_cameras,
            before: pinned.chain(missing).collect(),
            progress: RunsProgress::new(shared),
        }
    }
}

impl Observer for Told<'_> {
    fn scene(&mut self, scene: &Scene, prepared: &Prepared) {
        self.progress.end();
        for line in self.before.drain(..) {
            tracing::info!("{line}");
        }
        let [width, height] = prepared.size;
        tracing::info!(
            "{}: {width}x{height}, {} frames, held out: {}",
            scene.name,
            prepared.n_frames,
            summary::listed(&prepared.held_out)
        );
        for difference in &prepared.differs {
            tracing::warn!("{}: differs from the protocol: {difference}", scene.name);
        }
        let is_dropping = |drop: &DroppedCamera| drop.scene.as_deref() == Some(scene.name);
        if let Some(caution) = scene
            .caution
            .filter(|_| !self.drops.iter().any(is_dropping))
        {
            tracing::info!("{}: {caution}", scene.name);
        }
    }

    fn begin(&mut self, scene: &Scene, seed: u64, iterations: usize) {
        self.progress.end();
        tracing::info!("training {}, seed {seed}, {iterations} steps", scene.name);
        self.progress.begin(iterations);
    }

    fn step(&mut self, report: &StepReport, seconds: f64) {
        self.progress.step(report, seconds);
    }
}

/// What is pinned, which scenes are missing, and in what the others differ.
fn header(benchmark: &Benchmark, rows: &BenchmarkRows) -> String {
    let mut table = Table::default();
    for (name, value) in pinned(benchmark) {
        table.row(name, value);
    }
    if !rows.missing.is_empty() {
        table.row("not there", rows.missing.join(", "));
    }
    for row in &rows.scenes {
        if !row.differs.is_empty() {
            table.row(
                "differs",
                format!("{}: {}", row.scene, row.differs.join("; ")),
            );
        }
    }
    table.text()
}

/// One line per scene: medians over its seeds, and the best that is published.
fn table(benchmark: &Benchmark, rows: &BenchmarkRows, runs: &[SceneRuns]) -> String {
    let protocol = benchmark.protocol.protocol();
    let mut lines = vec![
        "scene            seeds  minutes   PSNR   SSIM  LPIPS    fps      MB  Gaussians  best published PSNR"
            .to_string(),
    ];
    for (row, own) in rows.scenes.iter().zip(runs) {
        let others = published_figures(protocol, &row.scene);
        let seeds = own.runs.len().to_string();
        lines.push(line(&row.scene, &seeds, &row.figures, &others));
    }
    lines.push(line("mean", "", &rows.mean, &rows.published_means()));
    if !rows.is_whole {
        lines.push(format!(
            "the mean is over {} of {} scenes, and so is the published one beside it",
            rows.scenes.len(),
            protocol.scenes.len()
        ));
    }
    lines.join("\n")
}

fn line(name: &str, seeds: &str, figures: &Figures, others: &[Beside]) -> String {
    let shown = |value: Option<f64>, digits: usize| {
        value.map_or("-".to_string(), |value| format!("{value:.digits$}"))
    };
    let with_psnr = others
        .iter()
        .filter_map(|row| Some((row.figures.psnr?, row)));
    let best = with_psnr.max_by(|(a, _), (b, _)| a.total_cmp(b));
    format!(
        "{name:16} {seeds:>5} {:>8} {:>6} {:>6} {:>6} {:>6} {:>7} {:>10}  {}",
        shown(figures.minutes, 1),
        shown(figures.psnr, 2),
        shown(figures.ssim, 3),
        shown(figures.lpips_alex.or(figures.lpips_vgg), 3),
        shown(figures.fps, 1),
        shown(figures.megabytes, 1),
        shown(figures.gaussians, 0),
        best.map_or("-".into(), |(psnr, row)| format!(
            "{psnr:.2}, {}",
            row.system
        )),
    )
}
