//! The values of the presets.

use dash_kernels::splats::NEAR_PLANE;
use dash_model::{
    DeformationConfig, HashEncoderConfig, Heads, OffsetPlacement, Representation, TrajectoryBasis,
};

use super::config::{
    DecompositionConfig, DensityConfig, FieldConfig, Keep, LearningRates, LossConfig,
    MotionMeasure, Oversized, Preset, Selection, SpaceRule, StageConfig, TimeWindow, TrainConfig,
};

/// Between one step and two of these.
const GAP_STEPS: f32 = 1.5;

impl TrainConfig {
    /// The values of a preset.
    pub fn preset(preset: Preset) -> Self {
        let mut config = Self::ours();
        config.preset = preset;
        match preset {
            Preset::Default => {}
            Preset::Quick => config.shorten(),
            Preset::Paper => config.as_in_the_paper(),
            Preset::Reference => config.as_released(),
        }
        config
    }

    fn ours() -> Self {
        Self {
            preset: Preset::Default,
            iterations: 15_000,
            seed: 0,
            sh_degree: 3,
            sh_interval: 1.0 / 15.0,
            background: None,
            near_plane: None,
            gap_steps: Some(GAP_STEPS),
            max_initial_points: 100_000,
            min_initial_points: 20_000,
            checkpoint_interval: 1_000,
            validation_interval: 500,
            keep: Keep::Needed,
            stages: StageConfig {
                warmup: 0.1,
                decomposition: 0.35,
                settle: 0.7,
                window: TimeWindow::Growing,
                min_following: 1_000,
                averaged: 0.06,
            },
            loss: LossConfig {
                dssim: 0.2,
                static_motion: 0.01,
                smoothness: 0.002,
                field_motion: 0.1,
                visible_motion: 2.5,
                static_opacity: 0.01,
                nearness: 0.016,
                smoothness_share: 0.25,
                smoothness_interval: 1,
                steadiness: 0.1,
                moved_share: 0.03,
                found_places: 0.001,
                smoothness_step: [5e-3, 1e-4],
            },
            learning_rates: LearningRates {
                means: 1.6e-4,
                means_final: 1.6e-6,
                means_in_turns: 2.5,
                at_once: 1.0,
                quats: 1e-3,
                scales: 5e-3,
                opacities: 0.05,
                sh_dc: 2.5e-3,
                sh_rest: 2.5e-3 / 20.0,
                trajectories: 1.6e-4,
                embeddings: 2.5e-3,
                grid: 5e-3,
                network: 1e-3,
                motion_grid: 0.02,
                motion_network: 3e-3,
                motion_damping: 1.0,
                field_final: 0.1,
                extent: None,
            },
            decomposition: DecompositionConfig {
                enabled: true,
                select: Selection::Moving,
                measure: MotionMeasure::Screen,
                quantile: 0.0,
                floor: 0.005,
                keep_trajectories: true,
                basis: TrajectoryBasis::polyline(0),
                encoder: HashEncoderConfig {
                    n_levels: 8,
                    n_features_per_level: 2,
                    log2_hashmap_size: 14,
                    base_resolution: vec![8; 3],
                    finest_resolution: vec![128; 3],
                    smoothstep: false,
                    reference_sizing: false,
                    pruned_levels: Vec::new(),
                },
                hidden: 32,
                review_interval: 500,
                review_floor: 0.005,
                promote_floor: 0.0,
                matching_floor: 0.015,
            },
            field: FieldConfig {
                deformation: DeformationConfig {
                    representation: Representation::Hash,
                    heads: Heads::default(),
                    encoder: HashEncoderConfig {
                        n_levels: 8,
                        n_features_per_level: 2,
                        log2_hashmap_size: 15,
                        base_resolution: vec![4, 4, 4, 4],
                        finest_resolution: vec![64, 64, 64, 0],
                        smoothstep: false,
                        reference_sizing: false,
                        pruned_levels: Vec::new(),
                    },
                    hidden: 64,
                    layers: 2,
                },
                space: SpaceRule::Scene,
                offsets: OffsetPlacement::BeforeActivation,
                // How things go on into a gap is told from how they move beside it, and cells of one picture each
                // tell that badly: 4 a side are left.
                cells_with_gaps: 1.0 / 16.0,
            },
            density_static: DensityConfig {
                from: 500.0 / 15_000.0,
                until: 0.6,
                interval: 100,
                gradient_threshold: 2e-4,
                crowd: 0,
                crowd_of_split: 0.0,
                clone_scale: 0.01,
                min_opacity: 0.005,
                max_scale: 0.1,
                oversized: Oversized::Shrunk,
                opacity_reset_interval: 3_000,
                max_gaussians: 300_000,
            },
            density_dynamic: DensityConfig {
                from: 0.37,
                until: 0.7,
                interval: 100,
                gradient_threshold: 2e-4,
                crowd: 0,
                crowd_of_split: 0.0,
                clone_scale: 0.01,
                min_opacity: 0.005,
                max_scale: 0.1,
                oversized: Oversized::Shrunk,
                opacity_reset_interval: 3_000,
                max_gaussians: 100_000,
            },
        }
    }

