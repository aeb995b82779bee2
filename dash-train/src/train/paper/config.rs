//! The configuration of DASH.

use dash_model::{DeformationConfig, HashEncoderConfig, Heads, OffsetPlacement, Representation};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::published::{GRID4D_TEMPORAL_RESOLUTION, plane_features, temporal_levels};
use crate::train::core::{CaptureFacts, Ranges};

/// Features of the levels of a hash grid. Source: Instant-NGP.
pub(crate) const FEATURES_PER_LEVEL: usize = 2;
/// Hidden layers of the decoder. Source: the released code; 4DGaussians and E-D3DGS have as many, the last one for each
/// head.
pub(crate) const LAYERS: usize = 2;
/// The same behind Grid4D's weighted features. Source: Grid4D, arguments/__init__.py.
const GRID4D_LAYERS: usize = 1;

/// Most units of a hidden layer.
const MAX_UNITS: usize = 4096;

/// DASH: stages, decomposition, fields.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct MethodConfig {
    /// Which Gaussians become dynamic. `moving`: those that the coarse field moves. `all_with_motion`: all, with coarse motion.
    /// `all`: all, right after the warm-up, without coarse motion. `none`: none, as in 3DGS. Source: the paper, `moving`.
    pub decomposition: Decomposition,
    /// Ends of the warm-up and of the decomposition, as shares of the run. Source: released code, 0.04 and 0.08.
    pub stages: [f32; 2],
    /// Whether the fields are those of the paper or have the released code's forms: smoothstep interpolation, its sizes
    /// of tables, offsets after activation, a fixed box. Source: the paper.
    pub form: Form,
    /// How motion is measured. Source: the paper, `world`.
    pub measure: MotionMeasure,
    /// Share of the Gaussians that stays static whatever they do. Source: released code, 0.8.
    pub static_quantile: f32,
    /// Motion, in units of `measure`, below which nothing is dynamic. Source: ours.
    pub motion_floor: f32,
    /// Form of the coarse trajectories. The paper's lines are thrown away after the decomposition; polylines carry on.
    /// Source: the paper, `linear`.
    pub trajectories: Trajectories,
    /// Weight of the motion of static Gaussians (Eq. 5), in units of the scene's diagonal. Source: released code, 0.1.
    pub static_motion: f32,
    /// Weight of the 4D field's smoothness (Eq. 11). Source: released code, 1.
    pub smoothness: f32,
    /// Share of the dynamic Gaussians, drawn anew at every step, at which smoothness is measured. Source: ours; 1 in the
    /// paper.
    pub smoothness_share: f32,
    /// Steps between two evaluations of the smoothness; its weight is multiplied by this number. Source: ours; 1 in the paper.
    pub smoothness_interval: usize,
    /// The coarse motion field (Eq. 3).
    pub motion_field: MotionFieldConfig,
    /// The 4D field (Eqs. 7-9).
    pub field: FieldConfig,
}

/// The coarse motion field.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct MotionFieldConfig {
    /// Levels of its hash grid. Source: Instant-NGP, 16; released code 32.
    pub n_levels: usize,
    /// Entries of a level's table, as a power of two. Source: released code, 16.
    pub log2_hashmap_size: u32,
    /// Cells a side of the coarsest and the finest level. Source: released code, 16 to 2048.
    pub resolution: [u32; 2],
    /// Units of its network's two layers. Source: Instant-NGP, 64; released code 256 of one layer.
    pub hidden: usize,
    /// Learning rate of its hash table. Source: ours; released code 8e-3.
    pub grid_rate: f32,
    /// Learning rate of its network. Source: ours; released code 1.6e-4.
    pub network_rate: f32,
}

