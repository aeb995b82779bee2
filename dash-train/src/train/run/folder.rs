//! The files of a run by name.

use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};

use burn::tensor::Device;
use dash_model::DynamicScene;
use dash_model::scene_file::write_atomically;

use super::config::{RunConfig, StageEnds, read_config};
use super::lines::{LogLine, read_lines};
use crate::Error;
use crate::dataset::{Dataset, Partition};
use crate::evaluate::CurveLine;
use crate::files::is_occupied;
use crate::train::core::Decision;
use crate::train::core::checkpoint::latest_checkpoint;
use crate::train::trainer::{Trainer, check_moved};

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
    pub fn open(root: &Path) -> Result<Self, Error> {
        let run = Self {
            root: root.to_path_buf(),
        };
        if !run.config_path().is_file() {
            return Err(Error::run(
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
    pub fn create(root: &Path, config: &RunConfig) -> Result<Self, Error> {
        let run = Self {
            root: root.to_path_buf(),
        };
        Self::check_free(root)?;
        fs::create_dir_all(root).map_err(|e| Error::io(root, "create", e))?;
        run.write_config(config)?;
        Ok(run)
    }

    /// Whether a run may be made in a folder.
    ///
    /// # Errors
    /// When something is there already.
    pub fn check_free(root: &Path) -> Result<(), Error> {
        match is_occupied(root).map_err(|e| Error::io(root, "list", e))? {
            false => Ok(()),
            true => Err(Error::run(
                root,
                "expected a new or empty folder for the run, found files in it; \
                 continue that run with --resume or choose another --out",
            )),
        }
    }

    fn write_config(&self, config: &RunConfig) -> Result<(), Error> {
        let text = toml::to_string(config).map_err(|e| Error::Config(e.to_string()))?;
        write_atomically(&self.config_path(), |mut file| {
            file.write_all(text.as_bytes())
        })?;
        Ok(())
    }

    /// Adds to `config.toml` how a finished run went, and what its scene kept and left out.
    pub(super) fn record(&self, trainer: &Trainer, decisions: Vec<Decision>) -> Result<(), Error> {
        let mut config = self.config()?;
        config.decisions = decisions;
        config.stage_ends = trainer.run.may_move().then(|| {
            let stages = trainer.run.stages();
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
    pub fn follow_dataset(&self, dataset: &Dataset) -> Result<(), Error> {
        let mut config = self.config()?;
        let from = &config.data.dataset;
        match latest_checkpoint(&self.checkpoints_path())? {
            Some(checkpoint) => check_moved(&checkpoint, dataset, from)?,
            None if self.scene_path().exists() => {
                return Err(Error::run(
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
    pub fn config(&self) -> Result<RunConfig, Error> {
        read_config(&self.config_path())
    }

    /// The trained scene, with its backdrop if it has one.
    ///
    /// # Errors
    /// When the run has not got that far, or its files are damaged.
    pub fn scene(&self, device: &Device) -> Result<DynamicScene, Error> {
        match self.room(device)? {
            None => self.own_scene(device),
            Some(room) => self.scene_before(&room, device),
        }
    }

    /// The same with the scene of its backdrop, which has been read already.
    ///
    /// # Errors
    /// As [`scene`](Self::scene), and when it is another one.
    pub(crate) fn scene_before(
        &self,
        room: &DynamicScene,
        device: &Device,
    ) -> Result<DynamicScene, Error> {
        self.with_backdrop(self.own_scene(device)?, room, device)
    }

    /// The trained scene without a backdrop.
    fn own_scene(&self, device: &Device) -> Result<DynamicScene, Error> {
        let folder = self.scene_path();
        if !folder.join("scene.json").is_file() {
            return Err(Error::run(
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

    /// The scores of a partition's views: `results.json`, of those trained on `results_train.json`.
    pub fn scores_path(&self, partition: Partition) -> PathBuf {
        self.root.join(Self::scores_name(partition))
    }

    /// The name of that file.
    pub fn scores_name(partition: Partition) -> &'static str {
        match partition {
            Partition::Test => "results.json",
            Partition::Train => "results_train.json",
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
    pub fn log(&self) -> Result<Vec<LogLine>, Error> {
        read_lines(&self.log_path())
    }

    /// Lines of `curve.jsonl`, none when the run was made without; one that was cut off while being
    /// written does not count.
    ///
    /// # Errors
    /// When the file can't be read.
    pub fn curve(&self) -> Result<Vec<CurveLine>, Error> {
        read_lines(&self.curve_path())
    }
}
