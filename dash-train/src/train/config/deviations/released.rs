//! What the released code (chenj02/DASH) has, with the preset that it ships.

use super::{Said, other, same};

const NO_LIMIT: &str = "Memory ends somewhere.";

/// The preset `reference` against the released code.
pub(super) const RELEASED: &[Said] = &[
    same("iterations", "50000"),
    same("batch", "1"),
    same("sh_degree", "3"),
    // 1,000 of 50,000 steps.
    same("sh_interval", "0.02"),
    same("dssim", "0"),
    same("near_plane", "0.2"),
    other(
        "initial_points",
        "all of the dataset's",
        "Datasets that bring none are trained on, too.",
    ),
    same("method.decomposition", "moving"),
    same("method.stages", "[0.04, 0.08]"),
    same("method.form", "released"),
    same("method.measure", "distance_weighted"),
    same("method.static_quantile", "0.8"),
    other(
        "method.motion_floor",
        "a millionth of the extent, before division by the distance",
        "Which Gaussians move is decided by the quantile.",
    ),
    same("method.trajectories", "linear"),
    same("method.static_motion", "0.1"),
    same("method.smoothness", "1"),
    same("method.smoothness_share", "1"),
    same("method.smoothness_interval", "1"),
    same("method.motion_field.n_levels", "32"),
    same("method.motion_field.log2_hashmap_size", "16"),
    same("method.motion_field.resolution", "[16, 2048]"),
    same("method.motion_field.hidden", "256"),
    same("method.motion_field.grid_rate", "0.008"),
    same("method.motion_field.network_rate", "0.00016"),
    same("method.field.representation", "hash"),
    same("method.field.n_levels", "32"),
    same("method.field.log2_hashmap_size", "19"),
    same("method.field.resolution", "[8, 2048]"),
    same("method.field.time_resolution", "{ fixed = [8, 25] }"),
    same("method.field.hidden", "256"),
    same("optimizer.means_final", "0.0000016"),
    same("optimizer.grid", "0.008"),
    same("optimizer.network", "0.00016"),
    same("optimizer.field_final", "0.01"),
    other(
        "densify.gradient_threshold",
        "0.0002, and 0.00001 for dynamic Gaussians by themselves",
        "One threshold for both sets. The lower one meets statistics that have stopped; with live ones a twentieth of the gradient would do.",
    ),
    // Every 200,000 steps.
    same("densify.opacity_reset_interval", "-"),
    // Rounds at steps 600 to 6,800 of 50,000.
    same("densify.static.during", "[0.012, 0.14]"),
    other("densify.static.max_gaussians", "no limit", NO_LIMIT),
    // Until step 6,800 with all others, at 7,050 to 7,950 by themselves.
    same("densify.dynamic.during", "[0.08, 0.16]"),
    other(
        "densify.interval",
        "200, and 50 by themselves",
        "One interval for both. In the released code the rounds by themselves do nothing after the first.",
    ),
    other("densify.dynamic.max_gaussians", "no limit", NO_LIMIT),
];
