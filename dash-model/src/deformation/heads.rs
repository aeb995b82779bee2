//! Heads of the decoder.

use serde::{Deserialize, Serialize};

/// Widths of the heads.
pub(super) const MEAN: usize = 3;
pub(super) const QUAT: usize = 4;
pub(super) const SCALE: usize = 3;
/// Opacity, then colour.
pub(super) const APPEARANCE: usize = 4;

/// What a field changes beside positions, with one head each.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Heads {
    /// Rotations.
    pub rotation: bool,
    /// Scales.
    pub scale: bool,
    /// Opacities and constant colours. E-D3DGS has this head, DASH does not.
    pub appearance: bool,
}

impl Heads {
    /// Names in files, and widths, of the heads that are present.
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

/// A head that can be pruned.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Head {
    /// See [`Heads::rotation`].
    Rotation,
    /// See [`Heads::scale`].
    Scale,
}

impl Default for Heads {
    /// The heads of DASH.
    fn default() -> Self {
        Self {
            rotation: true,
            scale: true,
            appearance: false,
        }
    }
}
