//! Evaluation of a scene in memory.
//!
//! [`evaluate`] scores a trained scene; [`CurveProbe`] scores one while training goes on. What the numbers
//! mean is written beside them, see [`MetricSettings`]. [`crate::results`] scores a run's folder.

mod curve;
mod perceptual;
mod scores;
mod storage;
mod views;

pub use curve::{CurveLine, CurveProbe, MAX_CURVE_VIEWS};
pub use perceptual::{Perceptual, PerceptualFiles};
pub use scores::{DecompositionScores, Evaluation, MetricSettings, ViewScores};
pub(crate) use scores::{ROUNDING_RULE, resize_rule};
pub use storage::storage_bytes;
pub use views::{Scored, evaluate};
