//! Leaving out what a scene does not need: each part has a rule by which it is kept or dropped, and
//! what was decided is recorded with what was measured.

mod evidence;
mod storage;
mod trials;

use serde::{Deserialize, Serialize};

use super::config::Keep;
use super::trainer::Trainer;
use crate::TrainError;

pub(crate) use storage::table_precision;

/// Most that a picture may lose when a part is left out, dB: by the lower bound of the mean over
/// training views.
pub(crate) const MAX_LOSS: f64 = 0.02;
/// Share of the scene's bytes that a part must take to be worth leaving out.
pub(crate) const MIN_SAVING: f64 = 0.03;

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
    /// Mean change of PSNR over training views without it, before training goes on, dB.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub db: Option<f64>,
    /// Lower bound of that mean, two standard errors below it, dB.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub db_lower: Option<f64>,
    /// Bytes of the scene that it takes.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub bytes: Option<u64>,
}

/// The name of the decision whether anything moves.
const FIELD: &str = "4D field";

/// Whether it was found that nothing moves.
pub(crate) fn nothing_moves(decisions: &[Decision]) -> bool {
    decisions.iter().any(|d| d.part == FIELD && d.left_out)
}

/// What is decided before the trainer's next step.
pub(crate) fn decide(trainer: &mut Trainer) -> Result<(), TrainError> {
    if trainer.config.keep == Keep::All {
        return Ok(());
    }
    if trainer.step == 0 && trainer.decisions.is_empty() && trainer.may_move() {
        trainer.decisions.extend(evidence::of_motion(trainer)?);
    }
    let config = &trainer.config;
    let grown = config
        .density_static
        .until
        .max(config.density_dynamic.until);
    if trainer.step == config.step_at(grown) && grown < 1.0 {
        trials::run(trainer)?;
    }
    Ok(())
}
