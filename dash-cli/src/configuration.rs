//! The training configuration from its sources: preset < file < `--set` and options of their own.

use std::fs;
use std::path::{Path, PathBuf};

use clap::{Args, ValueEnum};
use dash_train::dataset::{FrameRange, Layout};
use dash_train::train::{Keep, Preset, RunConfig, TrainConfig};
use serde::Deserialize;
use toml::{Table, Value};

use crate::failure::Failure;

/// The options of training commands that name values.
#[derive(Args)]
pub struct ValueArgs {
    /// Where values start from [default: default]
    #[arg(long, value_enum)]
    pub preset: Option<Preset>,
    /// Values that replace the preset's
    #[arg(long, value_name = "F.toml")]
    pub config: Option<PathBuf>,
    /// One value that replaces the preset's and the file's, such as dssim=0.1; may be repeated
    #[arg(long, value_name = "KEY=VALUE")]
    pub set: Vec<String>,
    /// Views of a step: the gradient is their mean, and learning rates grow by sqrt(K). They are drawn one after the other
    /// [default: 1]
    #[arg(long, value_name = "K")]
    pub batch: Option<usize>,
}

impl ValueArgs {
    /// Them, and nothing else.
    pub fn overrides(&self) -> Overrides<'_> {
        Overrides {
            preset: self.preset,
            file: self.config.as_deref(),
            assignments: &self.set,
            batch: self.batch,
            iterations: None,
            seed: None,
            keep: None,
        }
    }
}

/// What the command line says about the training itself.
pub struct Overrides<'a> {
    /// `--preset`.
    pub preset: Option<Preset>,
    /// `--config`.
    pub file: Option<&'a Path>,
    /// `--set`, in order.
    pub assignments: &'a [String],
    /// `--batch`.
    pub batch: Option<usize>,
    /// `--iterations`.
    pub iterations: Option<usize>,
    /// `--seed`.
    pub seed: Option<u64>,
    /// `--keep`.
    pub keep: Option<Keep>,
}

/// A configuration file: the fields of a [`TrainConfig`], some or all; or, as in a run's
/// `config.toml`, those under `[train]` and the data's under `[data]`.
#[derive(Default)]
pub struct ConfigFile {
    train: Table,
    /// Whether that is all values of a run, not some that replace a preset's.
    is_whole: bool,
    /// How the data is loaded.
    pub data: DataSection,
}

/// `[data]` of a run's `config.toml`, as far as another run can take it over.
#[derive(Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DataSection {
    /// Named on the command line instead.
    #[serde(rename = "dataset")]
    _dataset: Option<PathBuf>,
    /// Layout of the dataset.
    pub layout: Option<Layout>,
    /// Factor by which images are made smaller.
    pub downscale: Option<f64>,
    /// Test cameras.
    pub test_cameras: Option<Vec<usize>>,
    /// Cameras that are left out.
    pub drop_cameras: Option<Vec<String>>,
    /// Which frames.
    pub frames: Option<FrameRange>,
    /// Whether masks are to be inverted.
    pub invert_masks: Option<bool>,
    /// Whether views whose image cannot be read are left out.
    pub skip_broken: Option<bool>,
    /// The run that is drawn behind; a relative path is one from the file's folder.
    pub backdrop: Option<PathBuf>,
    /// Chosen with `--device` instead.
    #[serde(rename = "device")]
    _device: Option<String>,
}

