//! What a field has heads for.

use serde::{Deserialize, Serialize};

/// Outputs of the heads.
pub(super) const MEAN: usize = 3;
pub(super) const QUAT: usize = 4;
pub(super) const SCALE: usize = 3;
/// Opacity, then colour.
pub(super) const APPEARANCE: usize = 4;

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

impl Heads {
    /// Those that there are, as files call them, with their outputs.
    pub(super) fn present(&self) -> impl Iterator<Item = (&'static str, usize)> {
        let all = [
            (true, "head_means", MEAN),
            (self.rotation, "head_quats", QUAT),
            (self.scale, "head_scales", SCALE),
            (self.appearance, "head_appearance", APPEARANCE),
        ];
        let present = all.into_iter().filter(|(present, ..)| *present);
        present.map(|(_, name, width)| (name, width))
    }
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
