//! What `default`, `quick` and `best` have in place of what `paper` has.

const SMALL_FIELD: &str =
    "A field for a CPU. The Gaussians' own trajectories carry most of the motion.";
const EXTENSION: &str = "[An extension](../explanation/beyond-the-paper.md).";
const NO_RESETS: &str = "`quick`: real captures are as good or better without.";
const FEWER_STEPS: &str = "`quick` has fewer steps.";

/// Keys in which `default`, `quick` or `best` differ from `paper`, and why.
pub(super) const OURS: &[(&str, &str)] = &[
    ("iterations", "`default`, `quick`: a CPU's time."),
    (
        "visits",
        "A long capture of many cameras would be seen once or less.",
    ),
    ("sh_degree", "`quick`: fewer values per Gaussian."),
    ("sh_interval", "1,000 steps of `default` and `best`."),
    ("near_plane", "Measured: scenes come in any unit."),
    ("initial_points", "`quick` has room for fewer."),
    ("extensions.appearance", EXTENSION),
    ("extensions.averaging", EXTENSION),
    ("extensions.capture_rates", EXTENSION),
    ("extensions.crowding", EXTENSION),
    ("extensions.demotion", EXTENSION),
    ("extensions.exposure", EXTENSION),
    ("extensions.floaters", EXTENSION),
    ("extensions.following", EXTENSION),
    ("extensions.gaps", EXTENSION),
    ("extensions.prune", EXTENSION),
    ("extensions.rest_cost", EXTENSION),
    ("extensions.scale_limit", EXTENSION),
    (
        "method.stages",
        "Following from frame to frame takes steps.",
    ),
    (
        "method.measure",
        "A picture shows motion on the screen, not in the world.",
    ),
    (
        "method.static_quantile",
        "A scene has no fixed share that moves.",
    ),
    (
        "method.motion_floor",
        "In place of the quantile: a scene at rest has no dynamic Gaussians.",
    ),
    (
        "method.trajectories",
        "Fast and curved motion is lost on a line.",
    ),
    ("method.smoothness", "Better on held-out cameras."),
    (
        "method.smoothness_share",
        "As good by the step, and cheaper.",
    ),
    (
        "method.smoothness_interval",
        "`quick`: as good by the step, and cheaper.",
    ),
    ("method.motion_field.n_levels", SMALL_FIELD),
    ("method.motion_field.log2_hashmap_size", SMALL_FIELD),
    ("method.motion_field.resolution", SMALL_FIELD),
    ("method.motion_field.hidden", SMALL_FIELD),
    ("method.field.n_levels", SMALL_FIELD),
    ("method.field.log2_hashmap_size", SMALL_FIELD),
    ("method.field.resolution", SMALL_FIELD),
    (
        "method.field.time_resolution",
        "`quick`: a whole body moves as fast as its limbs.",
    ),
    ("method.field.hidden", SMALL_FIELD),
    ("optimizer.means_final", FEWER_STEPS),
    ("densify.opacity_reset_interval", NO_RESETS),
    ("densify.pixels", "`quick` is for small pictures."),
    (
        "densify.static.during",
        "After step 500 of `default`; longer, since runs are shorter.",
    ),
    ("densify.static.max_gaussians", "`quick`: steps of a CPU."),
    (
        "densify.dynamic.during",
        "After a later decomposition; longer, since runs are shorter.",
    ),
    ("densify.dynamic.max_gaussians", "`quick`: steps of a CPU."),
];
