//! Deviations that no key changes.

use crate::train::core::hold_out::{MAX_VALIDATION_VIEWS, VIEWS_PER_VALIDATION_VIEW};
use crate::train::core::initial::{BOX_MARGIN, BOX_TAIL, CHANGING_SHARE, EXTENT_TAIL, NEAR_SHARE};
use crate::train::extensions::{FLOW_END, FLOW_REST, FLOW_WARMUP, FRAME_STEPS};
use crate::train::paper::{
    FEATURES_PER_LEVEL, Form, GROWN, KEPT_BACK, LAYERS, MASK_INTERVAL, STEP,
};

/// A form that the code has in place of a source's.
pub(super) struct InCode {
    /// What it is about.
    pub(super) what: &'static str,
    /// Names of the presets.
    pub(super) presets: &'static [&'static str],
    /// What the source has.
    pub(super) said: &'static str,
    /// What the code has, with its constants.
    pub(super) here: String,
    /// Why.
    pub(super) why: &'static str,
}

const ALL: &[&str] = &["paper", "reference", "default", "quick", "best"];
const OF_THE_PAPER: &[&str] = &["paper", "default", "quick", "best"];
const OURS: &[&str] = &["default", "quick", "best"];
const REFERENCE: &[&str] = &["reference"];

/// All of them.
pub(super) fn in_code() -> Vec<InCode> {
    let mut rows = scene();
    rows.extend(density_control());
    rows.extend(decomposition());
    rows.extend(field());
    rows
}

fn scene() -> Vec<InCode> {
    let released_extent = Form::Released.extent().unwrap_or_default();
    vec![
        InCode {
            what: "extent",
            presets: OF_THE_PAPER,
            said: "3DGS: 1.1 times the distance of the farthest camera from their middle",
            here: format!(
                "diagonal of the box of the points without the outermost {} on either side",
                percent(EXTENT_TAIL)
            ),
            why: "Cameras side by side, or in one place, say nothing about the size of a scene.",
        },
        InCode {
            what: "extent",
            presets: REFERENCE,
            said: "5 for learning rates, the cameras' for density control",
            here: format!("{released_extent} for both"),
            why: "One unit of length.",
        },
        InCode {
            what: "unit of length of density control",
            presets: ALL,
            said: "the extent",
            here: "the extent, or the distance from the scene's middle where that is more".into(),
            why: "A distant background needs larger Gaussians.",
        },
        InCode {
            what: "near plane",
            presets: OURS,
            said: "3DGS: 0.2",
            here: format!(
                "{} of the distance at which the training cameras see something",
                percent(NEAR_SHARE as f32)
            ),
            why: "Scenes come in any unit.",
        },
        InCode {
            what: "more first points",
            presets: ALL,
            said: "none",
            here: format!(
                "up to {} of the least number of `initial_points`, where pictures change",
                percent(CHANGING_SHARE)
            ),
            why: "Structure from motion finds no points on moving objects.",
        },
        InCode {
            what: "views that are not trained on",
            presets: ALL,
            said: "the test views",
            here: format!(
                "one of {VIEWS_PER_VALIDATION_VIEW} training views, {MAX_VALIDATION_VIEWS} at most, too"
            ),
            why: "Measurements during a run must not use the test views.",
        },
        InCode {
            what: "which step counts",
            presets: REFERENCE,
            said: "the best on the test camera",
            here: "the last".into(),
            why: "A choice by the test camera makes its scores too good: an accident.",
        },
    ]
}

fn density_control() -> Vec<InCode> {
    vec![
        InCode {
            what: "capacity held back",
            presets: ALL,
            said: "no limit",
            here: format!(
                "{} of `densify.static.max_gaussians` before the decomposition",
                percent(KEPT_BACK)
            ),
            why: "Without room, dynamic Gaussians would fill what the static set still lacks. It shows only at the limit.",
        },
        InCode {
            what: "first reset of dynamic opacities",
            presets: OF_THE_PAPER,
            said: "3DGS: counted from the first step",
            here: "counted from the decomposition".into(),
            why: "A set has as long to form as in 3DGS.",
        },
        InCode {
            what: "last reset of opacities",
            presets: OF_THE_PAPER,
            said: "3DGS: before density control ends",
            here: "half an interval before density control ends".into(),
            why: "The last round would prune what comes back slowly.",
        },
        InCode {
            what: "resets before a black or white background",
            presets: OF_THE_PAPER,
            said: "3DGS: one more at the first round if the background is white",
            here: "none more".into(),
            why: "No background is special.",
        },
        InCode {
            what: "static opacities while the coarse field looks for motion",
            presets: OF_THE_PAPER,
            said: "3DGS: reset when it is time",
            here: "not reset".into(),
            why: "Motion must stay visible.",
        },
        InCode {
            what: "Gaussians that are large on the screen",
            presets: OF_THE_PAPER,
            said: "3DGS: pruned above 20 px, after the first reset",
            here: "stay".into(),
            why: "Pixels depend on how large pictures are.",
        },
        InCode {
            what: "transparent Gaussians",
            presets: REFERENCE,
            said: "never pruned",
            here: "pruned as in 3DGS".into(),
            why: "An accident: pruning is behind a condition that never holds.",
        },
    ]
}

