//! `dash train --window` and `dash plan train`: a long clip in windows of time.

use std::path::{Path, PathBuf};
use std::time::Instant;

use clap::Args;
use dash_model::DynamicScene;
use dash_train::Error;
use dash_train::dataset::FrameRange;
use dash_train::device::DeviceChoice;
use dash_train::jobs::{Plan, Tally, Which, Work};
use dash_train::results::scored;
use dash_train::train::{OnTrial, RunFolder, StepReport};
use dash_train::windows::{ClipRun, LENGTH, MIN_STEPS, Observer, RunOptions, Windows};

use crate::Shared;
use crate::configuration::{ConfigFile, Overrides, ValueArgs};
use crate::data::DataArgs;
use crate::failure::Failure;
use crate::lpips::LpipsArgs;
use crate::progress::RunsProgress;
use crate::summary;
use crate::train::steps_of;
use crate::values;
use crate::work::{self, On, WorkArgs};

/// A long clip in windows of time, each of which is trained by itself
#[derive(Args)]
#[command(after_help = "Example:
  dash plan train recording --window 60 --out runs/recording

Each window is a run on some of the clip's frames, runs/recording/window-NNN. Every command that takes a run
takes each of them. `dash render`, `dash view`, `dash eval` and `dash export` take the folder of all, too, as one clip in which windows
fade into each other.")]
pub struct PlanTrainArgs {
    /// The dataset's folder, in any of the layouts of `dash train`
    dataset: PathBuf,
    /// The folder of the windows
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Frames of a window
    #[arg(long, value_name = "N", default_value_t = LENGTH)]
    window: usize,
    /// Frames, at least, that neighbours share [default: an eighth of a window]
    #[arg(long, value_name = "N")]
    overlap: Option<usize>,
    /// Whether windows share a room that is trained before them [default: if there are nine or more]
    #[arg(long, value_name = "YES|NO", value_parser = values::yes_or_no)]
    room: Option<bool>,
    #[command(flatten)]
    values: ValueArgs,
    /// Optimisation steps of each window [default: they share the steps of the whole clip, 1,000 each at least]
    #[arg(long, value_name = "N", value_parser = values::count, allow_negative_numbers = true)]
    iterations: Option<usize>,
    /// Seed of everything random [default: 0]
    #[arg(long, value_name = "S")]
    seed: Option<u64>,
    #[command(flatten)]
    lpips: LpipsArgs,
    #[command(flatten)]
    data: DataArgs,
}

impl PlanTrainArgs {
    /// The folder of the windows.
    pub fn out(&self) -> &Path {
        &self.out
    }
}

/// Writes the plan.
pub fn plan(args: &PlanTrainArgs, shared: &Shared) -> Result<Plan, Failure> {
    let overrides = Overrides {
        iterations: args.iterations,
        seed: args.seed,
        ..args.values.overrides()
    };
    let clip = Clip {
        dataset: &args.dataset,
        out: &args.out,
        window: args.window,
        overlap: args.overlap,
        room: args.room,
        budget: None,
        overrides,
        lpips: &args.lpips,
        data: &args.data,
    };
    clip.plan(shared)
}

/// A long clip, and how it is divided and trained.
pub struct Clip<'a> {
    pub dataset: &'a Path,
    pub out: &'a Path,
    /// Frames of a window.
    pub window: usize,
    /// Frames, at least, that neighbours share.
    pub overlap: Option<usize>,
    /// Whether windows share a room that is trained before them; `None`: if there are many.
    pub room: Option<bool>,
    /// Seconds that training may take, where that gives the steps.
    pub budget: Option<f64>,
    pub overrides: Overrides<'a>,
    pub lpips: &'a LpipsArgs,
    pub data: &'a DataArgs,
}

