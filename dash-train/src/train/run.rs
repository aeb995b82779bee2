//! A run on disk: `config.toml`, `log.jsonl`, `curve.jsonl`, `checkpoints/`, `scene/`.

mod config;

use std::fs::{self, File};
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

use burn::tensor::Device;
pub use config::{DataConfig, RunConfig, StageEnds, read_config};
use dash_model::DynamicScene;
use dash_model::scene_file::{TablePrecision, write_atomically};

use super::checkpoint::{check_moved, latest_checkpoint, load_checkpoint, save_checkpoint};
use super::coarse::Stages;
use super::config::{StageConfig, TrainConfig};
use super::leave_out::Decision;
use super::lines::{LogLine, append, read_lines, reopen_curve, reopen_log};
use super::trainer::{StepReport, Trainer};
use crate::TrainError;
use crate::dataset::{Dataset, Partition};
use crate::evaluate::{CurveLine, CurveProbe};

/// Steps between two lines of `log.jsonl`.
const LOG_INTERVAL: usize = 50;

/// A run's folder.
#[derive(Debug, Clone)]
pub struct RunFolder {
    root: PathBuf,
}

impl RunFolder {
    /// The folder of a run that exists.
    ///
    /// # Errors
    /// When there is no `config.toml` in it.
    pub fn open(root: &Path) -> Result<Self, TrainError> {
        let run = Self {
            root: root.to_path_buf(),
        };
        if !run.config_path().is_file() {
            return Err(TrainError::run(
                root,
                "expected a run's folder with config.toml in it, found none; \
                 make one with `dash train DATASET --out RUN`",
            ));
        }
        Ok(run)
    }

    /// A new run's folder with its configuration.
    ///
    /// # Errors
    /// When something is there already, or the folder can't be written.
    pub fn create(root: &Path, config: &RunConfig) -> Result<Self, TrainError> {
        let run = Self {
            root: root.to_path_buf(),
        };
        let occupied = match fs::read_dir(root) {
            // A run that was killed before its first file was complete left a scratch file only.
            Ok(entries) => entries
                .filter_map(Result::ok)
                .any(|entry| entry.path().extension() != Some("partial".as_ref())),
            Err(e) if e.kind() == std::io::ErrorKind::NotFound => false,
            Err(e) => return Err(TrainError::io(root, "list", e)),
        };
        if occupied {
            return Err(TrainError::run(
                root,
                "expected a new or empty folder for the run, found files in it; \
                 continue that run with --resume or choose another --out",
            ));
        }
        fs::create_dir_all(root).map_err(|e| TrainError::io(root, "create", e))?;
        run.write_config(config)?;
        Ok(run)
    }

    fn write_config(&self, config: &RunConfig) -> Result<(), TrainError> {
        let text = toml::to_string(config).map_err(|e| TrainError::Config(e.to_string()))?;
        write_atomically(&self.config_path(), |mut file| {
            file.write_all(text.as_bytes())
        })?;
        Ok(())
    }

    /// Adds to `config.toml` how a finished run went, and what its scene kept and left out.
    fn record(&self, trainer: &Trainer, decisions: Vec<Decision>) -> Result<(), TrainError> {
        let mut config = self.config()?;
        config.decisions = decisions;
        config.stage_ends = trainer.may_move().then(|| {
            let stages = Stages::of(trainer);
            StageEnds {
                warmup: stages.warmup,
                decomposition: stages.end,
            }
        });
        self.write_config(&config)
    }

    /// Has `config.toml` name the folder of `dataset` as that of the run's dataset, which was moved there.
    ///
    /// # Errors
    /// When the newest checkpoint says that it is another dataset, when the run is finished and there is no
    /// checkpoint that could say so, or when the file can't be written.
    pub fn follow_dataset(&self, dataset: &Dataset) -> Result<(), TrainError> {
        let mut config = self.config()?;
        let from = &config.data.dataset;
        match latest_checkpoint(&self.checkpoints_path())? {
            Some(checkpoint) => check_moved(&checkpoint, dataset, from)?,
            None if self.scene_path().exists() => {
                return Err(TrainError::run(
                    &dataset.root,
                    format!(
                        "expected the run's dataset {}, found another folder, and no checkpoint that tells \
                         whether it holds the same; name that one, or start another run",
                        from.display()
                    ),
                ));
            }
            None => {}
        }
        tracing::info!(
            "{}: the dataset is in {} from now on, was in {}",
            self.root.display(),
            dataset.root.display(),
            from.display()
        );
        config.data.dataset = dataset.root.clone();
        self.write_config(&config)
    }

