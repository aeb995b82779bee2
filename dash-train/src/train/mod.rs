//! Training: configuration, losses, density control, stages, checkpoints.

mod average;
mod blocks;
mod checkpoint;
pub(crate) mod coarse;
pub mod config;
mod cover;
mod density;
mod forward;
mod guard;
pub(crate) mod initial;
mod leave_out;
mod lines;
mod loss;
mod matching;
mod moved;
mod optimizer;
mod oversized;
mod presets;
mod promote;
mod regularity;
mod review;
mod run;
mod sampler;
mod split;
mod statistics;
pub(crate) mod sweep;
mod target;
mod trainer;
mod update;
pub(crate) mod validation;

pub(crate) use optimizer::to_host;
pub(crate) use split::continue_with;
pub(crate) use trainer::{start_from, training_psnr};

pub use checkpoint::{checkpoint_config, latest_checkpoint, load_checkpoint, save_checkpoint};
pub use config::{Keep, Preset, TrainConfig};
pub use guard::{MAX_SKIPPED_IN_A_ROW, NonFinite, Part, SkippedStep};
pub use leave_out::Decision;
pub use lines::LogLine;
pub use run::{DataConfig, RunConfig, RunFolder, StageEnds, TrainOptions, read_config, train};
pub use trainer::{StepReport, Trainer};