impl Clip<'_> {
    /// Plans the windows, trains one after the other, and tells their scores. What is done already is not done again.
    pub fn train(&self, shared: &Shared) -> Result<String, Failure> {
        let begin = Instant::now();
        let plan = self.plan(shared)?;
        if let (Some(budget), Some(room)) = (self.budget, plan.needed()) {
            work::run(&WorkArgs::one(self.out, room), shared)?;
            self.share_out(budget, begin, shared)?;
        }
        let tasks = work::run(&WorkArgs::all(self.out), shared)?;
        Ok(format!("{tasks}\n{}", join(self.out)?))
    }

    fn plan(&self, shared: &Shared) -> Result<Plan, Failure> {
        let file = ConfigFile::read(self.overrides.file)?;
        let train = self.overrides.resolve(&file)?;
        let files = self.lpips.absolute_files()?;
        files.check()?;
        if self.data.frames.or(file.data.frames).is_some() {
            return Err(Failure::usage(
                "--frames: expected a whole clip to divide into windows; leave it out",
            ));
        }
        let choice = shared.device.unwrap_or_default().resolved();
        let mut whole = self.data.clone();
        whole.frames = Some(FrameRange::All);
        let (data, dataset) = whole.look(self.dataset, &file.data, choice)?;
        let overlap = self.overlap.unwrap_or((self.window / 8).max(1));
        let sizes = [self.window, overlap];
        let mut windows = Windows::new(&dataset, data, train, sizes, self.room)?;
        drop(dataset);
        if let Some(budget) = self.budget {
            self.set_steps(&mut windows, budget, choice, shared)?;
        }
        windows.claim(self.out)?;
        let work = Work::Windows {
            windows: windows.windows.len(),
            room: windows.room.is_some(),
        };
        let plan = Plan::new(work, 1, self.data.memory, files);
        plan.write(self.out)?;
        Ok(plan)
    }

    /// Sets the steps that fit into a budget, or those that were found when the clip was planned first.
    fn set_steps(
        &self,
        windows: &mut Windows,
        budget: f64,
        choice: DeviceChoice,
        shared: &Shared,
    ) -> Result<(), Failure> {
        if Windows::are_in(self.out) {
            let found = Windows::read(self.out)?;
            windows.set_iterations(found.train.iterations);
            windows.room = found.room;
            return Ok(());
        }
        RunFolder::check_free(self.out)?;
        let steps = self.steps_within(budget, windows, None, choice, shared)?;
        windows.set_iterations(steps);
        if windows.room.is_none() {
            warn_of_few(steps);
        }
        Ok(())
    }

    /// Gives the windows the steps that fit into what the room has left of a budget, unless one of them has begun: what a step
    /// of theirs costs is known once the room is there.
    fn share_out(&self, budget: f64, begin: Instant, shared: &Shared) -> Result<(), Failure> {
        let mut windows = Windows::read(self.out)?;
        let folder = |run: ClipRun| self.out.join(run.run_name());
        let has_begun = |run: ClipRun| run != ClipRun::Room && folder(run).exists();
        if windows.runs().any(has_begun) {
            return Ok(());
        }
        let choice = shared.device.unwrap_or_default().resolved();
        let Some((room, results)) = scored(&folder(ClipRun::Room))? else {
            return Ok(());
        };
        let before = results.train_seconds.unwrap_or_default();
        let left = (budget - begin.elapsed().as_secs_f64().max(before)).max(0.0);
        let room = room.scene(&choice.device()?)?;
        let steps = self.steps_within(left, &windows, Some(&room), choice, shared)?;
        warn_of_few(steps);
        windows.train.iterations = steps;
        Ok(windows.rewrite(self.out)?)
    }

    fn steps_within(
        &self,
        secs: f64,
        windows: &Windows,
        room: Option<&DynamicScene>,
        choice: DeviceChoice,
        shared: &Shared,
    ) -> Result<usize, Failure> {
        let (device, name) = (choice.device()?, choice.to_string());
        let on = (&device, name.as_str());
        let memory = self.data.memory;
        let find = |tell: OnTrial<'_>| windows.steps_within(secs, room, memory, on, tell);
        Ok(steps_of(secs, shared, find)?)
    }
}

/// Warns where a window gets few steps.
fn warn_of_few(steps: usize) {
    if steps < MIN_STEPS {
        tracing::warn!(
            "a window of {steps} steps shows little: expected {MIN_STEPS} or more; give more time, or train the clip as one \
             with --window none"
        );
    }
}