    /// The run's configuration.
    ///
    /// # Errors
    /// When `config.toml` can't be read.
    pub fn config(&self) -> Result<RunConfig, TrainError> {
        read_config(&self.config_path())
    }

    /// The trained scene.
    ///
    /// # Errors
    /// When the run has not got that far, or its files are damaged.
    pub fn scene(&self, device: &Device) -> Result<DynamicScene, TrainError> {
        let folder = self.scene_path();
        if !folder.join("scene.json").is_file() {
            return Err(TrainError::run(
                &self.root,
                "expected a trained scene, found an unfinished run; \
                 finish it with `dash train DATASET --out RUN --resume`",
            ));
        }
        Ok(DynamicScene::load(&folder, device)?)
    }

    /// The folder itself.
    pub fn root(&self) -> &Path {
        &self.root
    }

    /// `scene/`.
    pub fn scene_path(&self) -> PathBuf {
        self.root.join("scene")
    }

    /// `checkpoints/`.
    pub fn checkpoints_path(&self) -> PathBuf {
        self.root.join("checkpoints")
    }

    /// `results.json`, the scores of test views.
    pub fn results_path(&self) -> PathBuf {
        self.root.join("results.json")
    }

    /// The scores of a split's views: `results.json`, of those trained on `results_train.json`.
    pub fn scores_path(&self, split: Partition) -> PathBuf {
        match split {
            Partition::Test => self.results_path(),
            Partition::Train => self.root.join("results_train.json"),
        }
    }

    /// `log.jsonl`.
    pub fn log_path(&self) -> PathBuf {
        self.root.join("log.jsonl")
    }

    /// `curve.jsonl`.
    pub fn curve_path(&self) -> PathBuf {
        self.root.join("curve.jsonl")
    }

    fn config_path(&self) -> PathBuf {
        self.root.join("config.toml")
    }

    /// Lines of `log.jsonl`; one that was cut off while being written does not count.
    ///
    /// # Errors
    /// When the file can't be read.
    pub fn log(&self) -> Result<Vec<LogLine>, TrainError> {
        read_lines(&self.log_path())
    }

    /// Lines of `curve.jsonl`, none when the run was made without; one that was cut off while being
    /// written does not count.
    ///
    /// # Errors
    /// When the file can't be read.
    pub fn curve(&self) -> Result<Vec<CurveLine>, TrainError> {
        read_lines(&self.curve_path())
    }
}

/// How [`train`] runs.
pub struct TrainOptions<'a> {
    /// Continue from the newest checkpoint, if there is one.
    pub resume: bool,
    /// Measurements of test views to take along the way, see [`CurveProbe`]; 0 for none.
    pub curve: usize,
    /// Called after every step, with the seconds trained so far.
    pub on_step: &'a mut dyn FnMut(&StepReport, f64),
    /// What the seconds of a step count for; `None`: themselves.
    pub pace: Option<Pace<'a>>,
}

/// Turns the seconds that something took into those that it counts for.
pub type Pace<'a> = &'a mut dyn FnMut(f64) -> Result<f64, TrainError>;

