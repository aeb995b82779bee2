//! The three stages of a run.

use serde::{Deserialize, Serialize};

/// When each stage ends, as shares of the run; a run that is too short for `min_following` moves them and
/// says so.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StageConfig {
    /// End of the warm-up, in which nothing moves (released code: 2,000 of 50,000 steps).
    pub warmup: f32,
    /// End of the decomposition, when the split is made (released code: 4,000 of 50,000).
    pub decomposition: f32,
    /// Share of the decomposition after which the coarse field hands over: every Gaussian then has a
    /// trajectory of its own. At 1 the field stays until the split, as in the paper.
    pub settle: f32,
    /// Which times the first two stages see.
    pub window: TimeWindow,
    /// Steps from the end of the warm-up until the coarse field hands over, at least: a run in which
    /// they are fewer gives them a larger share, up to 46 %, from a shorter warm-up and a later
    /// split. Only while the window grows and Gaussians are chosen by their motion; 0 for as the shares
    /// say. Ours.
    #[serde(default)]
    pub min_following: usize,
    /// Share of the run, at its end, over whose steps the mean of the parameters is taken, which is the scene then; not
    /// before density control is over. In these steps no Gaussian comes, goes or changes sets. 0: the scene of the last
    /// step, as in 3DGS. Ours.
    #[serde(default)]
    pub averaged: f32,
}

/// Which times the first two stages see.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum TimeWindow {
    /// All of them, as in the paper.
    All,
    /// The warm-up the middle of the clip only, one frame or a few; the decomposition more and more, both
    /// ways: motion is followed from frame to frame, and what moves is not blurred away first. Where no part
    /// shows the scene from sides enough for this, all times.
    Growing,
}
