//! The values of the presets.

use dash_kernels::splats::NEAR_PLANE;
use dash_model::Representation;

use super::{Preset, TrainConfig};
use crate::train::core::{DensifyConfig, DensifySets, OptimizerConfig};
use crate::train::extensions::{
    AppearanceConfig, AveragingConfig, CaptureRatesConfig, CrowdingConfig, DemotionConfig,
    ExposureConfig, ExtensionsConfig, FloatersConfig, FollowingConfig, GapsConfig, PruneConfig,
    RestCostConfig, ScaleLimitConfig,
};
use crate::train::paper::{
    Decomposition, FieldConfig, Form, MethodConfig, MotionFieldConfig, MotionMeasure,
    TimeResolution, Trajectories,
};

impl TrainConfig {
    /// The values of a preset.
    pub fn preset(preset: Preset) -> Self {
        let mut config = Self::ours();
        config.preset = preset;
        match preset {
            Preset::Default => {}
            Preset::Quick => config.shorten(),
            Preset::Best => config.lengthen(),
            Preset::Paper => config.as_in_the_paper(),
            Preset::Reference => config.as_released(),
        }
        config
    }

    fn ours() -> Self {
        Self {
            preset: Preset::Default,
            iterations: 15_000,
            batch: 1,
            visits: Some(4),
            seed: 0,
            sh_degree: 3,
            sh_interval: 1.0 / 15.0,
            dssim: 0.2,
            near_plane: None,
            initial_points: [20_000, 100_000],
            checkpoint_interval: 1_000,
            method: our_method(),
            optimizer: OptimizerConfig {
                means_final: 1.6e-6,
                grid: 5e-3,
                network: 1e-3,
                field_final: 0.1,
            },
            densify: DensifySets {
                gradient_threshold: 2e-4,
                pixels: None,
                interval: 100,
                opacity_reset_interval: Some(3_000),
                static_set: DensifyConfig {
                    during: [500.0 / 15_000.0, 0.6],
                    max_gaussians: 300_000,
                },
                dynamic: DensifyConfig {
                    during: [0.37, 0.7],
                    max_gaussians: 100_000,
                },
            },
            extensions: our_extensions(),
        }
    }

    fn shorten(&mut self) {
        self.iterations = 6_000;
        self.visits = Some(2);
        self.sh_degree = 1;
        self.initial_points = [6_000, 20_000];
        self.method.stages[1] = 0.45;
        // So many fine cells in space and time share entries that few steps do not tell them apart.
        self.method.field.resolution = [4, 16];
        // A whole body moves as fast as its limbs.
        self.method.field.time_resolution = TimeResolution::PerFrame;
        // A lookup costs by the call more than by the point.
        self.method.smoothness_share = 0.1;
        self.method.smoothness_interval = 8;
        self.optimizer.means_final = 1.6e-5;
        let DensifySets {
            pixels,
            opacity_reset_interval,
            static_set,
            dynamic,
            ..
        } = &mut self.densify;
        *pixels = Some(20_000);
        *opacity_reset_interval = None;
        static_set.max_gaussians = 10_000;
        dynamic.max_gaussians = 4_000;
        // What each Gaussian learns of its own, before the 4D field joins in, tears bodies apart.
        self.extensions.following = Some(FollowingConfig {
            handover: 0.95,
            min_steps: 800,
        });
        self.extensions.gaps = Some(GapsConfig {
            coarsen: 0.25,
            steadiness: 20.0,
        });
        // At the rates of long runs they stay behind.
        self.extensions.capture_rates = Some(CaptureRatesConfig {
            monocular: 2.5,
            synchronized: 2.0,
        });
        // Half as many are as good at equal steps, and their steps are faster.
        self.extensions.crowding = Some(CrowdingConfig { free: 400 });
        self.extensions.demotion = Some(DemotionConfig { interval: 250 });
    }

    fn lengthen(&mut self) {
        self.iterations = 30_000;
        self.visits = Some(12);
        self.sh_interval = 1_000.0 / 30_000.0;
    }

