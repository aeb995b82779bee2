//! Published protocols as runs: the scenes that are there, trained and scored as others did, and a page of both.
//!
//! A [`Benchmark`] describes the runs. Each has an ordinary run's folder, `OUT/SCENE/seed-S`. A scored run is not trained
//! again; an interrupted run resumes from its newest checkpoint. A dataset may differ from its protocol; every score
//! then says how ([`Prepared::differs`]).
//!
//! # Map
//! - this file: the benchmark and its order; `scenes`: the folders that are there; `prepare`: how one is loaded.
//! - `training`: one run; `rows`: what came out, `OUT/benchmark.json`; `pinned`, `page`: what a reader sees.

mod dropped;
mod page;
mod pinned;
mod prepare;
mod rows;
mod scenes;
#[cfg(test)]
mod tests;
mod training;

use std::path::{Path, PathBuf};
use std::sync::Arc;

use burn::tensor::Device;
use serde::{Deserialize, Serialize};

pub use dropped::DroppedCamera;
pub use page::page;
pub use pinned::pinned;
pub use prepare::Prepared;
pub use rows::{BenchmarkRows, SceneRow};
pub use scenes::{Found, find_scenes};

use crate::Error;
use crate::dataset::{Dataset, load};
use crate::evaluate::Perceptual;
use crate::files::{claim, read_owner};
use crate::published::{ProtocolName, Scene};
use crate::report::{RunRecord, read_run};
use crate::results::scored;
use crate::train::{StepReport, TrainConfig};
use training::Training;

/// The file of a benchmark's folder that says what is run.
const FILE: &str = "benchmark.toml";

/// What is run: `OUT/benchmark.toml`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Benchmark {
    /// The protocol.
    pub protocol: ProtocolName,
    /// The folder of scenes, or of one scene.
    pub data: PathBuf,
    /// The device, as named on the command line.
    pub device: String,
    /// Cameras that are left out, of training and of testing.
    pub drop_cameras: Vec<DroppedCamera>,
    /// How every scene is trained. Its seed is replaced.
    pub train: TrainConfig,
}

/// How a benchmark is run, which its results don't depend on.
pub struct RunOptions<'a> {
    /// Seeds of each scene, from 0.
    pub seeds: u64,
    /// Memory for the images of a scene, bytes; see [`LoadOptions::memory`](crate::dataset::LoadOptions::memory).
    pub memory: Option<u64>,
    /// What LPIPS is measured with.
    pub perceptual: &'a Perceptual,
    /// Asked before and after every step whether to stop there, with a checkpoint.
    pub stop: &'a dyn Fn() -> bool,
}

/// Told how a benchmark goes on.
pub trait Observer {
    /// A scene is about to be trained.
    fn scene(&mut self, scene: &Scene, prepared: &Prepared);
    /// A run of it begins or goes on, of so many steps.
    fn begin(&mut self, scene: &Scene, seed: u64, iterations: usize);
    /// A step of it is done.
    fn step(&mut self, report: &StepReport, seconds: f64);
}

/// A scene with its runs.
#[derive(Debug, Clone)]
pub struct SceneRuns {
    /// Which scene.
    pub scene: &'static Scene,
    /// In what its data differs from the protocol's.
    pub differs: Vec<String>,
    /// The runs with their scores, by seed.
    pub runs: Vec<RunRecord>,
}

impl Benchmark {
    /// Makes `out` this benchmark's folder, or finds that it is.
    ///
    /// # Errors
    /// When a camera to drop is of no scene of the protocol, or `out` holds another benchmark or other files.
    pub fn claim(&self, out: &Path) -> Result<(), Error> {
        DroppedCamera::check(&self.drop_cameras, self.protocol.protocol())?;
        claim(out, FILE, self, "benchmark")
    }

    /// The benchmark whose folder `out` is.
    ///
    /// # Errors
    /// When its file can't be read.
    pub fn read(out: &Path) -> Result<Self, Error> {
        read_owner(out, FILE)
    }

