//! Pruning of what a scene does not need: each part has a rule by which it is kept or left out, and what was decided is
//! recorded with what was measured.

mod evidence;
mod parts;
mod trials;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::Error;
use crate::train::core::{Decision, Extension, Finished, Ranges, Run, Saved, Section};
use crate::train::paper::Dash;

/// Most that pictures may lose when all that was left out is counted, dB: by the lower bound of the mean over training
/// views.
const MAX_TOTAL_LOSS: f64 = 0.02;
/// Share of the scene's bytes, or of its field's arithmetic, that a part must take to be worth leaving out.
const MIN_SAVING: f64 = 0.03;
/// The name of the decision whether anything moves.
const FIELD: &str = "4D field";

/// `[extensions.prune]`
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PruneConfig {
    /// Most that pictures may lose when a part is left out, dB: over all pixels and where something moves, by the lower
    /// bound of the mean over training views. Source: ours.
    pub max_loss_db: f64,
}

impl Section for PruneConfig {
    fn check(&self, ranges: &mut Ranges) {
        ranges.positive("max_loss_db", self.max_loss_db as f32);
    }
}

impl Default for PruneConfig {
    fn default() -> Self {
        Self { max_loss_db: 0.007 }
    }
}

/// See [`PruneConfig`].
pub struct Prune {
    config: PruneConfig,
    /// What was decided before training.
    decisions: Vec<Decision>,
}

impl Prune {
    /// From its section.
    pub fn new(config: PruneConfig) -> Self {
        Self {
            config,
            decisions: Vec::new(),
        }
    }
}

impl Extension<Dash> for Prune {
    fn name(&self) -> &'static str {
        "prune"
    }

    /// Before the first step: whether anything moves.
    fn begin(&mut self, run: &mut Run<Dash>) -> Result<(), Error> {
        if run.step == 0 && run.may_move() && self.decisions.is_empty() {
            self.decisions.extend(evidence::of_motion(run)?);
            run.method.nothing_moves = self.decisions.iter().any(|decision| decision.left_out);
        }
        Ok(())
    }

    fn finish(&self, run: &Run<Dash>, finished: Finished) -> Result<Finished, Error> {
        let mut trials = trials::Trials::new(run, finished.scene, self.config.max_loss_db)?;
        let shares = parts::gaussians(&mut trials)?;
        parts::heads(&mut trials)?;
        parts::levels(&mut trials)?;
        parts::directions(&mut trials, &shares)?;
        parts::unread_entries(&mut trials)?;
        parts::table_bits(&mut trials)?;
        let mut decisions = finished.decisions;
        decisions.extend(self.decisions.iter().cloned());
        decisions.extend(trials.decisions);
        Ok(Finished {
            scene: trials.scene,
            precision: trials.precision,
            decisions,
        })
    }

    fn save(&self) -> Saved {
        Saved::of_values(&self.decisions)
    }

    fn restore(&mut self, _run: &Run<Dash>, saved: Saved) -> Result<(), String> {
        self.decisions = saved.read()?;
        Ok(())
    }
}
