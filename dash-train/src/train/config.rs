//! Everything that decides a training run.

use dash_model::{DeformationConfig, HashEncoderConfig, OffsetPlacement, TrajectoryBasis};
use serde::{Deserialize, Serialize};

pub use density::{DensityConfig, Oversized};
pub use stages::{StageConfig, TimeWindow};

use crate::Error;

/// Named starting points for a [`TrainConfig`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "snake_case")]
pub enum Preset {
    /// Ours.
    Default,
    /// The paper's equations as written.
    Paper,
    /// The released code's values and forms.
    Reference,
    /// Ours, shortened for a first look on a CPU.
    Quick,
}

/// A training run. Written resolved to `config.toml`: running it again gives the same result.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TrainConfig {
    /// Where the values came from.
    pub preset: Preset,
    /// Optimisation steps, one view each. Stages are shares of it, so a shorter run keeps its form, as
    /// long as there are enough steps to follow motion in.
    pub iterations: usize,
    /// Seed of everything random.
    pub seed: u64,
    /// Largest spherical-harmonics degree, 0 to 3.
    pub sh_degree: usize,
    /// Share of the run after which the active degree rises by one (3DGS: 1,000 of 30,000 steps).
    pub sh_interval: f32,
    /// Colour behind everything, sRGB in [0, 1]. Absent: the dataset's own, or black.
    pub background: Option<[f32; 3]>,
    /// Gaussians nearer to a camera than this are not drawn, world units. Absent: a part of the
    /// distance at which the training cameras see something.
    pub near_plane: Option<f64>,
    /// Gaussians whose mean is farther out of the picture than this, in normalised device coordinates, are not
    /// drawn, but in the steps of training. Absent: all are, as in 3DGS. Ours.
    #[serde(default)]
    pub ndc_limit: Option<f64>,
    /// Training times more than so many typical steps apart are ends of a gap, through which Gaussians go in straight
    /// lines, or turn once where they agree on it. Absent: through gaps, too, the field is asked. Ours.
    #[serde(default)]
    pub gap_steps: Option<f32>,
    /// Most points that the first Gaussians are made of, those where pictures change aside; more are thinned evenly.
    pub max_initial_points: usize,
    /// Where the dataset brings fewer points, others are added at which several views agree.
    pub min_initial_points: usize,
    /// Steps between checkpoints.
    pub checkpoint_interval: usize,
    /// Steps between measurements on the validation view (never a test camera).
    pub validation_interval: usize,
    /// Whether parts that the scene does not need are left out.
    #[serde(default)]
    pub keep: Keep,
    /// The three stages.
    pub stages: StageConfig,
    /// Weights of the losses.
    pub loss: LossConfig,
    /// Learning rates.
    pub learning_rates: LearningRates,
    /// The coarse motion field and the split.
    pub decomposition: DecompositionConfig,
    /// The 4D field.
    pub field: FieldConfig,
    /// Density control of the static Gaussians (of all, before the split).
    pub density_static: DensityConfig,
    /// Density control of the dynamic Gaussians.
    pub density_dynamic: DensityConfig,
}

/// Whether parts that a scene does not need are left out.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "snake_case")]
pub enum Keep {
    /// Every part stays.
    #[default]
    All,
    /// A part goes when measurements say that the scene does without.
    Needed,
}

