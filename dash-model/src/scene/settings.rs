//! What rendering needs beside the parameters.

use dash_kernels::splats::NEAR_PLANE;
use serde::{Deserialize, Serialize};

use crate::{Gaps, TrajectoryBasis};

/// Where the field's offsets are added to quaternions and scales.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum OffsetPlacement {
    /// To raw quaternions and log scales; scales stay positive.
    BeforeActivation,
    /// To unit quaternions and scales, as in the released DASH code; a negative scale renders as its absolute value.
    AfterActivation,
}

/// What rendering needs beside the parameters.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SceneSettings {
    /// Colour behind everything, sRGB in [0, 1].
    pub background: [f32; 3],
    /// Active spherical-harmonics degree, at most the stored one.
    pub sh_degree: usize,
    /// Gaussians nearer than this along a camera's z are not drawn, world units.
    pub near_plane: f64,
    /// Basis of the coarse trajectories.
    pub trajectory_basis: TrajectoryBasis,
    /// Where offsets are added to quaternions and scales.
    pub offsets: OffsetPlacement,
    /// Time gaps of the training views, see [`DynamicPart::deform`](crate::DynamicPart::deform).
    #[serde(default, skip_serializing_if = "Gaps::is_empty")]
    pub gaps: Gaps,
}

impl Default for SceneSettings {
    /// A black background, colours of degree 0, 3DGS's near plane, linear trajectories and no time gaps.
    fn default() -> Self {
        Self {
            background: [0.0; 3],
            sh_degree: 0,
            near_plane: NEAR_PLANE,
            trajectory_basis: TrajectoryBasis::Linear,
            offsets: OffsetPlacement::BeforeActivation,
            gaps: Gaps::default(),
        }
    }
}
