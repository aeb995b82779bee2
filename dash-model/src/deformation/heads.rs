//! What a field has heads for.

use serde::{Deserialize, Serialize};

/// What a field changes beside positions.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Heads {
    /// Rotations.
    pub rotation: bool,
    /// Scales.
    pub scale: bool,
    /// Opacities and constant colours. Not in DASH; E-D3DGS has it.
    pub appearance: bool,
}

/// A head that a field can do without.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Head {
    /// See [`Heads::rotation`].
    Rotation,
    /// See [`Heads::scale`].
    Scale,
}

impl Default for Heads {
    /// Those of DASH.
    fn default() -> Self {
        Self {
            rotation: true,
            scale: true,
            appearance: false,
        }
    }
}
