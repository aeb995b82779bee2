//! What cameras that stand still see unchanged is static.
//!
//! A Gaussian that moves changes the pictures of nearly all cameras that have it in sight. Where most of them show the same
//! over the whole clip, the coarse field has nothing to look for: what rests there keeps out of the dynamic set, however
//! the field shakes.

use std::collections::BTreeMap;

use dash_kernels::Camera;
use rayon::prelude::*;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::blocks::Blocks;
use crate::Error;
use crate::dataset::View;
use crate::numbers::median;
use crate::train::core::{Extension, Run, to_host};
use crate::train::paper::Dash;

/// Steps between two looks at where Gaussians are.
const INTERVAL: usize = 50;
/// Pictures of a camera that are compared.
const LOOKS: usize = 48;
/// Least difference of a block's mean colour that is a change, in any channel: three steps of 255.
const LEAST_CHANGE: f32 = 0.012;
/// How many times the typical difference of a picture's blocks a change is: noise is none.
const ABOVE_TYPICAL: f32 = 6.0;

/// `[extensions.stillness]`
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct StillnessConfig {
    /// Share of the cameras that have a Gaussian in sight whose pictures have to change there, for it to move. Source:
    /// ours.
    pub changing: f32,
}

/// See [`StillnessConfig`].
pub struct Stillness {
    config: StillnessConfig,
    /// What each camera sees change; once it was looked at.
    seen: Option<Vec<Seen>>,
}

/// Where a camera's pictures change.
struct Seen {
    camera: Camera,
    blocks: Blocks,
    changes: Vec<bool>,
}

impl Stillness {
    /// From its section.
    pub fn new(config: StillnessConfig) -> Self {
        Self { config, seen: None }
    }
}

impl Extension<Dash> for Stillness {
    fn name(&self) -> &'static str {
        "stillness"
    }

    fn before_step(&mut self, run: &mut Run<Dash>) -> Result<(), Error> {
        let is_synchronized = run.start.is_some_and(|span| span.is_one_time());
        if run.method.motion_space.is_none() || !is_synchronized {
            return Ok(());
        }
        let n = run.scene.static_set.len();
        if run.method.at_rest.len() == n && !run.step.is_multiple_of(INTERVAL) {
            return Ok(());
        }
        if self.seen.is_none() {
            self.seen = Some(of_cameras(run)?);
        }
        let seen = self.seen.as_deref().unwrap_or_default();
        if !seen.is_empty() {
            let means = to_host(run.scene.static_set.means.val());
            let rests =
                |mean: &[f32]| rests(seen, [mean[0], mean[1], mean[2]], self.config.changing);
            run.method.at_rest = means.par_chunks_exact(3).map(rests).collect();
        }
        Ok(())
    }
}

/// Where each camera's training pictures change; empty where a camera moves.
fn of_cameras(run: &Run<Dash>) -> Result<Vec<Seen>, Error> {
    let background = run.scene.settings.background;
    let mut cameras: BTreeMap<usize, Vec<&View>> = BTreeMap::new();
    for &index in &run.train_views {
        let view = &run.dataset.views[index];
        cameras.entry(view.camera_index).or_default().push(view);
    }
    let stand_still = cameras
        .values()
        .all(|views| views.iter().all(|view| view.camera == views[0].camera));
    if !stand_still {
        return Ok(Vec::new());
    }
    let cameras: Vec<Vec<&View>> = cameras.into_values().collect();
    let seen = cameras.into_par_iter().map(|mut views| {
        views.sort_by(|a, b| a.time.total_cmp(&b.time));
        let looks = LOOKS.min(views.len());
        let chosen = (0..looks).map(|look| views[look * views.len() / looks]);
        let camera = views[0].camera.clone();
        let blocks = Blocks::of(camera.width, camera.height);
        let pictures = chosen
            .map(|view| Ok(blocks.means(&view.rgb(background)?)))
            .collect::<Result<Vec<_>, Error>>()?;
        let changes = widened(&changes(&pictures), blocks);
        Ok(Seen {
            camera,
            blocks,
            changes,
        })
    });
    seen.collect()
}

/// Which blocks change, given their mean colours in several pictures, each `[blocks, 3]`.
fn changes(pictures: &[Vec<f32>]) -> Vec<bool> {
    let values = pictures.first().map_or(0, Vec::len);
    let usual: Vec<f32> = (0..values)
        .map(|k| median(pictures.iter().map(|picture| picture[k])).unwrap_or(0.0))
        .collect();
    let mut changes = vec![false; values / 3];
    for picture in pictures {
        let pairs = || picture.chunks_exact(3).zip(usual.chunks_exact(3));
        // What the whole picture does is exposure that varies.
        let common: [f32; 3] =
            std::array::from_fn(|c| median(pairs().map(|(a, b)| a[c] - b[c])).unwrap_or(0.0));
        let off = |a: &[f32], b: &[f32], c: usize| (a[c] - b[c] - common[c]).abs();
        let differences: Vec<f32> = pairs()
            .map(|(a, b)| (0..3).map(|c| off(a, b, c)).fold(0.0, f32::max))
            .collect();
        let typical = median(differences.iter().copied()).unwrap_or(0.0);
        let change = LEAST_CHANGE.max(ABOVE_TYPICAL * typical);
        for (changes, difference) in changes.iter_mut().zip(differences) {
            *changes |= difference > change;
        }
    }
    changes
}

/// The same with their neighbours.
fn widened(changes: &[bool], blocks: Blocks) -> Vec<bool> {
    let around = |at: usize, end: usize| at.saturating_sub(1)..(at + 2).min(end);
    let any = |block: usize| {
        let (row, column) = (block / blocks.columns, block % blocks.columns);
        around(row, blocks.rows)
            .any(|r| around(column, blocks.columns).any(|c| changes[r * blocks.columns + c]))
    };
    (0..changes.len()).map(any).collect()
}

/// Whether too few of the cameras that have a place in sight see it change for something there to move.
fn rests(seen: &[Seen], mean: [f32; 3], share: f32) -> bool {
    let (mut in_sight, mut changing) = (0, 0);
    for camera in seen {
        if let Some(([u, v], _)) = camera.camera.project_inside(mean.map(f64::from)) {
            let pixel = v as usize * camera.camera.width + u as usize;
            in_sight += 1;
            changing += usize::from(camera.changes[camera.blocks.at(pixel)]);
        }
    }
    (changing as f32) < share * in_sight as f32
}

#[cfg(test)]
mod tests;
