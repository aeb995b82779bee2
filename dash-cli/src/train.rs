//! `dash train`: a dataset into a run's folder.

mod resume;
mod told;

use std::cell::Cell;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use clap::Args;
use dash_train::Error;
use dash_train::compare::Method;
use dash_train::dataset::{Dataset, Partition};
use dash_train::device::DeviceChoice;
use dash_train::evaluate::{CurveProbe, PerceptualFiles};
use dash_train::process::stop;
use dash_train::results::Process;
use dash_train::train::{
    Additions, Budget, FirstPoints, Keep, OnTrial, RunConfig, RunFolder, StepReport, TrainOptions,
    Trainer, check_dataset, train,
};
use dash_train::windows::{LENGTH, Windows};
use tracing::subscriber::NoSubscriber;

use crate::Shared;
use crate::configuration::{ConfigFile, Overrides, ValueArgs};
use crate::data::DataArgs;
use crate::failure::Failure;
use crate::lpips::LpipsArgs;
use crate::progress::{RunsProgress, TrainProgress};
use crate::summary::{self, duration};
use crate::values;
use crate::values::WindowChoice;
use crate::watch::{Door, WatchArgs};
use crate::windows::Clip;
use resume::take_up;
use told::{finish, resume, score, stopped_by, waited_for_images};

/// Train a scene on a dataset; then score it on the test views
#[derive(Args)]
#[command(after_help = "Examples:
  dash train out/room --out runs/room --preset quick
  dash train flame_steak --out runs/steak --downscale 2 --test-cameras 0 --set dssim=0.1
  dash train out/room --out runs/room --resume
  dash train recording --out runs/recording --window 60

RUN/config.toml holds every value that was used; its keys are those of --set and --config, and
`--config RUN/config.toml` trains the same again. With --resume DATASET may be the folder that the run's dataset
was moved to, which config.toml then names.")]
pub struct TrainArgs {
    /// The dataset's folder, in any of the layouts of --layout
    dataset: PathBuf,
    /// The run's folder to make; must not exist, or be empty
    #[arg(long, value_name = "RUN")]
    out: PathBuf,
    /// Another method in place of the preset's, as `dash compare` trains it
    #[arg(long, value_enum, conflicts_with = "resume")]
    method: Option<Method>,
    #[command(flatten)]
    values: ValueArgs,
    /// Optimisation steps
    #[arg(long, value_name = "N", value_parser = values::count, allow_negative_numbers = true)]
    iterations: Option<usize>,
    /// How long training may take, such as 20min: as many steps as short trials find to fit, their time included.
    /// Scores come after it
    #[arg(long, value_name = "TIME", value_parser = values::seconds, conflicts_with_all = ["iterations", "resume"])]
    budget: Option<f64>,
    #[command(flatten)]
    data: DataArgs,
    /// A run of the same place, such as of the empty room: its static Gaussians are kept where the pictures agree; only
    /// others are trained
    #[arg(long, value_name = "RUN", conflicts_with_all = ["window", "resume"])]
    backdrop: Option<PathBuf>,
    /// Whether parts that the scene does not need are left out; RUN/config.toml says which were, and why
    /// [default: the preset's]
    #[arg(long, value_enum)]
    keep: Option<Keep>,
    /// Seed of everything random [default: 0]
    #[arg(long, value_name = "S")]
    seed: Option<u64>,
    /// Score up to 12 test views N times along the way, for `dash report`: RUN/curve.jsonl. Costs time
    /// outside the clock of training, and chooses nothing
    #[arg(long, value_name = "N", default_value_t = 0, hide_default_value = true)]
    curve: usize,
    /// Continue the run in RUN from its newest checkpoint, with its own configuration
    #[arg(long)]
    resume: bool,
    /// Train a long clip in windows of N frames, each a run of its own below RUN; `render` and `view` show them as one clip.
    /// The same command again goes on with what is not done
    /// [default: 60 for more than 300 frames of synchronised cameras, some of them held out; else none]
    #[arg(long, value_name = "N|none", value_parser = values::window, conflicts_with_all = ["resume", "method", "curve"])]
    window: Option<WindowChoice>,
    /// Frames, at least, that neighbouring windows share [default: an eighth of a window]
    #[arg(long, value_name = "N", requires = "window")]
    overlap: Option<usize>,
    /// Whether windows share a room that is trained before them [default: if there are nine or more]
    #[arg(long, value_name = "YES|NO", value_parser = values::yes_or_no, requires = "window")]
    room: Option<bool>,
    #[command(flatten)]
    lpips: LpipsArgs,
    #[command(flatten)]
    pub watch: WatchArgs,
}

