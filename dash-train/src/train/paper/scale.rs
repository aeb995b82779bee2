//! Published methods at the scale of a preset.

use super::config::{FieldConfig, TimeResolution};
use super::published::{DASH, FieldRates, FieldSizes};
use crate::train::core::OptimizerConfig;

/// Fewest levels of a grid that has a coarsest and a finest one.
const MIN_LEVELS: usize = 2;

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

#[cfg(test)]
mod tests {
    use super::super::published::*;
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
