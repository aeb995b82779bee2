//! What a run ends with.

use dash_model::DynamicScene;
use dash_model::scene_file::TablePrecision;
use serde::{Deserialize, Serialize};

/// A trained scene in its stored form.
#[derive(Debug, Clone)]
pub struct Finished {
    /// The scene.
    pub scene: DynamicScene,
    /// The precision that its tables need.
    pub precision: TablePrecision,
    /// Which parts were kept and left out, and why.
    pub decisions: Vec<Decision>,
}

/// A part of a scene that was kept or left out, and why.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Decision {
    /// Steps done when it was decided.
    pub step: usize,
    /// What it is about.
    pub part: String,
    /// Whether it was left out.
    pub left_out: bool,
    /// What was measured.
    pub reason: String,
    /// Mean change of PSNR over training views without it, dB.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub db: Option<f64>,
    /// Lower bound of that mean, two standard errors below it, dB.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub db_lower: Option<f64>,
    /// Mean change of PSNR where something moves, dB.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub moving_db: Option<f64>,
    /// Lower bound of that mean, dB.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub moving_db_lower: Option<f64>,
    /// Bytes of the scene that it takes.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub bytes: Option<u64>,
    /// Milliseconds of rendering a training view that it takes: a difference of medians, and noisy.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub millis: Option<f64>,
}

impl Decision {
    /// A part that is kept so far.
    pub(crate) fn kept(step: usize, part: &str) -> Self {
        Self {
            step,
            part: part.into(),
            left_out: false,
            reason: String::new(),
            db: None,
            db_lower: None,
            moving_db: None,
            moving_db_lower: None,
            bytes: None,
            millis: None,
        }
    }
}
