//! Sizes, learning rates and schedules of methods as their authors published them, and the one rule that scales them.
//!
//! Values are those for Neural 3D Video, 300 frames of about 20 synchronised cameras: the papers' largest dataset, and the
//! only one that all of these methods have arguments for. Paths are in the authors' repositories.

use dash_model::Representation;

use super::config::{FieldConfig, TimeResolution};
use crate::train::core::OptimizerConfig;

/// Fewest levels of a grid that has a coarsest and a finest one.
const MIN_LEVELS: usize = 2;

/// A method as its authors published it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Published {
    /// The field.
    pub field: FieldSizes,
    /// Its learning rates.
    pub rates: FieldRates,
    /// When what happens.
    pub schedule: Schedule,
}

/// Sizes of a field.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FieldSizes {
    /// How features over space and time are stored.
    pub representation: Representation,
    /// Levels of grids over space, of planes, or half of the features of a Gaussian's embedding.
    pub n_levels: usize,
    /// Entries of a level's table, as a power of two. Planes and embeddings have no hash tables.
    pub log2_hashmap_size: u32,
    /// Cells a side in space of the coarsest and the finest level.
    pub resolution: [u32; 2],
    /// Cells along time of the coarsest and the finest level, for 300 frames.
    pub time_resolution: [u32; 2],
    /// Units of the hidden layers.
    pub hidden: usize,
}

/// Learning rates of a field.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FieldRates {
    /// Of tables and planes; absent where they learn as the network.
    pub grid: Option<f32>,
    /// Of the network.
    pub network: f32,
    /// Factor at the end.
    pub last: f32,
}

/// When what happens, in steps of the published run.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Schedule {
    /// All of the run.
    pub steps: usize,
    /// Steps in which nothing is deformed.
    pub warmup: usize,
    /// First and last step of density control.
    pub densify: [usize; 2],
    /// Steps between opacity resets; absent: none.
    pub opacity_reset_interval: Option<usize>,
}

/// DASH's field: the measure of the presets. Sources: sizes of the paper, rates of the released code.
pub const DASH: (FieldSizes, FieldRates) = (
    FieldSizes {
        representation: Representation::Hash,
        n_levels: 16,
        log2_hashmap_size: 17,
        resolution: [8, 2048],
        time_resolution: [8, 25],
        hidden: 128,
    },
    FieldRates {
        grid: Some(8e-3),
        network: 1.6e-4,
        last: 0.01,
    },
);

/// 4DGaussians (Wu et al. 2024), hustvl/4DGaussians at `843d5ac`.
pub const HEXPLANE: Published = Published {
    field: FieldSizes {
        representation: Representation::HexPlane,
        // arguments/dynerf/default.py: multires = [1, 2].
        n_levels: 2,
        log2_hashmap_size: DASH.0.log2_hashmap_size,
        // The same: resolution = [64, 64, 64, 150]; scene/hexplane.py multiplies the first three.
        resolution: [64, 128],
        time_resolution: [150, 150],
        // The same: net_width = 128.
        hidden: 128,
    },
    rates: FieldRates {
        // arguments/__init__.py: grid_lr_init, deformation_lr_init and their ends.
        grid: Some(1.6e-3),
        network: 1.6e-4,
        last: 0.1,
    },
    schedule: Schedule {
        // arguments/dynerf/default.py: coarse_iterations = 3000, iterations = 14000.
        steps: 17_000,
        warmup: 3_000,
        // arguments/__init__.py: densify_from_iter; dynerf: densify_until_iter = 10_000, after the coarse stage.
        densify: [500, 13_000],
        // dynerf: opacity_reset_interval = 60000, beyond the end.
        opacity_reset_interval: None,
    },
};

/// Features of a level of a plane. Source: arguments/dynerf/default.py, output_coordinate_dim.
pub const HEXPLANE_FEATURES: usize = 16;

/// Grid4D (Xu et al. 2024), JiaweiXu8/Grid4D at `c9a93fb`.
pub const GRID4D: Published = Published {
    field: FieldSizes {
        representation: Representation::Grid4d,
        // arguments/neu3d/coffee_martini.py: canonical_num_levels, canonical_log2_hashmap_size.
        n_levels: 16,
        log2_hashmap_size: 19,
        // The same: canonical_base_resolution, canonical_desired_resolution.
        resolution: [16, 2048],
        // The same, third axis: deform_base_resolution = 16, deform_desired_resolution = [64, 64, 128].
        time_resolution: [16, 128],
        // The same: width.
        hidden: 256,
    },
    rates: FieldRates {
        // The same: grid_lr_scale = 50 and network_lr_scale = 1, of position_lr_init = 1.6e-4; scene/deform_model.py: both
        // end at a hundredth.
        grid: Some(8e-3),
        network: 1.6e-4,
        last: 0.01,
    },
    schedule: Schedule {
        // arguments/__init__.py: iterations, warm_up, densify_from_iter, densify_until_iter.
        steps: 50_000,
        warmup: 3_000,
        densify: [500, 15_000],
        // arguments/neu3d/coffee_martini.py.
        opacity_reset_interval: Some(6_000),
    },
};

