//! Datasets, losses, training, evaluation, and the `dash` command line.
//!
//! # Map
//! - `dataset`, `ply`: readers for datasets; `cameras`: camera files and paths.
//! - `prepare`: datasets from recordings of a rig.
//! - `synth`: ray-traced datasets with exact poses and motion masks.
//! - `train`: configuration, stages, losses, density control, checkpoints, runs on disk.
//! - `stress`: extreme inputs for every operation and for training.
//! - `doctor`: what is wrong with a dataset, and how to mend it.
//! - `compare`: methods on the same data at the same cost.
//! - `evaluate`: scores of a scene; `results`: scores of a run, its `results.json`; `render`: pictures of a scene.
//! - `process`: set-up and memory of the process; `device`: devices by name.
//! - `bench`: errors and times of kernels; `report`: measurements as a page, CSV and PNG.
//! - `metrics`: picture quality; `video`: pictures and videos on disk.
//!
//! Conventions are those of [`dash_kernels`] and [`dash_model`].

pub mod bench;
pub mod cameras;
pub mod compare;
pub mod dataset;
pub mod device;
pub mod doctor;
mod error;
pub mod evaluate;
#[doc(hidden)]
pub mod fuzzing;
pub mod metrics;
mod numbers;
pub mod ply;
pub mod prepare;
pub mod process;
pub mod render;
pub mod report;
pub mod results;
pub mod stress;
pub mod synth;
pub mod train;
pub mod video;

pub use error::Error;