/// Weights of Eqs. 6 and 12.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LossConfig {
    /// Share of D-SSIM against L1, `lambda_c` (3DGS: 0.2).
    pub dssim: f32,
    /// Weight of the motion of static Gaussians, `lambda_s`, for motion in units of the scene's
    /// diagonal.
    pub static_motion: f32,
    /// Weight of the field's smoothness, `lambda_r`.
    pub smoothness: f32,
    /// Weight of the motion of all Gaussians as it appears on the screen, in shares of the image's
    /// width and as a mean over the picture, while the coarse field looks for motion: it keeps still
    /// what no picture moves. Ours.
    pub field_motion: f32,
    /// Weight of the motion of all Gaussians as it appears on the screen, in shares of the image's
    /// width and as a mean over the picture, once each has a trajectory of its own: what moves
    /// without need comes to rest. Ours.
    pub visible_motion: f32,
    /// Weight of the mean opacity of the static Gaussians (of all, before the split): what no picture
    /// needs, such as dark smoke in the empty space before a dark background, fades. Kheradmand et al.
    /// 2024 take 0.01.
    pub static_opacity: f32,
    /// Weight of what Gaussians (before the split, those at rest) cover of the picture from nearer than half of
    /// the typical distance: dark smoke between the cameras and the scene, which no training picture tells from
    /// what is behind it, fades. Ours.
    #[serde(default)]
    pub nearness: f32,
    /// Share of the dynamic Gaussians, drawn anew at every step, at which the field's smoothness is
    /// measured: it takes the field twice more for each. Ours; 1 in the paper.
    #[serde(default = "one")]
    pub smoothness_share: f32,
    /// Steps of which one has the field's smoothness measured, with so many times the weight: 1, each. Ours.
    #[serde(default = "every_step")]
    pub smoothness_interval: usize,
    /// Weight of how far dynamic Gaussians are from where they would be had they gone in a straight line and at one speed
    /// from a training time before to one after, in units of the scene's extent; where no time by itself shows the
    /// scene's shape. Ours.
    #[serde(default)]
    pub steadiness: f32,
    /// Least share of a camera's pictures that what moved since following began counts as in the absolute error, while
    /// the coarse field looks for motion, if the camera stands still; 0: what it covers. Ours.
    #[serde(default)]
    pub moved_share: f32,
    /// Weight of how far what moves fast is from where it was found (`decomposition.matching_floor`), while the coarse
    /// field looks for motion: what it learns of new frames makes it forget others. Ours.
    #[serde(default)]
    pub found_places: f32,
    /// Half-widths of the random step of Eq. 11 in the unit cube, space then time (released code).
    pub smoothness_step: [f32; 2],
}

/// Adam learning rates, per parameter group.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LearningRates {
    /// Means at the start, in units of the scene's extent (3DGS: 1.6e-4).
    pub means: f32,
    /// Means at the end, reached exponentially (3DGS: 1.6e-6).
    pub means_final: f32,
    /// Factor of `means` where no time shows the scene from several sides, as with cameras that take turns. Ours.
    #[serde(default = "one")]
    pub means_in_turns: f32,
    /// Factor of `scales` and `grid` where each time by itself shows the scene from several sides, as a rig's do. Ours.
    #[serde(default = "one")]
    pub at_once: f32,
    /// Quaternions (3DGS: 1e-3).
    pub quats: f32,
    /// Log scales (3DGS: 5e-3).
    pub scales: f32,
    /// Opacity logits (3DGS: 0.05).
    pub opacities: f32,
    /// Constant colour (3DGS: 2.5e-3).
    pub sh_dc: f32,
    /// Higher colour coefficients (3DGS: a twentieth of `sh_dc`).
    pub sh_rest: f32,
    /// Coarse trajectories, in units of the scene's extent.
    pub trajectories: f32,
    /// Features of Gaussians' own, in fields that take them (E-D3DGS: 2.5e-3).
    #[serde(default = "default_embedding_rate")]
    pub embeddings: f32,
    /// Hash tables and feature planes at the start.
    pub grid: f32,
    /// Decoders at the start.
    pub network: f32,
    /// Hash table of the coarse motion field: it has a short stage to follow all motion in.
    pub motion_grid: f32,
    /// Networks of the coarse motion field.
    pub motion_network: f32,
    /// Part of its typical gradient that is added to Adam's denominator in the networks of the coarse
    /// motion field; 0 is plain Adam. The networks are shared by all of the scene: steps of full length
    /// along next to no gradient would shake what is at rest. Ours.
    pub motion_damping: f32,
    /// What is left of the rates of tables and decoders at the end, reached exponentially.
    pub field_final: f32,
    /// Replaces the scene's measured extent (released code: 5).
    pub extent: Option<f32>,
}

fn one() -> f32 {
    1.0
}

fn every_step() -> usize {
    1
}

fn default_embedding_rate() -> f32 {
    2.5e-3
}

/// How motion is measured for the split.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum MotionMeasure {
    /// `|dp|` in world units, as the paper writes.
    World,
    /// `|dp| / (d^2 + 1e-6)` with the distance `d` to the camera, over many views. (The released
    /// code measures `d` from the wrong point and keeps the last view only; we don't.)
    DistanceWeighted,
    /// `|dp|` as it appears, in shares of the image's width, over many views.
    Screen,
}

/// Which Gaussians become dynamic.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Selection {
    /// Those that the coarse motion field found to move.
    #[default]
    Moving,
    /// All of them, right after the warm-up, as in methods without a decomposition.
    All,
}