/// Trains to the end, writing checkpoints, the log, and at last the scene.
///
/// Returns the trainer and the seconds trained (evaluation and file writing excluded, paced as the options say).
///
/// On a CPU call it on a thread of rayon's pool, as in `rayon::scope(|_| train(..))`: from outside, every parallel loop
/// wakes such a thread and waits for it, which takes a fifth of the time of small pictures.
///
/// # Errors
/// What [`Trainer::step`] and writing refuse; checkpoints written until then remain.
pub fn train(
    run: &RunFolder,
    config: &TrainConfig,
    dataset: Arc<Dataset>,
    device: &Device,
    mut options: TrainOptions<'_>,
) -> Result<(Trainer, f64), TrainError> {
    let checkpoints = run.checkpoints_path();
    let found = if options.resume {
        latest_checkpoint(&checkpoints)?
    } else {
        None
    };
    let (mut trainer, mut seconds) = match found {
        Some(checkpoint) => load_checkpoint(&checkpoint, dataset, device)?,
        None => (Trainer::new(config.clone(), dataset, device)?, 0.0),
    };
    let mut log = reopen_log(run, trainer.steps_done())?;
    let mut curve = reopen_curve(run, &trainer, options.curve)?;
    fs::create_dir_all(&checkpoints).map_err(|e| TrainError::io(&checkpoints, "create", e))?;
    let (mut loss, mut psnr, mut count) = (0.0, 0.0, 0);
    let mut finished = None;
    let begins = trainer.steps_done();
    while !trainer.is_finished() {
        let start = Instant::now();
        let report = trainer.step()?;
        if report.step == begins + 1 {
            tell_of_stages(config, &trainer.config().stages);
        }
        let last = trainer.is_finished();
        if last {
            finished = Some(trainer.needed_scene()?);
        }
        let spent = start.elapsed().as_secs_f64();
        seconds += match &mut options.pace {
            Some(pace) => pace(spent)?,
            None => spent,
        };
        if !report.skipped {
            loss += report.loss;
            psnr += report.psnr;
            count += 1;
        }
        (options.on_step)(&report, seconds);
        let step = report.step;
        // A line of skipped steps alone has no means and waits for more.
        if (step.is_multiple_of(LOG_INTERVAL) || last) && count > 0 {
            let measured = step.is_multiple_of(trainer.config().validation_interval) || last;
            let line = LogLine {
                step,
                seconds,
                loss: loss / count as f32,
                train_psnr: psnr / count as f32,
                n_static: report.n_static,
                n_dynamic: report.n_dynamic,
                waited_seconds: trainer.waited_seconds(),
                validation_psnr: if measured {
                    trainer.validation_psnr()?
                } else {
                    None
                },
                skipped_steps: trainer.take_skipped_steps(),
            };
            (loss, psnr, count) = (0.0, 0.0, 0);
            append(&mut log, &line, &run.log_path())?;
        }
        let due = |(probe, _): &&mut (CurveProbe, File)| probe.is_due(step) && !last;
        if let Some((probe, file)) = curve.as_mut().filter(due) {
            let scene = (trainer.scene(), TablePrecision::Single);
            let line = probe.measure(scene, step, seconds, &run.root)?;
            append(file, &line, &run.curve_path())?;
        }
        if step.is_multiple_of(trainer.config().checkpoint_interval) || last {
            save_checkpoint(&trainer, &checkpoints, seconds)?;
        }
    }
    // A run that was resumed at its end has done that before, outside this clock.
    let (scene, precision, decisions) = match finished {
        Some(finished) => finished,
        None => trainer.needed_scene()?,
    };
    scene.save_with(&run.scene_path(), precision)?;
    run.record(&trainer, decisions)?;
    // The last line is about what is left of the scene.
    if let Some((probe, file)) = &mut curve {
        let step = trainer.steps_done();
        let line = probe.measure((&scene, precision), step, seconds, &run.root)?;
        append(file, &line, &run.curve_path())?;
    }
    Ok((trainer, seconds))
}

/// Says so where a run's stages are not those that were asked for.
fn tell_of_stages(config: &TrainConfig, taken: &StageConfig) {
    let asked = &config.stages;
    if asked == taken {
        return;
    }
    let ends = |stages: &StageConfig| {
        let following = stages.settle * (stages.decomposition - stages.warmup);
        [
            stages.warmup,
            stages.warmup + following,
            stages.decomposition,
        ]
        .map(|share| (100.0 * share).round())
    };
    let names = [
        "the warm-up ends",
        "following motion ends",
        "the decomposition ends",
    ];
    let changes: Vec<String> = names
        .into_iter()
        .zip(ends(asked).into_iter().zip(ends(taken)))
        .filter(|(_, (asked, taken))| asked != taken)
        .map(|(name, (asked, taken))| format!("{name} after {taken} % instead of {asked} %"))
        .collect();
    if !changes.is_empty() {
        tracing::info!(
            "{} steps are few: {} (stages.min_following=0 keeps the stages as they are)",
            config.iterations,
            changes.join(", "),
        );
    }
}