impl ConfigFile {
    /// Reads a configuration file; without a path, one that says nothing.
    pub fn read(path: Option<&Path>) -> Result<Self, Failure> {
        let Some(path) = path else {
            return Ok(Self::default());
        };
        let refuse = |what: String| Failure::new(format!("{}: {what}", path.display()));
        let text = fs::read_to_string(path).map_err(|e| {
            refuse(format!(
                "cannot read the configuration: {e}; check the path"
            ))
        })?;
        let mut table: Table = text.parse().map_err(|e: toml::de::Error| {
            let line = e
                .span()
                .map_or(1, |span| text[..span.start].matches('\n').count() + 1);
            refuse(format!(
                "expected TOML, found at line {line}: {}",
                e.message()
            ))
        })?;
        let data = match table.remove("data") {
            None => DataSection::default(),
            Some(section) => section
                .try_into()
                .map_err(|e: toml::de::Error| refuse(format!("[data]: {}", e.message())))?,
        };
        // Another run decides for itself what it needs.
        for key in RunConfig::RECORDED {
            table.remove(key);
        }
        let mut is_whole = false;
        let train = match table.remove("train") {
            None => table,
            Some(Value::Table(train)) if table.is_empty() => {
                is_whole = true;
                train
            }
            Some(_) => {
                return Err(refuse(
                    "expected all training values under [train], or none; found both".into(),
                ));
            }
        };
        Ok(Self {
            train,
            is_whole,
            data,
        })
    }

    fn preset(&self) -> Option<Result<Preset, String>> {
        let value = self.train.get("preset")?;
        Some(
            value
                .as_str()
                .map_or(Err(value.to_string()), |name| Preset::from_str(name, false)),
        )
    }
}

impl Overrides<'_> {
    /// Whether the number of steps is asked for: a capture's views are not asked then.
    fn has_iterations(&self, file: &ConfigFile) -> bool {
        let assigned = |text: &String| matches!(text.split_once('='), Some(("iterations", _)));
        self.iterations.is_some()
            || file.train.contains_key("iterations")
            || self.assignments.iter().any(assigned)
    }

    /// The configuration of a new run.
    pub fn resolve(&self, file: &ConfigFile) -> Result<TrainConfig, Failure> {
        let path = self
            .file
            .map(|path| path.display().to_string())
            .unwrap_or_default();
        let in_file = file.preset().transpose().map_err(|e| {
            Failure::new(format!(
                "{path}: preset: expected a preset's name, found {e}"
            ))
        })?;
        let preset = match (self.preset, in_file) {
            (Some(asked), Some(found)) if asked != found => {
                return Err(Failure::usage(format!(
                    "--preset {} contradicts preset = \"{}\" in {path}; leave one of them out",
                    name(asked),
                    name(found)
                )));
            }
            (asked, found) => asked.or(found).unwrap_or(Preset::Default),
        };
        let mut config = self.apply(TrainConfig::preset(preset), file)?;
        if self.has_iterations(file) {
            config.visits = None;
        }
        Ok(config)
    }

    /// `config` with the file's values, then the command line's.
    pub fn apply(&self, config: TrainConfig, file: &ConfigFile) -> Result<TrainConfig, Failure> {
        let mut config = match self.file {
            None => config,
            Some(path) => {
                let refuse = |what: String| Failure::new(format!("{}: {what}", path.display()));
                let mut table = Table::try_from(&config)
                    .map_err(|e| refuse(format!("cannot be merged with the preset: {e}")))?;
                if file.is_whole {
                    table = file.train.clone();
                } else {
                    merge(&mut table, &file.train);
                }
                let config: TrainConfig = table.try_into().map_err(|e: toml::de::Error| {
                    refuse(format!("{e}; check the key's name and value"))
                })?;
                config.validate().map_err(|e| refuse(e.to_string()))?;
                config
            }
        };
        for assignment in self.assignments {
            config
                .set(assignment)
                .map_err(|e| Failure::usage(e.to_string()))?;
        }
        config.batch = self.batch.unwrap_or(config.batch);
        config.iterations = self.iterations.unwrap_or(config.iterations);
        config.seed = self.seed.unwrap_or(config.seed);
        if let Some(keep) = self.keep {
            config.keep(keep);
        }
        config
            .validate()
            .map_err(|e| Failure::usage(e.to_string()))?;
        Ok(config)
    }
}

/// A preset's name on the command line.
pub fn name(preset: Preset) -> String {
    preset
        .to_possible_value()
        .map(|value| value.get_name().to_string())
        .unwrap_or_default()
}