/// Levels of Grid4D's grids with time. Source: arguments/neu3d/coffee_martini.py, deform_num_levels.
pub const GRID4D_TEMPORAL_LEVELS: usize = 32;
/// Their cells a side in space. Source: the same, deform_base_resolution and deform_desired_resolution.
pub const GRID4D_TEMPORAL_RESOLUTION: [u32; 2] = [16, 64];

/// E-D3DGS (Bae et al. 2024), JeongminB/E-D3DGS at `a68543e`.
pub const EMBEDDING: Published = Published {
    field: FieldSizes {
        representation: Representation::Embedding,
        // arguments/__init__.py: gaussian_embedding_dim = 32.
        n_levels: 16,
        log2_hashmap_size: DASH.0.log2_hashmap_size,
        resolution: DASH.0.resolution,
        // The same: min_embeddings, max_embeddings.
        time_resolution: [30, 150],
        // arguments/dynerf/default.py: net_width.
        hidden: 128,
    },
    rates: FieldRates {
        // scene/gaussian_model.py: one group of parameters. arguments/__init__.py: deformation_lr_init and its end.
        grid: None,
        network: 1.6e-4,
        last: 0.1,
    },
    schedule: Schedule {
        // arguments/dynerf/default.py: iterations, densify_from_iter, densify_until_iter.
        steps: 80_000,
        // scene/deformation.py: positions are deformed from the first step on.
        warmup: 0,
        densify: [5_000, 80_000],
        // arguments/__init__.py: opacity_reset_interval = 6000000, beyond the end.
        opacity_reset_interval: None,
    },
};

/// Features of a time. The model has eight for each feature of a Gaussian's own. Source: arguments/__init__.py,
/// temporal_embedding_dim.
pub const EMBEDDING_FEATURES_OF_TIME: usize = 256;

/// How a preset differs from what DASH's authors published. Every method changes in the same ratio.
///
/// - Sizes: where the preset's own 4D field has fewer levels, fewer entries in a table or narrower layers than the paper's,
///   so has every method's field. None is larger than published. Cells do not change: a finer grid costs no more.
/// - Rates: where the preset's own tables and networks learn faster or slower than the released code's, so do every
///   method's.
/// - Schedules: shares of the run, see [`Schedule::share`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Scale {
    /// Factor of levels.
    pub levels: f32,
    /// How many times a table's entries are halved.
    pub halvings: u32,
    /// Factor of widths.
    pub widths: f32,
    /// Factor of the rate of tables.
    pub grid_rate: f32,
    /// Factor of the rate of networks.
    pub network_rate: f32,
}

impl Scale {
    /// Of a preset with this 4D field and these rates.
    pub fn of(field: &FieldConfig, optimizer: &OptimizerConfig) -> Self {
        let (sizes, rates) = DASH;
        let smaller = |own: usize, published: usize| (own as f32 / published as f32).min(1.0);
        Self {
            levels: smaller(field.n_levels, sizes.n_levels),
            halvings: sizes
                .log2_hashmap_size
                .saturating_sub(field.log2_hashmap_size),
            widths: smaller(field.hidden, sizes.hidden),
            grid_rate: optimizer.grid / rates.grid.unwrap_or(rates.network),
            network_rate: optimizer.network / rates.network,
        }
    }

    /// A published field at this scale.
    pub fn field(self, published: &FieldSizes) -> FieldConfig {
        let scaled = |size: usize, factor: f32| (size as f32 * factor).ceil() as usize;
        FieldConfig {
            representation: published.representation,
            n_levels: scaled(published.n_levels, self.levels).max(MIN_LEVELS),
            log2_hashmap_size: published
                .log2_hashmap_size
                .saturating_sub(self.halvings)
                .max(1),
            resolution: published.resolution,
            time_resolution: TimeResolution::Of300Frames(published.time_resolution),
            hidden: scaled(published.hidden, self.widths).max(1),
        }
    }

    /// Published learning rates at this scale, beside `preset`'s for what is no field.
    pub fn rates(self, published: &FieldRates, preset: &OptimizerConfig) -> OptimizerConfig {
        let network = published.network * self.network_rate;
        OptimizerConfig {
            grid: published.grid.map_or(network, |rate| rate * self.grid_rate),
            network,
            field_final: published.last,
            ..preset.clone()
        }
    }
}

impl Schedule {
    /// A step as a share of the run.
    pub fn share(&self, step: usize) -> f32 {
        step as f32 / self.steps as f32
    }

    /// An interval of the published run in a run of so many steps.
    pub fn interval(&self, interval: usize, steps: usize) -> usize {
        let scaled = interval as f64 * steps as f64 / self.steps as f64;
        (scaled.round() as usize).max(1)
    }
}

/// Features of a level of planes below a decoder of so many units, in 4DGaussians' ratio; the encoder has no more than eight.
pub(super) fn plane_features(hidden: usize) -> usize {
    let wanted = hidden * HEXPLANE_FEATURES / HEXPLANE.field.hidden;
    [8, 4, 2].into_iter().find(|&n| n <= wanted).unwrap_or(1)
}