    /// The paper's equations with what it states, else 3DGS' values; what neither says has its reason beside it. What
    /// differs from both is listed in `deviations`.
    fn as_in_the_paper(&mut self) {
        // As long as 3DGS trains.
        self.iterations = 30_000;
        self.visits = None;
        self.sh_interval = 1_000.0 / 30_000.0;
        self.near_plane = Some(NEAR_PLANE);
        self.extensions = ExtensionsConfig::default();
        self.method = MethodConfig {
            // The released code's 2,000 and 4,000 of 50,000 steps.
            stages: [0.04, 0.08],
            measure: MotionMeasure::World,
            // The released code's.
            static_quantile: 0.8,
            motion_floor: 0.0,
            trajectories: Trajectories::Linear,
            // As in `default`: of motion in diagonals of the scene, whereas the released code's 0.1 is of world units.
            static_motion: 0.01,
            // The weight from which measurements led `default` to a lower one.
            smoothness: 0.01,
            smoothness_share: 1.0,
            smoothness_interval: 1,
            motion_field: MotionFieldConfig {
                // Instant-NGP's.
                n_levels: 16,
                // The released code's.
                log2_hashmap_size: 16,
                // The released code's.
                resolution: [16, 2048],
                // Instant-NGP's: the paper has a tiny network.
                hidden: 64,
                // As in `default`: it depends on the output's unit, which is ours.
                grid_rate: 0.02,
                // As in `default`, for the same reason.
                network_rate: 3e-3,
            },
            field: FieldConfig {
                representation: Representation::Hash,
                // Instant-NGP's.
                n_levels: 16,
                // 17 MB of tables at most, where the released code's 2^19 and 32 levels take 104.
                log2_hashmap_size: 17,
                // The released code's.
                resolution: [8, 2048],
                // As in space at the coarsest level, and every frame at the finest: Eq. 7 leaves both open per axis.
                time_resolution: TimeResolution::UpToFrames(8),
                // 4DGaussians' on Neural 3D Video.
                hidden: 128,
            },
            ..self.method.clone()
        };
        self.optimizer = OptimizerConfig {
            means_final: 1.6e-6,
            // As in `default`: it depends on the output's unit, which is ours.
            grid: 5e-3,
            // As in `default`, for the same reason.
            network: 1e-3,
            // As in `default`, where 0.3 was worse.
            field_final: 0.1,
        };
        let static_set = DensifyConfig {
            // Rounds from step 600 on, the first hundred after 500, and until 15,000.
            during: [600.0 / 30_000.0, 0.5],
            // Three times what the paper reports of a whole scene, 106,600.
            max_gaussians: 300_000,
        };
        self.densify = DensifySets {
            gradient_threshold: 2e-4,
            pixels: None,
            interval: 100,
            opacity_reset_interval: Some(3_000),
            dynamic: DensifyConfig {
                // From the decomposition on, and as long as the static set's.
                during: [self.method.stages[1], 0.5],
                // As many as that scene has in all.
                max_gaussians: 100_000,
            },
            static_set,
        };
    }

    fn as_released(&mut self) {
        self.iterations = 50_000;
        self.visits = None;
        self.sh_interval = 1_000.0 / 50_000.0;
        self.dssim = 0.0;
        self.near_plane = Some(NEAR_PLANE);
        self.extensions = ExtensionsConfig::default();
        self.method = MethodConfig {
            stages: [0.04, 0.08],
            form: Form::Released,
            measure: MotionMeasure::DistanceWeighted,
            static_quantile: 0.8,
            motion_floor: 0.0,
            trajectories: Trajectories::Linear,
            static_motion: 0.1,
            smoothness: 1.0,
            smoothness_share: 1.0,
            smoothness_interval: 1,
            motion_field: MotionFieldConfig {
                n_levels: 32,
                log2_hashmap_size: 16,
                resolution: [16, 2048],
                hidden: 256,
                // 50 times the means' rate.
                grid_rate: 8e-3,
                network_rate: 1.6e-4,
            },
            field: FieldConfig {
                representation: Representation::Hash,
                n_levels: 32,
                log2_hashmap_size: 19,
                resolution: [8, 2048],
                time_resolution: TimeResolution::Fixed([8, 25]),
                hidden: 256,
            },
            ..self.method.clone()
        };
        self.optimizer = OptimizerConfig {
            means_final: 1.6e-6,
            grid: 8e-3,
            network: 1.6e-4,
            field_final: 0.01,
        };
        let static_set = DensifyConfig {
            // Rounds from step 600 to 6,800.
            during: [600.0 / 50_000.0, 7_000.0 / 50_000.0],
            max_gaussians: 300_000,
        };
        self.densify = DensifySets {
            gradient_threshold: 2e-4,
            pixels: None,
            interval: 200,
            // Every 200,000 of 50,000 steps.
            opacity_reset_interval: None,
            dynamic: DensifyConfig {
                // With all others until step 6,800, then by themselves until 7,950.
                during: [4_000.0 / 50_000.0, 8_000.0 / 50_000.0],
                ..static_set.clone()
            },
            static_set,
        };
    }
}

fn our_method() -> MethodConfig {
    MethodConfig {
        decomposition: Decomposition::Moving,
        stages: [0.1, 0.35],
        form: Form::Paper,
        measure: MotionMeasure::Screen,
        static_quantile: 0.0,
        motion_floor: 0.005,
        trajectories: Trajectories::Polyline,
        static_motion: 0.01,
        smoothness: 0.002,
        smoothness_share: 0.25,
        smoothness_interval: 1,
        motion_field: MotionFieldConfig {
            n_levels: 8,
            log2_hashmap_size: 14,
            resolution: [8, 128],
            hidden: 32,
            grid_rate: 0.02,
            network_rate: 3e-3,
        },
        field: FieldConfig {
            representation: Representation::Hash,
            n_levels: 8,
            log2_hashmap_size: 15,
            resolution: [4, 64],
            time_resolution: TimeResolution::UpToFrames(4),
            hidden: 64,
        },
    }
}

fn our_extensions() -> ExtensionsConfig {
    ExtensionsConfig {
        capture_rates: Some(CaptureRatesConfig {
            monocular: 2.5,
            synchronized: 1.0,
        }),
        prune: Some(PruneConfig::default()),
        following: Some(FollowingConfig {
            handover: 0.7,
            min_steps: 1_000,
        }),
        gaps: Some(GapsConfig {
            coarsen: 1.0 / 16.0,
            steadiness: 20.0,
        }),
        exposure: Some(ExposureConfig { rate: 2e-3 }),
        rest_cost: Some(RestCostConfig {}),
        floaters: Some(FloatersConfig {}),
        scale_limit: Some(ScaleLimitConfig {}),
        demotion: Some(DemotionConfig { interval: 500 }),
        crowding: None,
        appearance: Some(AppearanceConfig { change: 0.1 }),
        averaging: Some(AveragingConfig { share: 0.06 }),
    }
}