/// Does tasks of a plan.
pub fn work(
    plan: &Plan,
    which: Which,
    out: &Path,
    on: &On<'_>,
    shared: &Shared,
) -> Result<Tally, Error> {
    let windows = Windows::read(out)?;
    let name = on.choice.to_string();
    let options = RunOptions {
        perceptual: on.perceptual,
        memory: plan.memory,
        device: (on.device, &name),
        stop: on.stop,
    };
    let mut told = Told {
        windows: &windows,
        progress: RunsProgress::new(shared),
    };
    let runs: Vec<ClipRun> = windows.runs().collect();
    let tally = plan.work(out, which, on.stop, &mut |number| {
        windows.run_one(runs[number], out, &options, &mut told)
    });
    told.progress.end();
    tally
}

/// Tells which window is trained, and how far it is.
struct Told<'a> {
    windows: &'a Windows,
    progress: RunsProgress<'a>,
}

impl Observer for Told<'_> {
    fn begin(&mut self, run: ClipRun, iterations: usize) {
        self.progress.end();
        let frames = frames(self.windows, run);
        tracing::info!(
            "training {}, frames {frames} of {}, {iterations} steps",
            run.run_name(),
            self.windows.n_frames
        );
        self.progress.begin(iterations);
    }

    fn step(&mut self, report: &StepReport, seconds: f64) {
        self.progress.step(report, seconds);
    }
}

/// The frames of a run, as people say it.
fn frames(windows: &Windows, run: ClipRun) -> String {
    match (run, windows.room) {
        (ClipRun::Window(number), _) => {
            let window = &windows.windows[number];
            format!("{} to {}", window.first, window.last)
        }
        (ClipRun::Room, Some(room)) => format!("0, {}, ..", room.every),
        (ClipRun::Room, None) => String::new(),
    }
}

/// The scores of the windows, all of which are trained.
pub fn join(out: &Path) -> Result<String, Failure> {
    let windows = Windows::read(out)?;
    let mut lines = vec![format!(
        "{:<11} {:<12} {:>6} {:>7} {:>6} {:>7} {:>6} {:>8} + {:<7} {:>9}",
        "window", "frames", "steps", "secs", "PSNR", "moving", "SSIM", "static", "dynamic", "size"
    )];
    let mut sums = Sums::default();
    for run in windows.runs() {
        let name = run.run_name();
        let Some((_, results)) = scored(&out.join(&name))? else {
            return Err(Failure::new(format!(
                "{}: is not scored",
                out.join(&name).display()
            )));
        };
        let scores = &results.evaluation;
        let shown = |value: Option<f64>, digits: usize| {
            value.map_or("-".to_string(), |value| format!("{value:.digits$}"))
        };
        lines.push(format!(
            "{name:<11} {:<12} {:>6} {:>7} {:>6} {:>7} {:>6} {:>8} + {:<7} {:>9}",
            frames(&windows, run),
            results.iterations,
            shown(results.train_seconds, 1),
            shown(scores.psnr, 2),
            shown(scores.psnr_dynamic, 2),
            shown(scores.ssim, 3),
            scores.n_static,
            scores.n_dynamic,
            summary::bytes(results.storage_bytes),
        ));
        if let ClipRun::Window(number) = run {
            let n_frames = windows.windows[number].n_frames();
            sums.add(n_frames, scores.psnr, scores.psnr_dynamic);
        }
        sums.bytes += results.storage_bytes;
    }
    let [psnr, moving] = sums.means();
    lines.push(format!(
        "mean over the windows' frames: PSNR {psnr}, moving {moving}; {} together",
        summary::bytes(sums.bytes)
    ));
    let out = out.display();
    lines.push(format!(
        "as one clip: dash view {out}, dash eval {out}, or dash render {out} --cameras test"
    ));
    Ok(lines.join("\n"))
}

/// Sums over windows, weighted by their frames.
#[derive(Default)]
struct Sums {
    scores: [(f64, f64); 2],
    bytes: u64,
}

impl Sums {
    fn add(&mut self, n_frames: usize, psnr: Option<f64>, moving: Option<f64>) {
        let weight = n_frames as f64;
        for ((sum, weights), score) in self.scores.iter_mut().zip([psnr, moving]) {
            if let Some(score) = score.filter(|score| score.is_finite()) {
                *sum += weight * score;
                *weights += weight;
            }
        }
    }

    fn means(&self) -> [String; 2] {
        self.scores.map(|(sum, weights)| match weights > 0.0 {
            true => format!("{:.2}", sum / weights),
            false => "-".into(),
        })
    }
}