/// The 4D field.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct FieldConfig {
    /// How features over space and time are stored: `hash`, `hexplane`, `grid4d` or `embedding`. Source: the paper, `hash`.
    #[schemars(with = "String")]
    pub representation: Representation,
    /// Levels of its grid. Source: Instant-NGP, 16; released code 32.
    pub n_levels: usize,
    /// Entries of a level's table, as a power of two. Source: ours; released code 19.
    pub log2_hashmap_size: u32,
    /// Cells a side in space of the coarsest and the finest level. Source: released code, 8 to 2048.
    pub resolution: [u32; 2],
    /// Cells along time of the coarsest and the finest level. Source: ours; released code 8 to 25.
    pub time_resolution: TimeResolution,
    /// Units of the decoder's hidden layers. Source: 4DGaussians, 128; released code 256.
    pub hidden: usize,
}

impl MethodConfig {
    /// The ranges of its keys.
    pub(crate) fn check(&self, ranges: &mut Ranges) {
        for share in self.stages {
            ranges.share("stages", share);
        }
        ranges.in_order("stages", self.stages);
        ranges.share("static_quantile", self.static_quantile);
        ranges.not_negative("motion_floor", self.motion_floor);
        ranges.not_negative("static_motion", self.static_motion);
        ranges.not_negative("smoothness", self.smoothness);
        ranges.factor("smoothness_share", self.smoothness_share);
        ranges.at_least_one("smoothness_interval", self.smoothness_interval);
        let (motion, field) = (&self.motion_field, &self.field);
        for (name, n_levels, resolution, hidden) in [
            (
                "motion_field",
                motion.n_levels,
                motion.resolution,
                motion.hidden,
            ),
            ("field", field.n_levels, field.resolution, field.hidden),
        ] {
            ranges.section(name, |ranges| {
                ranges.at_least_one("n_levels", n_levels);
                ranges.at_least_one("resolution", resolution[0] as usize);
                ranges.in_order("resolution", resolution);
                ranges.up_to("hidden", MAX_UNITS, hidden);
            });
        }
        ranges.section("motion_field", |ranges| {
            ranges.not_negative("grid_rate", motion.grid_rate);
            ranges.not_negative("network_rate", motion.network_rate);
        });
    }
}

/// Cells of a grid along time.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum TimeResolution {
    /// One vertex for each frame at every level, where synchronised cameras show it; else one for two frames.
    PerFrame,
    /// From so many cells at the coarsest level to those of `per_frame` at the finest.
    UpToFrames(u32),
    /// From the first number to the second.
    Fixed([u32; 2]),
    /// From the first number to the second for 300 frames, and in proportion for others.
    Of300Frames([u32; 2]),
}

/// Which Gaussians become dynamic.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Decomposition {
    /// Those that the coarse motion field found to move.
    Moving,
    /// All of them, with the coarse motion that the field found.
    AllWithMotion,
    /// All of them, right after the warm-up.
    All,
    /// None: static 3DGS.
    None,
}

/// Whose forms the fields have.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Form {
    /// The paper's equations.
    Paper,
    /// The released code's.
    Released,
}

impl Form {
    /// The scene's extent where it is not measured, world units. Source: the released code, 5.
    pub(crate) fn extent(self) -> Option<f32> {
        match self {
            Self::Paper => None,
            Self::Released => Some(5.0),
        }
    }
}

/// How motion is measured for the decomposition.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum MotionMeasure {
    /// `|dp|` in world units, as the paper writes.
    World,
    /// `|dp| / (d^2 + 1e-6)` with the distance `d` to the camera, over many views. (The released
    /// code measures `d` from the wrong point and keeps the last view only; we don't.)
    DistanceWeighted,
    /// `|dp|` on the screen, in shares of the image's width, over many views.
    Screen,
}

/// Form of the coarse trajectories.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Trajectories {
    /// Straight, at one speed (Eq. 3); thrown away after the decomposition.
    Linear,
    /// A polyline with a span for two frames, at most 48; dynamic Gaussians keep theirs.
    Polyline,
}

