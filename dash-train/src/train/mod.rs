//! Training: configuration, losses, density control, stages, checkpoints.

mod checkpoint;
pub(crate) mod coarse;
pub mod config;
mod density;
pub(crate) mod initial;
mod leave_out;
mod loss;
mod optimizer;
mod presets;
mod review;
mod run;
mod sampler;
mod split;
mod statistics;
pub(crate) mod sweep;
mod trainer;
mod update;
pub(crate) mod validation;

pub use checkpoint::{checkpoint_config, latest_checkpoint, load_checkpoint, save_checkpoint};
pub use config::{Keep, Preset, TrainConfig};
pub use leave_out::Decision;
pub use run::{DataConfig, LogLine, RunConfig, RunFolder, TrainOptions, read_config, train};
pub use trainer::{StepReport, Trainer};