    /// Looks at the files of each scene; no image is decoded.
    ///
    /// # Errors
    /// When a scene cannot be loaded, or has no test views.
    pub fn prepare(&self, found: &Found) -> Result<Vec<Prepared>, Error> {
        DroppedCamera::check(&self.drop_cameras, self.protocol.protocol())?;
        let scenes = found.scenes.iter();
        scenes
            .map(|(scene, folder)| Prepared::of(self, scene, folder))
            .collect()
    }

    /// Trains and scores what is not there yet of the scenes, into folders below `out`.
    ///
    /// # Errors
    /// When `out` holds another benchmark, a scene cannot be loaded or has no test views, or training fails or is
    /// stopped; runs finished until then remain and are taken as they are next time.
    pub fn run(
        &self,
        found: &Found,
        out: &Path,
        device: &Device,
        options: &RunOptions<'_>,
        observer: &mut dyn Observer,
    ) -> Result<Vec<SceneRuns>, Error> {
        // What is wrong with a scene is said before the first is trained.
        let prepared = self.prepare(found)?;
        self.claim(out)?;
        for ((scene, folder), prepared) in found.scenes.iter().zip(&prepared) {
            observer.scene(scene, prepared);
            let mut of_scene = SceneToTrain::new(self, (*scene, folder.as_path()), prepared, out);
            for seed in 0..options.seeds {
                if scored(&of_scene.root(seed))?.is_none() {
                    of_scene.train(seed, device, options, observer)?;
                }
            }
        }
        finished(found, &prepared, options.seeds, out)
    }
}

/// The scored runs of the scenes, as [`Benchmark::prepare`] found these.
///
/// # Errors
/// When a run can't be read.
pub fn finished(
    found: &Found,
    prepared: &[Prepared],
    seeds: u64,
    out: &Path,
) -> Result<Vec<SceneRuns>, Error> {
    let of_scene = |((scene, _), prepared): (&(&'static Scene, PathBuf), &Prepared)| {
        let mut runs = Vec::new();
        for seed in 0..seeds {
            let root = root(out, scene, seed);
            if scored(&root)?.is_some() {
                runs.push(read_run(&root)?);
            }
        }
        Ok(SceneRuns {
            scene,
            differs: prepared.differs.clone(),
            runs,
        })
    };
    found.scenes.iter().zip(prepared).map(of_scene).collect()
}

/// A scene whose runs are trained.
pub struct SceneToTrain<'a> {
    benchmark: &'a Benchmark,
    scene: &'static Scene,
    folder: &'a Path,
    prepared: &'a Prepared,
    out: &'a Path,
    /// Once a run has asked for it.
    dataset: Option<Arc<Dataset>>,
}

impl<'a> SceneToTrain<'a> {
    /// A scene and its folder, as [`Benchmark::prepare`] found it, whose runs go below `out`.
    pub fn new(
        benchmark: &'a Benchmark,
        (scene, folder): (&'static Scene, &'a Path),
        prepared: &'a Prepared,
        out: &'a Path,
    ) -> Self {
        Self {
            benchmark,
            scene,
            folder,
            prepared,
            out,
            dataset: None,
        }
    }

    /// The folder of a run.
    fn root(&self, seed: u64) -> PathBuf {
        root(self.out, self.scene, seed)
    }

    /// Trains and scores a run, which nobody else works on, from its newest checkpoint where it was interrupted.
    ///
    /// # Errors
    /// When the scene cannot be loaded, or training fails or is stopped.
    pub fn train(
        &mut self,
        seed: u64,
        device: &Device,
        options: &RunOptions<'_>,
        observer: &mut dyn Observer,
    ) -> Result<(), Error> {
        let dataset = match &self.dataset {
            Some(dataset) => dataset.clone(),
            None => {
                let loaded = load(self.folder, &self.prepared.load_options(options.memory))?;
                self.dataset.insert(Arc::new(loaded)).clone()
            }
        };
        let training = Training {
            benchmark: self.benchmark,
            data: &self.prepared.data,
            dataset,
            device,
            options,
        };
        observer.begin(self.scene, seed, training.iterations());
        let told = &mut |report: &StepReport, secs| observer.step(report, secs);
        training.run(seed, &self.root(seed), told)
    }
}

/// The folder of a run.
fn root(out: &Path, scene: &Scene, seed: u64) -> PathBuf {
    out.join(scene.name).join(format!("seed-{seed}"))
}