/// Replaces values of `base` by those of `over`, section by section. `"none"` takes a section away, such as an
/// extension's.
fn merge(base: &mut Table, over: &Table) {
    for (key, value) in over {
        match (base.get_mut(key), value) {
            (Some(Value::Table(_)), Value::String(none)) if none == "none" => {
                base.remove(key);
            }
            (Some(Value::Table(base)), Value::Table(over)) => merge(base, over),
            _ => {
                base.insert(key.clone(), value.clone());
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn file(text: &str) -> (tempfile::TempDir, PathBuf) {
        let folder = tempfile::tempdir().expect("a scratch folder");
        let path = folder.path().join("c.toml");
        fs::write(&path, text).expect("written");
        (folder, path)
    }

    fn overrides<'a>(file: Option<&'a Path>, assignments: &'a [String]) -> Overrides<'a> {
        Overrides {
            preset: None,
            file,
            assignments,
            batch: None,
            iterations: None,
            seed: None,
            keep: None,
        }
    }

    #[test]
    fn a_number_of_steps_that_is_asked_for_is_taken_for_any_capture() {
        let visits = |over: &Overrides| {
            let file = ConfigFile::read(over.file).expect("read");
            over.resolve(&file).expect("valid").visits
        };
        assert_eq!(visits(&overrides(None, &[])), Some(4));
        assert_eq!(visits(&overrides(None, &["seed=6".into()])), Some(4));
        assert_eq!(visits(&overrides(None, &["iterations=9".into()])), None);
        let asked = Overrides {
            iterations: Some(15_000),
            ..overrides(None, &[])
        };
        assert_eq!(visits(&asked), None);
        let (_folder, path) = file("preset = \"quick\"\niterations = 70\n");
        assert_eq!(visits(&overrides(Some(&path), &[])), None);
    }

    #[test]
    fn the_command_line_wins_over_the_file_and_the_file_over_the_preset() {
        let (_folder, path) = file("preset = \"quick\"\niterations = 70\nseed = 5\ndssim = 1\n");
        let assignments = ["seed=6".to_string()];
        let over = overrides(Some(&path), &assignments);
        let config = over
            .resolve(&ConfigFile::read(over.file).expect("read"))
            .expect("valid");
        let quick = TrainConfig::preset(Preset::Quick);
        assert_eq!((config.iterations, config.seed, config.dssim), (70, 6, 1.0));
        assert_eq!(config.sh_degree, quick.sh_degree);
        assert_eq!(config.method.smoothness, quick.method.smoothness);
        let over = Overrides {
            seed: Some(9),
            ..over
        };
        let config = over
            .resolve(&ConfigFile::read(over.file).expect("read"))
            .expect("valid");
        assert_eq!(config.seed, 9);
    }

    #[test]
    fn a_runs_own_configuration_is_a_file_too() {
        let train = TrainConfig::preset(Preset::Paper);
        let text = format!(
            "[data]\ndataset = \"d\"\ndownscale = 2.0\ndevice = \"flex\"\n{}",
            toml::to_string(&Table::from_iter([(
                "train".to_string(),
                Value::try_from(&train).expect("serialises")
            )]))
            .expect("serialises")
        );
        let (_folder, path) = file(&text);
        let read = ConfigFile::read(Some(&path)).expect("read");
        assert_eq!(read.data.downscale, Some(2.0));
        assert_eq!(
            overrides(Some(&path), &[]).resolve(&read).expect("valid"),
            train
        );
    }

    #[test]
    fn mistakes_name_the_file_and_the_key() {
        for (text, part) in [
            ("dsim = 1\n", "dsim"),
            ("iterations = \"many\"\n", "iterations"),
            ("iterations = 0\n", "iterations"),
            ("iterations =\n", "line 1"),
            ("preset = \"fast\"\n", "fast"),
        ] {
            let (_folder, path) = file(text);
            let over = overrides(Some(&path), &[]);
            let failure = match ConfigFile::read(over.file) {
                Ok(read) => over.resolve(&read).expect_err(text),
                Err(failure) => failure,
            };
            let line = failure.line();
            assert!(line.contains("c.toml") && line.contains(part), "{line}");
        }
    }
}