    fn shorten(&mut self) {
        self.iterations = 6_000;
        self.stages.decomposition = 0.45;
        // What each Gaussian learns of its own, before the 4D field joins in, tears bodies apart.
        self.stages.settle = 0.95;
        self.stages.min_following = 800;
        // So many fine cells in space and time share entries that few steps do not tell them apart.
        self.field.deformation.encoder.finest_resolution = vec![16, 16, 16, 0];
        self.field.cells_with_gaps = 0.25;
        // What moves as a whole moves as fast as its parts.
        self.field.deformation.encoder.base_resolution = vec![4, 4, 4, 0];
        self.sh_degree = 1;
        self.max_initial_points = 20_000;
        self.min_initial_points = 6_000;
        self.learning_rates.means_final = 1.6e-5;
        // At the rates of long runs they stay behind.
        self.learning_rates.at_once = 2.0;
        self.loss.smoothness_share = 0.1;
        // It costs by the call more than by the point; at one step of eight, with eight times the weight, it is as good.
        self.loss.smoothness_interval = 8;
        self.density_static.opacity_reset_interval = 2_000;
        self.density_dynamic.opacity_reset_interval = 800;
        self.density_static.max_gaussians = 10_000;
        self.density_dynamic.max_gaussians = 4_000;
        // Half as many are as good at equal steps, and their steps are faster.
        self.density_dynamic.crowd = 400;
        // Where much moves, more are.
        self.density_dynamic.crowd_of_split = 0.5;
        self.decomposition.review_interval = 250;
    }

    fn as_in_the_paper(&mut self) {
        self.keep = Keep::All;
        self.gap_steps = None;
        self.loss.field_motion = 0.0;
        self.loss.visible_motion = 0.0;
        self.loss.static_opacity = 0.0;
        self.loss.nearness = 0.0;
        self.loss.steadiness = 0.0;
        self.loss.moved_share = 0.0;
        self.loss.found_places = 0.0;
        self.loss.smoothness = 0.01;
        self.loss.smoothness_share = 1.0;
        self.learning_rates.means_in_turns = 1.0;
        self.learning_rates.motion_damping = 0.0;
        self.iterations = 30_000;
        self.stages = StageConfig {
            warmup: 0.04,
            decomposition: 0.08,
            settle: 1.0,
            window: TimeWindow::All,
            min_following: 0,
            averaged: 0.0,
        };
        self.decomposition.measure = MotionMeasure::World;
        self.decomposition.quantile = 0.8;
        self.decomposition.floor = 0.0;
        self.decomposition.keep_trajectories = false;
        self.decomposition.basis = TrajectoryBasis::Linear;
        self.decomposition.review_interval = 0;
        self.decomposition.matching_floor = 0.0;
        self.field.cells_with_gaps = 1.0;
        self.decomposition.encoder = HashEncoderConfig {
            n_levels: 16,
            n_features_per_level: 2,
            log2_hashmap_size: 16,
            base_resolution: vec![16; 3],
            finest_resolution: vec![2048; 3],
            smoothstep: false,
            reference_sizing: false,
            pruned_levels: Vec::new(),
        };
        self.field.deformation = DeformationConfig {
            representation: Representation::Hash,
            heads: Heads::default(),
            encoder: HashEncoderConfig {
                n_levels: 16,
                n_features_per_level: 2,
                log2_hashmap_size: 17,
                base_resolution: vec![8; 4],
                finest_resolution: vec![2048, 2048, 2048, 25],
                smoothstep: false,
                reference_sizing: false,
                pruned_levels: Vec::new(),
            },
            hidden: 128,
            layers: 2,
        };
        self.field.offsets = OffsetPlacement::BeforeActivation;
        self.density_static.oversized = Oversized::Removed;
        self.density_dynamic.oversized = Oversized::Removed;
    }

