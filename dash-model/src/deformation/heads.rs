//! Heads of the decoder.

use serde::{Deserialize, Serialize};

/// Widths of the heads.
pub(super) const MEAN: usize = 3;
pub(super) const QUAT: usize = 4;
pub(super) const SCALE: usize = 3;
/// Opacity, then colour.
pub(super) const APPEARANCE: usize = 4;
/// Channels of a higher colour coefficient.
pub(super) const CHANNELS: usize = 3;
/// Most higher colour coefficients: those of degree 3.
pub(super) const MAX_SH_REST: usize = 15;

/// What a field changes beside positions, with one head each.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Heads {
    /// Rotations.
    pub rotation: bool,
    /// Scales.
    pub scale: bool,
    /// Opacities and constant colours. 4DGaussians and E-D3DGS have this head, the paper's DASH does not.
    pub appearance: bool,
    /// How many higher colour coefficients: none, or all that the Gaussians have.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub sh_rest: usize,
}

fn is_zero(n: &usize) -> bool {
    *n == 0
}

impl Heads {
    /// Names in files, and widths, of the heads that are present.
    pub(super) fn present(&self) -> impl Iterator<Item = (&'static str, usize)> {
        let all = [
            (true, "head_means", MEAN),
            (self.rotation, "head_quats", QUAT),
            (self.scale, "head_scales", SCALE),
            (self.appearance, "head_appearance", APPEARANCE),
            (
                self.sh_rest > 0,
                "head_sh_rest",
                self.sh_rest.saturating_mul(CHANNELS),
            ),
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
    /// See [`Heads::appearance`].
    Appearance,
}

impl Default for Heads {
    /// The heads of DASH.
    fn default() -> Self {
        Self {
            rotation: true,
            scale: true,
            appearance: false,
            sh_rest: 0,
        }
    }
}
