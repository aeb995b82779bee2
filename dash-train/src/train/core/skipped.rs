//! Steps that were skipped because something was not finite.

use std::fmt;

use serde::{Deserialize, Serialize};

/// What of a tensor is not finite.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Place {
    /// The parameter itself.
    Values,
    /// Its gradient.
    Gradient,
}

/// Rows of a tensor that are not finite.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct NonFinite {
    /// The parameter's path, such as `scene.static_set.means`.
    pub tensor: String,
    /// What of it.
    pub place: Place,
    /// Rows with a value that is not finite: Gaussians, in a set of these.
    pub n_rows: usize,
    /// All rows of the tensor.
    pub of: usize,
    /// The first of them.
    pub rows: Vec<usize>,
}

impl fmt::Display for NonFinite {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.place == Place::Gradient {
            f.write_str("the gradient of ")?;
        }
        let rows: Vec<String> = self.rows.iter().map(ToString::to_string).collect();
        let more = if self.n_rows > rows.len() { ", .." } else { "" };
        let (n, of) = (self.n_rows, self.of);
        write!(
            f,
            "{} in {n} of {of} rows ({}{more})",
            self.tensor,
            rows.join(", ")
        )
    }
}

/// A step that changed no parameter and no moment.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SkippedStep {
    /// The step, counted from 1.
    pub step: usize,
    /// The view trained on.
    pub view: String,
    /// Whether the loss was finite all the same.
    pub loss_is_finite: bool,
    /// The parameters at fault; none where the loss alone was not finite.
    pub found: Vec<NonFinite>,
    /// What was done about it.
    pub remedies: Vec<String>,
}

impl fmt::Display for SkippedStep {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut what: Vec<String> = self.found.iter().map(ToString::to_string).collect();
        if !self.loss_is_finite {
            what.insert(0, "the loss".into());
        }
        let remedies = match self.remedies.is_empty() {
            true => String::new(),
            false => format!("; {}", self.remedies.join(", ")),
        };
        write!(
            f,
            "step {}, view `{}`: not finite: {}; the step was skipped{remedies}",
            self.step,
            self.view,
            what.join(", ")
        )
    }
}

/// Skipped steps of a run.
#[derive(Debug, Default)]
pub(crate) struct Skipped {
    pub(super) in_a_row: usize,
    pub(super) untold: Vec<SkippedStep>,
}

impl Skipped {
    /// A step was not skipped.
    pub(crate) fn end_row(&mut self) {
        self.in_a_row = 0;
    }

    /// The steps skipped since the last call.
    pub(crate) fn take(&mut self) -> Vec<SkippedStep> {
        std::mem::take(&mut self.untold)
    }
}
