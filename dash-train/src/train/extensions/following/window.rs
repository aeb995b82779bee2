//! The window of time that the first stages see.

use crate::train::core::{Run, TimeSpan};
use crate::train::paper::{Dash, GROWN};

/// Frames that count as new when the window reaches them.
const NEW_FRAMES: f32 = 2.0;

/// Whether a view at `time` teaches the Gaussians too, and not the coarse field alone: until the field has followed what
/// moves into a new frame, that frame would teach Gaussians to fade where they should be moved.
pub(super) fn teaches_gaussians(run: &Run<Dash>, time: f32) -> bool {
    run.method.motion.is_none()
        || time_window(run, run.step).is_none_or(|(_, known)| known.holds(time))
}

/// The span that is trained on at `step`, and the span within it outside of which frames are new; `None`: all of the clip.
pub(super) fn time_window(run: &Run<Dash>, step: usize) -> Option<(TimeSpan, TimeSpan)> {
    let first = run.start.filter(|_| run.may_move())?;
    let stages = run.stages();
    if step < stages.warmup {
        return Some((first, first));
    }
    let grown = stages.followed(step) / GROWN;
    if grown >= 1.0 {
        return None;
    }
    let window = TimeSpan {
        from: first.from * (1.0 - grown),
        to: first.to + (1.0 - first.to) * grown,
    };
    let new = NEW_FRAMES / (run.dataset.n_frames - 1).max(1) as f32;
    let known = TimeSpan {
        from: (window.from + new).min(first.from),
        to: (window.to - new).max(first.to),
    };
    Some((window, known))
}
