//! Training: configuration, losses, density control, stages, checkpoints.

mod checkpoint;
pub mod config;
mod density;
mod initial;
mod loss;
mod optimizer;
mod run;
mod sampler;
mod split;
mod trainer;
mod validation;

pub use checkpoint::{checkpoint_config, latest_checkpoint, load_checkpoint, save_checkpoint};
pub use config::{Preset, TrainConfig};
pub use run::{DataConfig, LogLine, RunConfig, RunFolder, TrainOptions, read_config, train};
pub use trainer::{StepReport, Trainer};
