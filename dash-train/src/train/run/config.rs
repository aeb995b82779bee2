//! `RUN/config.toml`.

use std::fs;
use std::path::{Path, PathBuf};

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::Error;
use crate::dataset::{FrameRange, Layout, LoadOptions};
use crate::train::config::TrainConfig;
use crate::train::core::Decision;

/// What `config.toml` holds: enough to run again with the same result.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RunConfig {
    /// The data and how it is loaded.
    pub data: DataConfig,
    /// Which parts the finished scene kept and left out, and why. Another run decides for itself.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub decisions: Vec<Decision>,
    /// When its stages ended, if it is finished and anything may have moved. Another run finds its own.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub stage_ends: Option<StageEnds>,
    /// The training. Last in the file, and without it there is no run: a file that was cut off lacks some of it.
    pub train: TrainConfig,
}

impl RunConfig {
    /// The keys of what is recorded about a finished run, which no other run takes over.
    pub const RECORDED: [&str; 2] = ["decisions", "stage_ends"];

    /// A run that has not begun.
    pub fn new(data: DataConfig, train: TrainConfig) -> Self {
        Self {
            data,
            train,
            decisions: Vec::new(),
            stage_ends: None,
        }
    }

    /// The same before it began: without what is recorded about a finished run.
    pub fn as_begun(&self) -> Self {
        Self::new(self.data.clone(), self.train.clone())
    }
}

/// The steps at which stages of a run ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StageEnds {
    /// The warm-up.
    pub warmup: usize,
    /// The decomposition.
    pub decomposition: usize,
}

/// What is read of a dataset.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct DataConfig {
    /// The dataset's folder. A relative path is one from where the program was started.
    pub dataset: PathBuf,
    /// Its layout, one of those of `--layout`. Absent: recognised by its files.
    #[schemars(with = "String")]
    pub layout: Option<Layout>,
    /// Factor by which images are made smaller, at least 1; 1 leaves them.
    pub downscale: f64,
    /// Numbers of the cameras that are held out, from 0. Absent: those of the layout.
    pub test_cameras: Option<Vec<usize>>,
    /// Names of cameras that are left out, of training and of testing. Absent: none.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub drop_cameras: Vec<String>,
    /// Which frames, as for `--frames`. Absent: those of the layout, mostly all.
    #[serde(default)]
    #[schemars(with = "String")]
    pub frames: Option<FrameRange>,
    /// Whether white in the dataset's `masks/` marks what does not count, instead of what does. Absent: no.
    #[serde(default)]
    pub invert_masks: bool,
    /// Whether views whose image cannot be read are left out; else they are an error. Absent: no.
    #[serde(default)]
    pub skip_broken: bool,
    /// The run whose static Gaussians are kept where they fit; a relative path is one from this run's folder. Absent: none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub backdrop: Option<PathBuf>,
    /// The device it ran on, as named for `--device`.
    pub device: String,
}

impl DataConfig {
    /// Options to load it with.
    pub fn load_options(&self) -> LoadOptions {
        LoadOptions {
            layout: self.layout,
            downscale: self.downscale,
            test_cameras: self.test_cameras.clone(),
            drop_cameras: self.drop_cameras.clone(),
            frames: self.frames,
            invert_masks: self.invert_masks,
            skip_broken: self.skip_broken,
            ..Default::default()
        }
    }
}

/// Reads a `config.toml`.
///
/// # Errors
/// When it can't be read or a value does not fit.
pub fn read_config(path: &Path) -> Result<RunConfig, Error> {
    let text = fs::read_to_string(path).map_err(|e| Error::io(path, "read", e))?;
    if !text.ends_with('\n') {
        return Err(Error::Config(format!(
            "{}: expected a whole line at the end, found `{}`; the file was cut off: copy it again",
            path.display(),
            text.lines().last().unwrap_or_default()
        )));
    }
    let config: RunConfig = toml::from_str(&text)
        .map_err(|e| Error::Config(format!("{}: {}", path.display(), e.message())))?;
    config.train.validate()?;
    Ok(config)
}