    fn as_released(&mut self) {
        self.keep = Keep::All;
        self.near_plane = Some(NEAR_PLANE);
        self.gap_steps = None;
        self.iterations = 50_000;
        self.sh_interval = 1_000.0 / 50_000.0;
        self.stages = StageConfig {
            warmup: 0.04,
            decomposition: 0.08,
            settle: 1.0,
            window: TimeWindow::All,
            min_following: 0,
            averaged: 0.0,
        };
        self.loss = LossConfig {
            dssim: 0.0,
            static_motion: 0.1,
            smoothness: 1.0,
            field_motion: 0.0,
            visible_motion: 0.0,
            static_opacity: 0.0,
            nearness: 0.0,
            smoothness_share: 1.0,
            smoothness_interval: 1,
            steadiness: 0.0,
            moved_share: 0.0,
            found_places: 0.0,
            smoothness_step: [5e-3, 1e-4],
        };
        self.learning_rates = LearningRates {
            means: 1.6e-4,
            means_final: 1.6e-6,
            means_in_turns: 1.0,
            at_once: 1.0,
            quats: 1e-3,
            scales: 5e-3,
            opacities: 0.05,
            sh_dc: 2.5e-3,
            sh_rest: 2.5e-3 / 20.0,
            trajectories: 0.0,
            embeddings: 2.5e-3,
            grid: 50.0 * 1.6e-4,
            network: 1.6e-4,
            motion_grid: 50.0 * 1.6e-4,
            motion_network: 1.6e-4,
            motion_damping: 0.0,
            field_final: 0.01,
            extent: Some(5.0),
        };
        self.decomposition = DecompositionConfig {
            enabled: true,
            select: Selection::Moving,
            measure: MotionMeasure::DistanceWeighted,
            quantile: 0.8,
            floor: 0.0,
            keep_trajectories: false,
            basis: TrajectoryBasis::Linear,
            encoder: HashEncoderConfig {
                n_levels: 32,
                n_features_per_level: 2,
                log2_hashmap_size: 16,
                base_resolution: vec![16; 3],
                finest_resolution: vec![2048; 3],
                smoothstep: true,
                reference_sizing: true,
                pruned_levels: Vec::new(),
            },
            hidden: 64,
            review_interval: 0,
            review_floor: 0.0,
            promote_floor: 0.0,
            matching_floor: 0.0,
        };
        self.field = FieldConfig {
            deformation: DeformationConfig {
                representation: Representation::Hash,
                heads: Heads::default(),
                encoder: HashEncoderConfig {
                    n_levels: 32,
                    n_features_per_level: 2,
                    log2_hashmap_size: 19,
                    base_resolution: vec![8; 4],
                    finest_resolution: vec![2048, 2048, 2048, 25],
                    smoothstep: true,
                    reference_sizing: true,
                    pruned_levels: Vec::new(),
                },
                hidden: 256,
                layers: 2,
            },
            space: SpaceRule::Fixed(1.0),
            offsets: OffsetPlacement::AfterActivation,
            cells_with_gaps: 1.0,
        };
        let density = DensityConfig {
            from: 600.0 / 50_000.0,
            until: 6_800.0 / 50_000.0,
            interval: 200,
            oversized: Oversized::Removed,
            ..self.density_static.clone()
        };
        self.density_dynamic = DensityConfig {
            from: 7_050.0 / 50_000.0,
            until: 7_950.0 / 50_000.0,
            ..density.clone()
        };
        self.density_static = density;
    }
}
