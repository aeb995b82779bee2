//! The two sets of Gaussians by name.

/// A set of Gaussians of the scene.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Set {
    /// Those that never move; all of them, before a method makes some dynamic.
    Static,
    /// Those that a field deforms.
    Dynamic,
}

impl Set {
    /// Both.
    pub const BOTH: [Self; 2] = [Self::Static, Self::Dynamic];

    /// Path prefix of its parameters, such as `scene.static_set.`.
    pub fn prefix(self) -> &'static str {
        match self {
            Self::Static => "scene.static_set.",
            Self::Dynamic => "scene.dynamic.gaussians.",
        }
    }

    /// What people call it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Static => "static",
            Self::Dynamic => "dynamic",
        }
    }
}

/// A change of the rows of a set. State per Gaussian follows it.
#[derive(Debug, Clone, PartialEq)]
pub struct RowEdit {
    /// The set.
    pub set: Set,
    /// For each row after the edit, the row that it came from; `None` for a new Gaussian.
    pub sources: Vec<Option<usize>>,
    /// Rows before it.
    pub n_before: usize,
}
