//! How exactly the finished scene's tables are stored.

use dash_model::scene_file::TablePrecision;

use super::{Decision, MAX_LOSS, MIN_SAVING};
use crate::TrainError;
use crate::train::config::Keep;
use crate::train::trainer::Trainer;

/// The precision that the finished scene's tables need.
///
/// # Errors
/// When rendering fails.
pub(crate) fn table_precision(trainer: &mut Trainer) -> Result<TablePrecision, TrainError> {
    if trainer.config.keep == Keep::All {
        return Ok(TablePrecision::Single);
    }
    let Some(rounded) = trainer.scene.with_half_tables() else {
        return Ok(TablePrecision::Single);
    };
    let outcome = super::trials::against(trainer, &rounded)?;
    let total = dash_model::scene_file::parameter_bytes(&trainer.scene) as u64;
    let saved = trainer.scene.table_bytes() / 2;
    let left_out = outcome.is_harmless() && saved as f64 >= MIN_SAVING * total as f64;
    trainer.decisions.push(Decision {
        step: trainer.step,
        part: "half the bits of the field's tables".into(),
        left_out,
        reason: format!("stored as 16-bit floats they may cost at most {MAX_LOSS} dB"),
        db: Some(outcome.mean),
        db_lower: Some(outcome.lower),
        bytes: Some(saved),
    });
    Ok(if left_out {
        TablePrecision::Half
    } else {
        TablePrecision::Single
    })
}
