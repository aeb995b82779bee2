//! Datasets, losses, training, evaluation, and reports; the program `dash` is made of it.
//!
//! # Map
//! - `dataset`, `ply`, `files`: readers for datasets; `cameras`: camera files and paths.
//! - `prepare`: datasets from recordings of a rig.
//! - `synth`: ray-traced datasets with exact poses and motion masks.
//! - `train`: configuration, stages, losses, density control, checkpoints, runs on disk.
//! - `reconstruct`: a whole run in one call; `quickstart`: one on a synthetic scene.
//! - `stress`: extreme inputs for every operation and for training.
//! - `doctor`: what is wrong with a dataset, and how to mend it.
//! - `compare`: methods on the same data at the same cost.
//! - `published`: the field's protocols and figures; `benchmark`: runs of a protocol, beside what others published.
//! - `windows`: a long clip in windows of time.
//! - `jobs`: runs of these three as tasks that many processes share, on one machine or on a cluster.
//! - `evaluate`: scores of a scene; `results`: scores of a run, its `results.json`; `render`: pictures of a scene.
//! - `splat_scene`: files of Gaussians as scenes; `four_dgs`: clips in the container `.4dgs`.
//! - `process`: set-up and memory of the process; `device`: devices by name.
//! - `bench`: errors and times of kernels; `report`: measurements as a page, CSV and PNG.
//! - `tensorboard`: curves in event files.
//! - `metrics`: picture quality; `video`: pictures and videos on disk.
//!
//! # Features
//! | feature | brings | default |
//! | --- | --- | --- |
//! | `flex` | the CPU through burn-flex | yes |
//! | `ndarray` | the CPU through burn-ndarray | yes |
//! | `wgpu` | GPUs through Vulkan, Metal or DX12 | yes |
//! | `cuda` | NVIDIA GPUs through CUDA; its build downloads LLVM | no |
//! | `fourdgs` | clips of other players, `.4dgs` | yes |
//!
//! Conventions are those of [`dash_kernels`] and [`dash_model`].

pub mod bench;
pub mod benchmark;
pub mod cameras;
pub mod compare;
pub mod dataset;
pub mod device;
pub mod doctor;
mod draw;
mod error;
pub mod evaluate;
mod files;
#[doc(hidden)]
pub mod fuzzing;
mod hash;
pub mod jobs;
pub mod metrics;
mod numbers;
pub mod ply;
pub mod prepare;
pub mod process;
pub mod published;
pub mod quickstart;
pub mod reconstruct;
pub mod render;
pub mod report;
pub mod results;
mod splat_scene;
pub mod stress;
pub mod synth;
pub mod tensorboard;
#[cfg(test)]
mod test_kit;
pub mod train;
pub mod video;
pub mod windows;

pub use error::Error;
#[cfg(feature = "fourdgs")]
pub use splat_scene::four_dgs;
pub use splat_scene::{Drawn, SceneOverTime, SplatClip, rows_at, splat_files, splat_scene};

#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
