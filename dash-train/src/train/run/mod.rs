//! A run on disk: `config.toml`, `log.jsonl`, `curve.jsonl`, `checkpoints/`, `scene/`.

mod backdrop;
mod config;
mod folder;
mod lines;

use std::fs::{self, File};
use std::sync::Arc;
use std::time::Instant;

use burn::tensor::Device;
use dash_model::scene_file::TablePrecision;
use dash_model::unfinished::remove_left;

pub use self::config::{DataConfig, RunConfig, StageEnds, read_config};
pub use self::folder::RunFolder;
pub use self::lines::LogLine;
use self::lines::{Log, append, reopen_curve};
use super::config::TrainConfig;
use super::core::StepReport;
pub use super::core::checkpoint::latest_checkpoint;
use super::trainer::{Additions, Trainer, load_checkpoint_with, save_checkpoint};
use crate::Error;
use crate::dataset::Dataset;
use crate::evaluate::CurveProbe;

/// How [`train`] runs.
pub struct TrainOptions<'a> {
    /// Continue from the newest checkpoint, if there is one.
    pub resume: bool,
    /// Measurements of test views to take along the way, see [`CurveProbe`]; 0 for none.
    pub curve: usize,
    /// Called after every step, with the seconds trained so far.
    pub on_step: &'a mut dyn FnMut(&StepReport, f64),
    /// Called after every step with the trainer, outside the clock; it may wait.
    pub watch: Option<&'a mut dyn FnMut(&Trainer)>,
    /// Asked before and after every step whether to stop there, with a checkpoint.
    pub stop: &'a dyn Fn() -> bool,
    /// What the seconds of a step count for; `None`: themselves.
    pub clock: Option<Clock<'a>>,
    /// Extensions and density control of your own; the same for a run that is resumed.
    pub additions: Additions,
}

/// Turns the seconds that something took into those that it counts for.
pub type Clock<'a> = &'a mut dyn FnMut(f64) -> Result<f64, Error>;

/// Trains to the end, writing checkpoints, the log, and at last the scene.
///
/// Returns the trainer and the seconds trained (evaluation and file writing excluded, counted as the options say).
///
/// On a CPU call it on a thread of rayon's pool, as in `rayon::scope(|_| train(..))`: from outside, every parallel loop
/// wakes such a thread and waits for it, which takes a fifth of the time of small pictures.
///
/// # Errors
/// What [`Trainer::step`] and writing refuse; checkpoints written until then remain. [`Error::Stopped`] where the options
/// stop it.
pub fn train(
    run: &RunFolder,
    config: &TrainConfig,
    dataset: Arc<Dataset>,
    device: &Device,
    mut options: TrainOptions<'_>,
) -> Result<(Trainer, f64), Error> {
    let checkpoints = run.checkpoints_path();
    let mut additions = std::mem::take(&mut options.additions);
    additions.backdrop = match additions.backdrop.take() {
        None => run.room(device)?,
        given => given,
    };
    let found = match options.resume {
        true => latest_checkpoint(&checkpoints)?,
        false => None,
    };
    let (mut trainer, mut seconds) = match found {
        Some(checkpoint) => load_checkpoint_with(&checkpoint, dataset, device, additions)?,
        None => {
            let trainer = Trainer::with(config.clone(), dataset, device, additions)?;
            (trainer, 0.0)
        }
    };
    let mut log = Log::reopen(&run.log_path(), trainer.steps_done())?;
    let mut curve = reopen_curve(&run.curve_path(), &trainer, options.curve)?;
    for left in [run.root(), &run.scene_path(), &checkpoints] {
        remove_left(left).map_err(|e| Error::io(left, "tidy", e))?;
    }
    fs::create_dir_all(&checkpoints).map_err(|e| Error::io(&checkpoints, "create", e))?;
    let mut finished = None;
    let begins = trainer.steps_done();
    let mut stopped = (options.stop)();
    while !(trainer.is_finished() || stopped) {
        let start = Instant::now();
        let report = trainer.step()?;
        if report.step == begins + 1 {
            tell_of_stages(config, &trainer);
        }
        let last = trainer.is_finished();
        if last {
            finished = Some(trainer.finished()?);
        }
        let spent = start.elapsed().as_secs_f64();
        seconds += match &mut options.clock {
            Some(clock) => clock(spent)?,
            None => spent,
        };
        (options.on_step)(&report, seconds);
        log.take(&report, &mut trainer, seconds)?;
        let step = report.step;
        let due = |(probe, _): &&mut (CurveProbe, File)| probe.is_due(step) && !last;
        if let Some((probe, file)) = curve.as_mut().filter(due) {
            let scene = trainer.whole_scene();
            let scene = (&scene, TablePrecision::Single);
            let line = probe.measure(scene, step, seconds, run.root())?;
            append(file, &line, &run.curve_path())?;
        }
        if let Some(watch) = &mut options.watch {
            watch(&trainer);
        }
        stopped = (options.stop)();
        if step.is_multiple_of(trainer.config().checkpoint_interval) || last || stopped {
            save_checkpoint(&trainer, &checkpoints, seconds)?;
        }
    }
    if stopped {
        return Err(Error::Stopped {
            run: run.root().to_path_buf(),
            step: trainer.steps_done(),
        });
    }
    // A run that was resumed at its end has done that before, outside this clock.
    let finished = match finished {
        Some(finished) => finished,
        None => trainer.finished()?,
    };
    let (scene, precision) = (&finished.scene, finished.precision);
    if let Some(backdrop) = &trainer.run.backdrop {
        run.write_kept(backdrop)?;
    }
    scene.save_with(&run.scene_path(), precision)?;
    run.record(&trainer, finished.decisions)?;
    // The last line is about what is left of the scene.
    if let Some((probe, file)) = &mut curve {
        let step = trainer.steps_done();
        let scene = trainer.run.whole(scene);
        let line = probe.measure((&scene, precision), step, seconds, run.root())?;
        append(file, &line, &run.curve_path())?;
    }
    Ok((trainer, seconds))
}

/// Says so where a run's stages are not those that were asked for.
fn tell_of_stages(config: &TrainConfig, trainer: &Trainer) {
    let [warmup, end] = config.method.stages;
    let following = config.extensions.following.as_ref();
    let is_rig = trainer.run.suits_scene_flow();
    let handover = following.map_or(1.0, |following| following.handover_of(is_rig));
    let asked = [warmup, warmup + handover * (end - warmup), end];
    let taken = trainer.run.method.stage_shares();
    if !trainer.run.may_move() {
        return;
    }
    let percent = |share: f32| (100.0 * share).round();
    let names = [
        "the warm-up ends",
        "following motion ends",
        "the decomposition ends",
    ];
    let changes: Vec<String> = names
        .into_iter()
        .zip(asked.into_iter().zip(taken))
        .map(|(name, (asked, taken))| (name, percent(asked), percent(taken)))
        .filter(|(_, asked, taken)| asked != taken)
        .map(|(name, asked, taken)| format!("{name} after {taken} % instead of {asked} %"))
        .collect();
    let changes = changes.join(", ");
    let steps = config.iterations;
    match is_rig {
        _ if changes.is_empty() => {}
        true => tracing::debug!("stages of {steps} steps of a rig: {changes}"),
        false => tracing::info!(
            "{steps} steps are few: {changes} (extensions.following.min_steps=0 keeps the stages)"
        ),
    }
}
