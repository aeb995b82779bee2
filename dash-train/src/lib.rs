//! Datasets, losses, training, evaluation, and the `dash` command line.
//!
//! # Map
//! - `dataset`, `ply`, `files`: readers for datasets; `cameras`: camera files and paths.
//! - `prepare`: datasets from recordings of a rig.
//! - `synth`: ray-traced scenes with exact truth.
//! - `train`: configuration, stages, losses, density control, checkpoints, runs on disk.
//! - `stress`: extreme inputs for all of it.
//! - `doctor`: what is wrong with a dataset, and how to mend it.
//! - `compare`: other methods on the same data, at the same cost.
//! - `process`: what a program sets up first; `device`: devices by name; `evaluate`: `results.json`; `render`: pictures of a scene.
//! - `bench`: errors and times of kernels; `report`: what was measured, as a page, CSV and PNG.
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
mod files;
#[doc(hidden)]
pub mod fuzzing;
pub mod metrics;
pub mod ply;
pub mod prepare;
pub mod process;
pub mod render;
pub mod report;
pub mod stress;
pub mod synth;
#[cfg(test)]
mod test_kit;
pub mod train;
pub mod video;

pub use error::TrainError;