impl MethodConfig {
    /// The encoder of the coarse motion field.
    pub(crate) fn motion_encoder(&self) -> HashEncoderConfig {
        let config = &self.motion_field;
        let [base, finest] = config.resolution;
        self.encoder(
            config.n_levels,
            FEATURES_PER_LEVEL,
            config.log2_hashmap_size,
            [vec![base; 3], vec![finest; 3]],
        )
    }

    /// The 4D field for a capture.
    pub(crate) fn deformation(&self, facts: &CaptureFacts) -> DeformationConfig {
        let field = &self.field;
        let time = field.time_resolution.cells(facts);
        let cells = |space: [u32; 2]| {
            [0, 1].map(|k| {
                let side = space[k];
                vec![side, side, side, time[k]]
            })
        };
        let (features, layers) = match field.representation {
            Representation::HexPlane => (plane_features(field.hidden), LAYERS),
            Representation::Grid4d => (FEATURES_PER_LEVEL, GRID4D_LAYERS),
            Representation::Hash | Representation::Embedding => (FEATURES_PER_LEVEL, LAYERS),
        };
        let log2 = field.log2_hashmap_size;
        let temporal = (field.representation == Representation::Grid4d).then(|| {
            self.encoder(
                temporal_levels(field.n_levels),
                features,
                log2,
                cells(GRID4D_TEMPORAL_RESOLUTION),
            )
        });
        DeformationConfig {
            representation: field.representation,
            heads: Heads {
                appearance: self.deforms_colour(),
                ..Heads::default()
            },
            encoder: self.encoder(field.n_levels, features, log2, cells(field.resolution)),
            temporal,
            hidden: field.hidden,
            layers,
        }
    }

    /// Whether the field changes opacities and all colour coefficients, as 4DGaussians and E-D3DGS do on Neural 3D Video.
    pub(crate) fn deforms_colour(&self) -> bool {
        matches!(
            self.field.representation,
            Representation::HexPlane | Representation::Embedding
        )
    }

    /// Where rotation and scale offsets are added.
    pub(crate) fn offsets(&self) -> OffsetPlacement {
        match self.form {
            Form::Paper => OffsetPlacement::BeforeActivation,
            Form::Released => OffsetPlacement::AfterActivation,
        }
    }

    fn encoder(
        &self,
        n_levels: usize,
        n_features_per_level: usize,
        log2_hashmap_size: u32,
        [base_resolution, finest_resolution]: [Vec<u32>; 2],
    ) -> HashEncoderConfig {
        let released = self.form == Form::Released;
        HashEncoderConfig {
            n_levels,
            n_features_per_level,
            log2_hashmap_size,
            base_resolution,
            finest_resolution,
            smoothstep: released,
            reference_sizing: released,
            pruned_levels: Vec::new(),
        }
    }
}

impl TimeResolution {
    /// Cells of the coarsest and the finest level for a capture. Where synchronised cameras show every frame, the finest
    /// level has a vertex at each, so that a bounce within one is not cut short; else each frame is one picture, and two
    /// share a cell. Frames that are held out get no vertex: it would learn nothing.
    pub(crate) fn cells(self, facts: &CaptureFacts) -> [u32; 2] {
        let per_frame = if facts.is_synchronized {
            facts.n_frames.saturating_sub(1).max(2)
        } else {
            spans(facts.n_frames)
        } as u32;
        match self {
            Self::PerFrame => [per_frame; 2],
            Self::UpToFrames(base) => [per_frame.min(base), per_frame],
            Self::Fixed(cells) => cells,
            Self::Of300Frames(cells) => cells.map(|cells| {
                let share = facts.n_frames as f64 / 300.0;
                ((f64::from(cells) * share).round() as u32).max(2)
            }),
        }
    }
}

/// One span for every two frames.
pub(crate) fn spans(n_frames: usize) -> usize {
    n_frames.div_ceil(2).max(2)
}
