//! What the paper states; where it leaves a matter to 3DGS, what that does.

use super::{Said, open, other, same};

const AS_DEFAULT: &str =
    "As in `default`. It depends on the unit of the field's output, which is ours.";
const NO_LIMIT: &str =
    "Memory ends somewhere. The paper reports 106,600 Gaussians of a whole scene (coffee martini).";

/// The preset `paper` against the paper and 3DGS.
pub(super) const PAPER: &[Said] = &[
    open("iterations", "As long as 3DGS trains."),
    same("batch", "1"),
    same("sh_degree", "3"),
    // 1,000 of 30,000 steps.
    same("sh_interval", "0.033333335"),
    same("dssim", "0.2"),
    same("near_plane", "0.2"),
    other(
        "initial_points",
        "all of structure from motion, else 100,000 at random",
        "Below 20,000, depth maps give more: they say where surfaces are, and random points do not. 100,000 are about as many as the paper's scenes have in the end.",
    ),
    same("method.decomposition", "moving"),
    open(
        "method.stages",
        "The released code's 2,000 and 4,000 of 50,000 steps.",
    ),
    same("method.form", "paper"),
    same("method.measure", "world"),
    open("method.static_quantile", "The released code's."),
    same("method.motion_floor", "0"),
    same("method.trajectories", "linear"),
    open(
        "method.static_motion",
        "As in `default`: a weight of motion in diagonals of the scene. The released code's 0.1 is one of motion in world units.",
    ),
    open(
        "method.smoothness",
        "The weight from which measurements led `default` to a lower one.",
    ),
    same("method.smoothness_share", "1"),
    same("method.smoothness_interval", "1"),
    open("method.motion_field.n_levels", "Instant-NGP's."),
    open(
        "method.motion_field.log2_hashmap_size",
        "The released code's.",
    ),
    open("method.motion_field.resolution", "The released code's."),
    open(
        "method.motion_field.hidden",
        "Instant-NGP's: the paper has a tiny network.",
    ),
    open("method.motion_field.grid_rate", AS_DEFAULT),
    open("method.motion_field.network_rate", AS_DEFAULT),
    same("method.field.representation", "hash"),
    open("method.field.n_levels", "Instant-NGP's."),
    open(
        "method.field.log2_hashmap_size",
        "Tables of 17 MB at most. The released code's 2^19 entries and 32 levels take 104.",
    ),
    open("method.field.resolution", "The released code's."),
    open(
        "method.field.time_resolution",
        "Eq. 7 leaves the axes to the user. As in space at the coarsest level, from the frame count at the finest: a clip of \
         300 frames needs more cells than one of 50, for which the released code has 25.",
    ),
    open("method.field.hidden", "4DGaussians' on Neural 3D Video."),
    same("optimizer.means_final", "0.0000016"),
    open("optimizer.grid", AS_DEFAULT),
    open("optimizer.network", AS_DEFAULT),
    open(
        "optimizer.field_final",
        "As in `default`, where 0.3 was worse.",
    ),
    same("densify.gradient_threshold", "0.0002"),
    same("densify.interval", "100"),
    same("densify.opacity_reset_interval", "3000"),
    // Rounds at steps 600 to 14,900 of 30,000.
    same("densify.static.during", "[0.02, 0.5]"),
    other("densify.static.max_gaussians", "no limit", NO_LIMIT),
    open(
        "densify.dynamic.during",
        "The paper has settings of their own for dynamic Gaussians, and names none. From the decomposition on, and as long as 3DGS.",
    ),
    other("densify.dynamic.max_gaussians", "no limit", NO_LIMIT),
];