/// The coarse motion field and the split.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DecompositionConfig {
    /// Whether anything may move. If not, the run is static 3DGS.
    pub enabled: bool,
    /// Which Gaussians become dynamic.
    #[serde(default)]
    pub select: Selection,
    /// How motion is measured.
    pub measure: MotionMeasure,
    /// Share of the Gaussians that stays static whatever they do (released code: 0.8).
    pub quantile: f32,
    /// Motion, in units of `measure`, below which nothing is dynamic.
    pub floor: f32,
    /// Whether the coarse trajectories carry on into the 4D stage instead of being thrown away.
    pub keep_trajectories: bool,
    /// Form of the coarse trajectories; a polyline of 0 spans gets as many as suit the number of
    /// frames.
    pub basis: TrajectoryBasis,
    /// The 3D encoder.
    pub encoder: HashEncoderConfig,
    /// Units of the tiny network's two layers.
    pub hidden: usize,
    /// Every so many steps of the 4D stage, dynamic Gaussians that don't move become static;
    /// 0 for never.
    pub review_interval: usize,
    /// Motion over the clip, in shares of the image's width, below which a dynamic Gaussian becomes
    /// static.
    pub review_floor: f32,
    /// Error that follows time, root mean square of a channel's range, from which on a static Gaussian under
    /// it becomes dynamic, at reviews before the end of the dynamic set's density control; 0 for never. Ours, and
    /// off: with 0.03 it found nothing in three runs of five, and too little for the others to differ by it.
    #[serde(default)]
    pub promote_floor: f32,
    /// Motion from one frame to the next, in shares of the image's width, from which on Gaussians are looked for in
    /// pictures of a new frame while motion is followed, where several cameras see every frame; 0 for never. Ours.
    #[serde(default)]
    pub matching_floor: f32,
}

/// Where a field's box comes from.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SpaceRule {
    /// From the Gaussians it has to cover; what leaves it is moved to its faces.
    Scene,
    /// `[-bound, bound]^3` in world units; fields are zero outside it.
    Fixed(f32),
}

/// The 4D field.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FieldConfig {
    /// Features and decoder. A time resolution of 0 in the encoder is replaced by one that follows
    /// from the number of frames.
    pub deformation: DeformationConfig,
    /// The box of space that the fields cover.
    pub space: SpaceRule,
    /// Where rotation and scale offsets are added.
    pub offsets: OffsetPlacement,
    /// Factor of the encoder's resolutions in space where no time shows the scene from several sides, as with cameras
    /// that take turns, and pictures lack of three times in a row or more. Ours.
    #[serde(default = "one")]
    pub cells_with_gaps: f32,
}

impl TrainConfig {
    /// Sets one value by its dotted path, such as `loss.dssim=0.1`.
    ///
    /// # Errors
    /// When the path does not exist or the value does not fit.
    pub fn set(&mut self, assignment: &str) -> Result<(), Error> {
        let refuse = |why: String| Error::Config(format!("--set {assignment}: {why}"));
        let (path, value) = assignment
            .split_once('=')
            .ok_or_else(|| refuse("expected KEY=VALUE, such as loss.dssim=0.1".into()))?;
        let mut table = toml::Table::try_from(&*self).map_err(|e| refuse(e.to_string()))?;
        let parsed: toml::Table = format!("v = {value}")
            .parse()
            .or_else(|_| format!("v = \"{value}\"").parse())
            .map_err(|e: toml::de::Error| refuse(e.to_string()))?;
        let mut keys = path.split('.').peekable();
        let mut cursor = &mut table;
        while let Some(key) = keys.next() {
            if keys.peek().is_none() {
                let optional = matches!(
                    path,
                    "background"
                        | "near_plane"
                        | "ndc_limit"
                        | "gap_steps"
                        | "learning_rates.extent"
                );
                if !cursor.contains_key(key) && !optional {
                    let known: Vec<&str> = cursor.keys().map(String::as_str).collect();
                    return Err(refuse(format!(
                        "no key `{key}`; there are {}",
                        known.join(", ")
                    )));
                }
                let mut value = parsed["v"].clone();
                if let (Some(toml::Value::Float(_)), toml::Value::Integer(whole)) =
                    (cursor.get(key), &value)
                {
                    value = toml::Value::Float(*whole as f64);
                }
                cursor.insert(key.into(), value);
                break;
            }
            cursor = cursor
                .get_mut(key)
                .and_then(toml::Value::as_table_mut)
                .ok_or_else(|| refuse(format!("no section `{key}`")))?;
        }
        *self = table
            .try_into()
            .map_err(|e: toml::de::Error| refuse(e.message().to_string()))?;
        self.validate()
    }

    /// The step at a share of the run.
    pub fn step_at(&self, share: f32) -> usize {
        (share * self.iterations as f32).round() as usize
    }
}

mod counts;
mod density;
mod following;
mod frames;
mod ranges;
mod stages;
#[cfg(test)]
pub(crate) mod tests;
