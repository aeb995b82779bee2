//! Training: configuration, losses, density control, stages, checkpoints.

mod checkpoint;
mod coarse;
pub mod config;
mod density;
mod initial;
mod loss;
mod optimizer;
mod presets;
mod review;
mod run;
mod sampler;
mod split;
mod statistics;
mod sweep;
mod trainer;
mod update;
mod validation;

pub use checkpoint::{checkpoint_config, latest_checkpoint, load_checkpoint, save_checkpoint};
pub use config::{Preset, TrainConfig};
pub use run::{DataConfig, LogLine, RunConfig, RunFolder, TrainOptions, read_config, train};
pub use trainer::{StepReport, Trainer};
