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
use crate::dataset::load;
use crate::evaluate::Perceptual;
use crate::files::claim;
use crate::published::{ProtocolName, Scene};
use crate::report::{RunRecord, read_run};
use crate::results::scored;
use crate::train::{StepReport, TrainConfig};
use training::Training;

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
        DroppedCamera::check(&self.drop_cameras, self.protocol.protocol())?;
        // What is wrong with a scene is said before the first is trained.
        let scenes = found.scenes.iter();
        let prepared: Vec<Prepared> = scenes
            .map(|(scene, folder)| Prepared::of(self, scene, folder))
            .collect::<Result<_, _>>()?;
        claim(out, "benchmark.toml", self, "benchmark")?;
        let mut all = Vec::new();
        for ((scene, folder), prepared) in found.scenes.iter().zip(prepared) {
            observer.scene(scene, &prepared);
            let mut dataset = None;
            let mut of_scene = SceneRuns {
                scene,
                differs: prepared.differs.clone(),
                runs: Vec::new(),
            };
            for seed in 0..options.seeds {
                let root = out.join(scene.name).join(format!("seed-{seed}"));
                if scored(&root)?.is_none() {
                    let dataset = match &dataset {
                        Some(dataset) => Arc::clone(dataset),
                        None => {
                            let loaded = load(folder, &prepared.load_options(options.memory))?;
                            Arc::clone(dataset.insert(Arc::new(loaded)))
                        }
                    };
                    let training = Training {
                        benchmark: self,
                        data: &prepared.data,
                        dataset,
                        device,
                        options,
                    };
                    observer.begin(scene, seed, training.iterations());
                    let told = &mut |report: &StepReport, secs| observer.step(report, secs);
                    training.run(seed, &root, told)?;
                }
                of_scene.runs.push(read_run(&root)?);
            }
            all.push(of_scene);
        }
        Ok(all)
    }
}
