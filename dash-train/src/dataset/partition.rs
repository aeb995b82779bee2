//! Which views are trained on, and which are held out for testing.

use std::fmt;

use serde::{Deserialize, Serialize};

/// Without a stated choice, one view of this many is held out (3DGS convention).
const HOLD_OUT_EVERY: usize = 8;

/// Whether a view is trained on or held out.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Partition {
    /// Trained on.
    Train,
    /// Held out for testing.
    Test,
}

impl Partition {
    /// [`Partition::Test`] for a view that is held out.
    pub(crate) fn held_out(held_out: bool) -> Self {
        if held_out { Self::Test } else { Self::Train }
    }
}

impl fmt::Display for Partition {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Train => "train",
            Self::Test => "test",
        })
    }
}

/// Every eighth of `n` views, unless there is only one.
pub(crate) fn every_eighth(n: usize) -> Vec<bool> {
    (0..n)
        .map(|index| n > 1 && index.is_multiple_of(HOLD_OUT_EVERY))
        .collect()
}
