//! Stages of runs that are too short to follow motion within the shares of their preset.

use crate::train::core::Run;
use crate::train::paper::{Dash, Decomposition};

/// The form of the shortest runs, as shares like those of the configuration: most steps follow motion, since no later
/// stage finds again what was lost then.
const SHORT_WARMUP: f32 = 0.06;
const SHORT_DECOMPOSITION: f32 = 0.6;
const SHORT_HANDOVER: f32 = 0.85;
/// The ends of the static and of the dynamic Gaussians' density control in them.
const SHORT_DENSIFY: [f32; 2] = [0.75, 0.85];

/// Moves the stages towards the form of the shortest runs, as far as it takes to leave `min_steps` for following: following
/// takes of the time in which every Gaussian goes alone first, then of the warm-up, and only then puts off the
/// decomposition.
pub(super) fn make_room(run: &mut Run<Dash>, min_steps: usize) {
    let follows = run.method.config.decomposition == Decomposition::Moving;
    let [warmup, end] = run.method.config.stages;
    let share = run.method.handover * (end - warmup);
    let step = 1.0 / run.config.iterations as f32;
    let shortest_warmup = warmup.min(SHORT_WARMUP);
    let latest_end = end.max(SHORT_DECOMPOSITION);
    let handover = run.method.handover.max(SHORT_HANDOVER);
    let most = handover * (latest_end - shortest_warmup);
    let needed = (min_steps as f32 * step).min(most);
    // A part of a step is none: stages that were moved before stay.
    if !follows || needed <= share + 0.5 * step {
        return;
    }
    let length = needed / handover;
    let warmup = (end - length).clamp(shortest_warmup, warmup);
    let moved_end = end.max(warmup + length);
    run.method.config.stages = [warmup, moved_end];
    run.method.handover = (needed / (moved_end - warmup)).min(1.0);
    if moved_end > end {
        let way = (moved_end - end) / (latest_end - end);
        let densify = &mut run.config.densify;
        let sets = [&mut densify.static_set, &mut densify.dynamic];
        for (set, until) in sets.into_iter().zip(SHORT_DENSIFY) {
            if set.during[1] > 0.0 {
                set.during[1] += way * (until - set.during[1]).max(0.0);
            }
        }
    }
}
