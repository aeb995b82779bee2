//! Leaving out what a scene does not need: each part has a rule by which it is kept or dropped, and
//! what was decided is recorded with what was measured.

mod evidence;
mod parts;
mod trials;

use dash_model::DynamicScene;
use dash_model::scene_file::TablePrecision;
use serde::{Deserialize, Serialize};

use super::config::Keep;
use super::trainer::Trainer;
use crate::Error;

/// Most that pictures may lose when a part is left out, dB: over all pixels and where something moves, by
/// the lower bound of the mean over training views.
const MAX_LOSS: f64 = 0.007;
/// Most that they may lose when all that was left out is counted, dB: by the same bound.
const MAX_TOTAL_LOSS: f64 = 0.02;
/// Share of the scene's bytes, or of its field's arithmetic, that a part must take to be worth leaving
/// out.
const MIN_SAVING: f64 = 0.03;

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

/// The name of the decision whether anything moves.
const FIELD: &str = "4D field";

/// Whether it was found that nothing moves.
pub(crate) fn nothing_moves(decisions: &[Decision]) -> bool {
    decisions.iter().any(|d| d.part == FIELD && d.left_out)
}

impl Decision {
    /// A part that is kept so far.
    fn new(trainer: &Trainer, part: &str) -> Self {
        Self {
            step: trainer.step,
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

/// What is decided before the first step: whether anything moves.
pub(crate) fn before_training(trainer: &mut Trainer) -> Result<(), Error> {
    let decides = trainer.config.keep == Keep::Needed && trainer.may_move();
    if decides && trainer.decisions.is_empty() {
        trainer.decisions.extend(evidence::of_motion(trainer)?);
    }
    Ok(())
}

/// What is left of a trained scene, the precision that its tables need, and all that was decided.
///
/// # Errors
/// When rendering fails.
pub(crate) fn after_training(
    trainer: &Trainer,
) -> Result<(DynamicScene, TablePrecision, Vec<Decision>), Error> {
    let mut decisions = trainer.decisions.clone();
    if trainer.config.keep == Keep::All {
        return Ok((trainer.scene.clone(), TablePrecision::Single, decisions));
    }
    let mut trials = trials::Trials::new(trainer)?;
    let shares = parts::gaussians(&mut trials)?;
    parts::heads(&mut trials)?;
    parts::levels(&mut trials)?;
    parts::directions(&mut trials, &shares)?;
    parts::unread_entries(&mut trials)?;
    parts::table_bits(&mut trials)?;
    decisions.extend(trials.decisions);
    Ok((trials.scene, trials.precision, decisions))
}
