//! What came out of a benchmark: `OUT/benchmark.json`.

use std::io::Write;
use std::path::{Path, PathBuf};

use dash_model::scene_file::write_atomically;
use serde::Serialize;

use super::{Benchmark, Found, SceneRuns};
use crate::Error;
use crate::numbers::median_and_range;
use crate::published::{Figures, MEAN, ProtocolName, published};
use crate::report::Beside;
use crate::train::Preset;

/// `benchmark.json`.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct BenchmarkRows {
    /// The protocol.
    pub protocol: ProtocolName,
    /// The preset that runs started from.
    pub preset: Preset,
    /// The device.
    pub device: String,
    /// The scenes that were scored.
    pub scenes: Vec<SceneRow>,
    /// The scenes that were asked for and are not there.
    pub missing: Vec<String>,
    /// Whether `mean` is over all scenes of the protocol, as published means are.
    pub is_whole: bool,
    /// The mean over the scenes that were scored.
    pub mean: Figures,
}

/// A scene's scores.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SceneRow {
    /// The scene's published name.
    pub scene: String,
    /// Number of seeds; the figures are medians over them.
    pub seeds: usize,
    /// Training steps.
    pub iterations: usize,
    /// Test views.
    pub n_views: usize,
    /// In what the data differs from the protocol's.
    pub differs: Vec<String>,
    /// dB, over the moving pixels.
    pub psnr_dynamic: Option<f64>,
    /// Scores and costs.
    #[serde(flatten)]
    pub figures: Figures,
}

impl BenchmarkRows {
    /// The rows of a benchmark's runs.
    pub fn new(benchmark: &Benchmark, found: &Found, runs: &[SceneRuns]) -> Self {
        let scenes: Vec<SceneRow> = runs.iter().map(SceneRow::new).collect();
        let figures: Vec<Figures> = scenes.iter().map(|row| row.figures).collect();
        let n_published = benchmark.protocol.protocol().scenes.len();
        Self {
            protocol: benchmark.protocol,
            preset: benchmark.train.preset,
            device: benchmark.device.clone(),
            is_whole: scenes.len() == n_published,
            mean: Figures::mean(&figures),
            missing: found.missing.iter().map(|s| s.name.to_string()).collect(),
            scenes,
        }
    }

    /// Names of the scenes that were scored.
    pub fn scene_names(&self) -> Vec<&str> {
        self.scenes.iter().map(|row| row.scene.as_str()).collect()
    }

    /// Published figures that compare with `mean`: published means where all scenes were scored; else means over
    /// the same scenes, of the systems with figures for each of them.
    pub fn published_means(&self) -> Vec<Beside> {
        let of = |entry: &'static crate::published::Published| {
            if self.is_whole {
                return Some(Beside::published(entry, *entry.scenes.get(MEAN)?));
            }
            let own: Option<Vec<Figures>> = self
                .scenes
                .iter()
                .map(|row| entry.scenes.get(&row.scene).copied())
                .collect();
            let mean = Figures::mean(&own?);
            mean.psnr.map(|_| Beside::published(entry, mean))
        };
        published(self.protocol).filter_map(of).collect()
    }

    /// Writes `benchmark.json` into `folder`.
    ///
    /// # Errors
    /// When the file can't be written.
    pub fn write(&self, folder: &Path) -> Result<PathBuf, Error> {
        let path = folder.join("benchmark.json");
        let json = serde_json::to_vec_pretty(self).map_err(|e| Error::Config(e.to_string()))?;
        write_atomically(&path, |mut file| file.write_all(&json))?;
        Ok(path)
    }
}

impl SceneRow {
    fn new(runs: &SceneRuns) -> Self {
        let note = runs.differs.join("; ");
        let ours = Beside::ours(runs.scene.name.into(), &runs.runs, note);
        let results = || runs.runs.iter().filter_map(|run| run.results.as_ref());
        let moving = results().filter_map(|results| results.evaluation.psnr_dynamic);
        let first = results().next();
        Self {
            scene: runs.scene.name.into(),
            seeds: runs.runs.len(),
            iterations: first.map_or(0, |results| results.iterations),
            n_views: first.map_or(0, |results| results.evaluation.per_view.len()),
            differs: runs.differs.clone(),
            psnr_dynamic: median_and_range(moving).map(|[median, ..]| median),
            figures: ours.figures,
        }
    }
}
