//! Evaluation of a trained scene, and the `results.json` it is written to.
//!
//! [`evaluate`] scores a scene in memory; [`evaluate_run`] scores a run's folder and adds what only
//! the run knows; [`CurveProbe`] scores while training goes on. What the numbers mean is written beside them, see [`MetricSettings`].

mod curve;
mod measure;
mod perceptual;
mod results;

pub use curve::{CurveLine, CurveProbe, MAX_CURVE_VIEWS};
pub use measure::{DecompositionScores, Evaluation, MetricSettings, ViewScores, evaluate};
pub(crate) use measure::{ROUNDING_RULE, resize_rule};
pub use perceptual::{Perceptual, PerceptualFiles};
pub use results::{
    Process, Results, evaluate_run, peak_memory_bytes, read_results, reset_peak_memory,
    storage_bytes,
};