pub fn run(args: &TrainArgs, shared: &Shared) -> Result<String, Failure> {
    run_with(args, shared, None)
}

/// As [`run`], with a window where there is a door for it.
pub fn run_with(args: &TrainArgs, shared: &Shared, door: Option<Door>) -> Result<String, Failure> {
    // What only the scores at the end need is missed before the training.
    let perceptual = args.lpips.files();
    perceptual.check()?;
    args.watch.check()?;
    let overrides = Overrides {
        iterations: args.iterations,
        seed: args.seed,
        keep: args.keep,
        ..args.values.overrides()
    };
    let file = ConfigFile::read(args.values.config.as_deref())?;
    let window = match args.window {
        Some(WindowChoice(frames)) => frames,
        None => {
            // Mistakes in the arguments are told before the data are looked at.
            overrides.resolve(&file)?;
            default_window(args, shared, &file)?
        }
    };
    if let Some(window) = window {
        return train_windows(args, window, overrides, shared);
    }
    let begun = if args.resume {
        take_up(args, shared, &overrides, &file)?
    } else {
        start(args, shared, &overrides, &file)?
    };
    train_run(args, shared, door, begun, &perceptual)
}

/// A run that is to be trained.
struct Begun {
    run: RunFolder,
    config: RunConfig,
    dataset: Arc<Dataset>,
    /// What trials have found.
    first_points: FirstPoints,
}

/// Trains a run, and scores it.
fn train_run(
    args: &TrainArgs,
    shared: &Shared,
    door: Option<Door>,
    begun: Begun,
    perceptual: &PerceptualFiles,
) -> Result<String, Failure> {
    let Begun {
        run,
        config,
        dataset,
        first_points,
    } = begun;
    let choice: DeviceChoice = config
        .data
        .device
        .parse()
        .map_err(|e| Failure::new(format!("{}: data.device: {e}", args.out.display())))?;
    let device = choice.device()?;
    let mut progress = TrainProgress::new(config.train.iterations, shared);
    stop::set_way_on(Some(resume(args)));
    let asked = stop::Asked::default();
    let stop = || asked.now();
    let watchers = args.watch.start(&run, &dataset, &device, door)?;
    let has_trained = Cell::new(false);
    let on_step = &mut |report: &StepReport, secs| {
        has_trained.set(true);
        progress.step(report, secs);
        watchers.step(report, secs, config.train.iterations);
    };
    let watch = &mut |trainer: &Trainer| watchers.look(&run, trainer, &stop);
    let options = TrainOptions {
        resume: args.resume,
        curve: args.curve,
        on_step,
        watch: Some(watch),
        clock: None,
        stop: &stop,
        additions: Additions {
            first_points,
            ..Default::default()
        },
    };
    let trained = train(&run, &config.train, dataset.clone(), &device, options);
    progress.finish();
    if let Some(signal) = asked.end() {
        let told = stopped_by(signal.name(), args, trained.err());
        return Err(Failure::stopped(signal, told));
    }
    let (trainer, secs) = trained?;
    stop::set_way_on(Some(score(args)));
    let waiting = trainer
        .waited_seconds()
        .map(|waited| waited_for_images(waited, secs));
    drop(trainer);
    watchers.finish(&run, config.train.iterations, &device)?;
    let device = (&device, config.data.device.as_str());
    let process = match has_trained.get() {
        true => Process::Trained,
        false => {
            tracing::info!("all {} steps were done before", config.train.iterations);
            Process::Evaluates
        }
    };
    let told = finish(&run, &config, &dataset, device, (secs, process), perceptual)?;
    Ok(told + &waiting.unwrap_or_default())
}

/// The frames of a window, where nobody says whether there are any.
fn default_window(
    args: &TrainArgs,
    shared: &Shared,
    file: &ConfigFile,
) -> Result<Option<usize>, Failure> {
    let is_one = args.resume || args.method.is_some() || args.budget.is_some() || args.curve > 0;
    let is_part = args.data.frames.or(file.data.frames).is_some();
    let has_backdrop = args.backdrop.is_some() || file.data.backdrop.is_some();
    if is_one || is_part || has_backdrop || args.watch.is_asked() {
        return Ok(None);
    }
    let choice = shared.device.unwrap_or_default().resolved();
    // What is to be told of the dataset is told when it is loaded to be trained on.
    let look = || args.data.look(&args.dataset, &file.data, choice);
    let looked = tracing::subscriber::with_default(NoSubscriber::default(), look);
    let Some((_, dataset)) = looked.ok().filter(|(_, dataset)| Windows::suit(dataset)) else {
        return Ok(None);
    };
    tracing::info!(
        "{} frames: trained in windows of {LENGTH}; --window none trains them as one",
        dataset.n_frames
    );
    Ok(Some(LENGTH))
}