/// Levels of Grid4D's grids with time beside so many of the one in space, in its ratio.
pub(super) fn temporal_levels(n_levels: usize) -> usize {
    n_levels * GRID4D_TEMPORAL_LEVELS / GRID4D.field.n_levels
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::train::core::CaptureFacts;
    use crate::train::{Preset, TrainConfig};

    const OTHERS: [Published; 3] = [HEXPLANE, GRID4D, EMBEDDING];

    fn scale(preset: Preset) -> Scale {
        let config = TrainConfig::preset(preset);
        Scale::of(&config.method.field, &config.optimizer)
    }

    #[test]
    fn a_preset_of_the_published_size_leaves_every_size_as_published() {
        for preset in [Preset::Paper, Preset::Reference] {
            for published in OTHERS {
                let (sizes, field) = (published.field, scale(preset).field(&published.field));
                assert_eq!(field.n_levels, sizes.n_levels, "{preset:?}");
                assert_eq!(field.log2_hashmap_size, sizes.log2_hashmap_size);
                assert_eq!(field.hidden, sizes.hidden);
            }
        }
        let rates = scale(Preset::Reference).rates(
            &GRID4D.rates,
            &TrainConfig::preset(Preset::Reference).optimizer,
        );
        assert!((rates.grid - 8e-3).abs() < 1e-9 && (rates.network - 1.6e-4).abs() < 1e-9);
    }

    #[test]
    fn a_smaller_preset_makes_every_field_smaller_in_one_ratio() {
        // `quick`: half the levels, a quarter of the entries, half the width.
        let scale = scale(Preset::Quick);
        assert_eq!((scale.levels, scale.halvings, scale.widths), (0.5, 2, 0.5));
        let of = |published: &Published| {
            let field = scale.field(&published.field);
            (field.n_levels, field.log2_hashmap_size, field.hidden)
        };
        assert_eq!(of(&GRID4D), (8, 17, 128));
        // Two levels are the fewest.
        assert_eq!(of(&HEXPLANE), (2, 15, 64));
        assert_eq!(of(&EMBEDDING), (8, 15, 64));
    }

    #[test]
    fn a_preset_that_learns_faster_makes_every_field_learn_faster() {
        let preset = TrainConfig::preset(Preset::Quick).optimizer;
        let scale = scale(Preset::Quick);
        let rates = |published: &Published| {
            let rates = scale.rates(&published.rates, &preset);
            [rates.grid, rates.network]
        };
        let near = |found: [f32; 2], expected: [f32; 2]| {
            for (found, expected) in found.into_iter().zip(expected) {
                assert!((found / expected - 1.0).abs() < 1e-5, "{found}, {expected}");
            }
        };
        // DASH's authors took these rates from Grid4D.
        near(rates(&GRID4D), [preset.grid, preset.network]);
        near(rates(&HEXPLANE), [preset.grid / 5.0, preset.network]);
        near(rates(&EMBEDDING), [preset.network; 2]);
    }

    #[test]
    fn schedules_are_shares_of_the_run() {
        let schedule = GRID4D.schedule;
        assert_eq!(schedule.share(schedule.warmup), 0.06);
        assert_eq!(schedule.interval(6_000, 50_000), 6_000);
        assert_eq!(schedule.interval(6_000, 5_000), 600);
        assert_eq!(schedule.interval(6_000, 1), 1);
    }

    #[test]
    fn sizes_that_follow_from_others_are_as_published_at_the_published_size() {
        let facts = CaptureFacts {
            n_frames: 300,
            is_synchronized: true,
        };
        let deformation = |published: &Published| {
            let mut method = TrainConfig::preset(Preset::Paper).method;
            method.field = scale(Preset::Paper).field(&published.field);
            method.deformation(&facts)
        };
        let grid4d = deformation(&GRID4D);
        assert_eq!(grid4d.encoder.finest_resolution, [2048, 2048, 2048, 128]);
        let temporal = grid4d.temporal.expect("grids of their own");
        assert_eq!((temporal.n_levels, temporal.log2_hashmap_size), (32, 19));
        assert_eq!(temporal.base_resolution, [16; 4]);
        assert_eq!(temporal.finest_resolution, [64, 64, 64, 128]);
        let hexplane = deformation(&HEXPLANE).encoder;
        assert_eq!(hexplane.base_resolution, [64, 64, 64, 150]);
        assert_eq!(hexplane.finest_resolution, [128, 128, 128, 150]);
        let embedding = deformation(&EMBEDDING);
        assert_eq!(embedding.embedding_width(), 32);
        assert_eq!(8 * embedding.embedding_width(), EMBEDDING_FEATURES_OF_TIME);
        assert_eq!(embedding.encoder.base_resolution[3], 30);
        // Of fewer frames, time has fewer cells.
        let facts = CaptureFacts {
            n_frames: 50,
            ..facts
        };
        let cells = TimeResolution::Of300Frames([30, 150]).cells(&facts);
        assert_eq!(cells, [5, 25]);
    }

    #[test]
    fn planes_have_the_most_features_that_the_encoder_has() {
        assert_eq!([8, 16, 64, 128, 256].map(plane_features), [1, 2, 8, 8, 8]);
    }
}