fn decomposition() -> Vec<InCode> {
    vec![
        InCode {
            what: "rates of the coarse field",
            presets: OURS,
            said: "not stated",
            here: format!(
                "fall to 0 in the last {} of the time until the handover",
                percent(1.0 - GROWN)
            ),
            why: "Jitter would pass for motion. The lines of `paper` and `reference` are thrown away, and their rates decay as \
                  the 4D field's.",
        },
        InCode {
            what: "coarse motion of a rig",
            presets: OURS,
            said: "Eqs. 3-5: one field for all times",
            here: "[scene flow](../explanation/beyond-the-paper.md#scene-flow): a grid of offsets for each frame, and no \
                   Eq. 5"
                .into(),
            why: "One field loses an old frame while it learns a new one.",
        },
        InCode {
            what: "stages of a rig",
            presets: OURS,
            said: "shares of the run",
            here: format!(
                "the warm-up has {FLOW_WARMUP} steps at most, coming to rest {} to {}; scene flow has the others. With fewer \
                 than {FRAME_STEPS} for a frame, the decomposition waits until {} of the run",
                FLOW_REST[0],
                FLOW_REST[1],
                percent(FLOW_END)
            ),
            why: "More steps around scene flow bring nothing on real captures, more within it do.",
        },
        InCode {
            what: "rates of a rig's trajectories in the 4D stage",
            presets: OURS,
            said: "no trajectories then",
            here: "those of the means over the square root of half the number of spans".into(),
            why: "Spans add up: the far ends would jump.",
        },
        InCode {
            what: "motion (Eq. 5)",
            presets: ALL,
            said: "in world units",
            here: "in diagonals of the coarse field's box".into(),
            why: "One weight for scenes of any size.",
        },
        InCode {
            what: "which Gaussians Eq. 5 holds still",
            presets: OF_THE_PAPER,
            said: "not stated",
            here: format!("those below the threshold, looked at every {MASK_INTERVAL} steps"),
            why: "A threshold costs a pass over all Gaussians.",
        },
        InCode {
            what: "Eq. 5",
            presets: REFERENCE,
            said: "mean over all Gaussians of `t dp` at the view's time, looked at every step",
            here: format!(
                "Eq. 5: mean over the static ones of `dp`, looked at every {MASK_INTERVAL} steps"
            ),
            why: "One term for every preset.",
        },
        InCode {
            what: "Gaussians that no view shows during the decomposition",
            presets: ALL,
            said: "as others",
            here: "static".into(),
            why: "No picture says that they move.",
        },
        InCode {
            what: "views that measure motion",
            presets: REFERENCE,
            said: "the last view before the decomposition, from a wrong camera centre; its nearest points are static",
            here: "all views of the stage".into(),
            why: "An accident.",
        },
        InCode {
            what: "time in both fields",
            presets: REFERENCE,
            said: "-0.9 to 0.9 over the clip, in a box from -1 to 1",
            here: "0 to 1 (Eq. 4), in a box from 0 to 1".into(),
            why: "One form for every preset.",
        },
        InCode {
            what: "the coarse field's network",
            presets: REFERENCE,
            said: "one hidden layer",
            here: "two hidden layers".into(),
            why: "One module for every preset.",
        },
    ]
}

fn field() -> Vec<InCode> {
    let [space, time] = STEP;
    vec![
        InCode {
            what: "box of the fields",
            presets: OF_THE_PAPER,
            said: "not stated",
            here: format!(
                "that of the points without the outermost {} on either side, {} wider; beyond it, its border",
                percent(BOX_TAIL),
                percent(BOX_MARGIN)
            ),
            why: "Scenes come in any unit.",
        },
        InCode {
            what: "offsets of means",
            presets: ALL,
            said: "not stated; released code: world units",
            here: "tenths of the diagonal of the field's box".into(),
            why: "Learning rates fit scenes of any size.",
        },
        InCode {
            what: "offsets of rotations and scales",
            presets: OF_THE_PAPER,
            said: "not stated",
            here: "added before normalisation and exponentiation".into(),
            why: "A scale stays positive.",
        },
        InCode {
            what: "features of a level, layers of the decoder",
            presets: OF_THE_PAPER,
            said: "not stated",
            here: format!("{FEATURES_PER_LEVEL} and {LAYERS}"),
            why: "Instant-NGP's and the released code's.",
        },
        InCode {
            what: "the random vector of Eq. 11",
            presets: OF_THE_PAPER,
            said: "not stated",
            here: format!("up to {space} in space and {time} in time, in box sizes"),
            why: "The released code's numbers.",
        },
        InCode {
            what: "the random vector of Eq. 11",
            presets: REFERENCE,
            said: "half of that, since its box is 2 wide; beyond the box, too",
            here: format!(
                "up to {space} in space and {time} in time, in box sizes; within the box"
            ),
            why: "One form for every preset.",
        },
        InCode {
            what: "rates at the end",
            presets: REFERENCE,
            said: "reached at step 20,000 of 50,000",
            here: "reached at the last step".into(),
            why: "As in 3DGS, whose schedule is the run's.",
        },
    ]
}

fn percent(share: f32) -> String {
    format!("{} %", (100.0 * share).round())
}