/// A long clip in windows of time.
fn train_windows(
    args: &TrainArgs,
    window: usize,
    overrides: Overrides<'_>,
    shared: &Shared,
) -> Result<String, Failure> {
    if args.watch.is_asked() {
        return Err(Failure::usage(
            "--window: a run that is watched has one window; leave out --view, --serve and --tensorboard",
        ));
    }
    let clip = Clip {
        dataset: &args.dataset,
        out: &args.out,
        window,
        overlap: args.overlap,
        room: args.room,
        budget: args.budget,
        overrides,
        lpips: &args.lpips,
        data: &args.data,
    };
    clip.train(shared)
}

/// Checks everything that can be checked, and only then makes the run's folder.
fn start(
    args: &TrainArgs,
    shared: &Shared,
    overrides: &Overrides<'_>,
    file: &ConfigFile,
) -> Result<Begun, Failure> {
    let train = overrides.resolve(file)?;
    let train = args
        .method
        .map_or(train.clone(), |method| method.of(&train));
    let choice = shared.device.unwrap_or_default().resolved();
    let device = choice.device()?;
    let (mut data, dataset) = args.data.load(&args.dataset, &file.data, choice)?;
    let folder = args.values.config.as_deref().and_then(Path::parent);
    let in_file = file.data.backdrop.as_deref();
    let in_file = in_file.map(|backdrop| folder.unwrap_or(Path::new("")).join(backdrop));
    if let Some(backdrop) = args.backdrop.clone().or(in_file) {
        RunFolder::open(&backdrop)?.scene(&device)?;
        data.backdrop = Some(values::absolute(&backdrop)?);
    }
    if args.curve > 0 {
        CurveProbe::check(&dataset)?;
    }
    check_dataset(&dataset)?;
    let mut config = RunConfig::new(data, train);
    let dataset = Arc::new(dataset);
    let first_points = FirstPoints::default();
    if let Some(budget) = args.budget {
        RunFolder::check_free(&args.out)?;
        let of_one = Budget {
            first_points: Some(first_points.clone()),
            ..Budget::of_one(budget)
        };
        let find = |tell: OnTrial<'_>| of_one.steps(&config.train, &dataset, &device, tell);
        config.train.iterations = steps_of(budget, shared, find)?;
        config.train.visits = None;
    } else {
        let asked = config.train.iterations;
        config.train.iterations = config.train.steps_for(&dataset);
        if let (Some(visits), true) = (config.train.visits, config.train.iterations > asked) {
            tracing::info!(
                "{} steps instead of {asked}: {visits} for each training view; --iterations or --budget choose others",
                config.train.iterations,
            );
        }
    }
    let run = RunFolder::create(&args.out, &config)?;
    tell_held_out(&dataset);
    Ok(Begun {
        run,
        config,
        dataset,
        first_points,
    })
}

/// The steps that trials find to fit into a budget of seconds.
pub fn steps_of(
    budget: f64,
    shared: &Shared,
    find: impl FnOnce(OnTrial<'_>) -> Result<usize, Error>,
) -> Result<usize, Error> {
    let mut progress = RunsProgress::new(shared);
    let steps = find(&mut |n, step| match step {
        None => {
            progress.begin(n);
            tracing::info!("trial of {n} steps");
        }
        Some((report, secs)) => progress.step(report, secs),
    })?;
    progress.end();
    tracing::info!("{} are {steps} steps", duration(budget));
    Ok(steps)
}

/// Says which cameras are held out.
fn tell_held_out(dataset: &Dataset) {
    let views = dataset.views_of(Partition::Test);
    let names: BTreeMap<usize, &str> = views
        .map(|view| (view.camera_index, view.camera_name.as_str()))
        .collect();
    if !names.is_empty() {
        let names: Vec<&str> = names.into_values().collect();
        tracing::info!("held out: {}", summary::listed(&names));
    }
}
