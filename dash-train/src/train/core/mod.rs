//! The mechanics of training Gaussians, whatever the method: the step, the optimizer, density control, the view
//! sampler, the guard against non-finite values, checkpoints. Nothing here knows DASH.
//!
//! A [`Method`] says how the scene changes over time; an [`Extension`] adds one idea to it; a [`Densify`] decides
//! which Gaussians are cloned, split, pruned or relocated. Each is one trait, and one file to write.

mod add_backdrop;
mod backdrop;
pub(crate) mod capture;
pub mod checkpoint;
mod config;
pub(crate) mod densify;
mod edit;
mod extension;
mod finished;
mod first_points;
mod forward;
mod gradient_visit;
pub(crate) mod guard;
pub(crate) mod hold_out;
mod hooks;
pub(crate) mod initial;
pub(crate) mod initial_views;
pub(crate) mod loss;
mod method;
mod module_visit;
pub(crate) mod notes;
pub(crate) mod optimizer;
mod pass;
pub(crate) mod points;
mod ranges;
mod rates;
mod replicas;
mod run;
mod sampler;
mod saved;
mod sets;
pub(crate) mod shortage;
mod skipped;
mod step;
pub(crate) mod stereo;
mod target;
mod times;
mod view_pass;
mod view_sums;
pub(crate) mod visibility;

pub use backdrop::{Backdrop, Kept};
pub use capture::TimeSpan;
pub use config::{DensifyConfig, DensifySets, OptimizerConfig, ScheduleConfig};
pub use densify::{Adaptive, Densify, DensityStatistics, Edit, Round, Rules, SceneScale};
pub use extension::Extension;
pub use finished::{Decision, Finished};
pub use first_points::FirstPoints;
pub use forward::Forward;
pub use gradient_visit::GradientVisit;
pub use guard::MAX_SKIPPED_IN_A_ROW;
pub use hooks::Hooks;
pub use method::{Method, Moved, Static};
pub use module_visit::ModuleVisit;
pub use optimizer::{Optimizer, Rate};
pub use ranges::{Ranges, Section};
pub use rates::Rates;
pub use replicas::{Exchange, Threads, ViewMessage};
pub use run::{CaptureFacts, Run, SetState};
pub use sampler::ViewSampler;
pub use saved::Saved;
pub use sets::{RowEdit, Set};
pub use skipped::{NonFinite, Place, SkippedStep};
pub use step::{StepReport, step};
pub use times::{Around, Times};
pub use view_sums::ViewSums;

pub(crate) use capture::is_synchronized;
pub(crate) use optimizer::to_host;
