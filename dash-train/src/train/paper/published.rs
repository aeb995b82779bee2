//! Sizes, learning rates and schedules of methods as their authors published them; `scale.rs` has the one rule that scales them.
//!
//! Values are those for Neural 3D Video, 300 frames of about 20 synchronised cameras: the papers' largest dataset, and the
//! only one that all of these methods have arguments for. Paths are in the authors' repositories.

use dash_model::Representation;

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
