//! What cameras that stand still see change: what looks as it did in the middle of the clip stays where it was.

use std::collections::BTreeMap;

use dash_kernels::Camera;
use glam::{DVec3, Vec3};
use rayon::prelude::*;

use crate::Error;
use crate::dataset::View;
use crate::train::core::Run;
use crate::train::core::initial_views::{difference, smoothed};

/// Longest side of the pictures that are compared, pixels.
const MAX_SIDE: usize = 320;
/// Mean difference of the channels from which on a pixel has changed.
const LEAST_CHANGE: f32 = 0.04;
/// How far around a change is one, in shares of the image's width: what has one colour changes at its edges only.
const AROUND: f32 = 0.02;

/// A camera's small, smoothed picture.
struct Picture {
    camera: Camera,
    colors: Vec<[f32; 3]>,
}

/// The pictures that others are compared with, by camera.
pub(super) struct Changes(BTreeMap<usize, Picture>);

impl Changes {
    /// Since a time.
    pub(super) fn since<M>(run: &Run<M>, time: f32) -> Result<Self, Error> {
        Ok(Self(pictures(run, time)?))
    }

    /// Whether most of the cameras that have a point in their picture see a change around it at `time`. A camera that
    /// has moved does not tell; where none does, anything may have changed.
    pub(super) fn around<M>(
        &self,
        run: &Run<M>,
        time: f32,
        points: &[Vec3],
    ) -> Result<Vec<bool>, Error> {
        let maps: Vec<(Camera, Vec<bool>)> = pictures(run, time)?
            .into_par_iter()
            .filter_map(|(index, Picture { camera, colors })| {
                let first = self.0.get(&index)?;
                (first.camera == camera).then(|| {
                    let pairs = first.colors.iter().zip(&colors);
                    let changed: Vec<bool> = pairs
                        .map(|(a, b)| difference(*a, *b) > LEAST_CHANGE)
                        .collect();
                    let radius = (AROUND * camera.width as f32).ceil() as usize;
                    let map = dilated(&changed, camera.width, radius);
                    (camera, map)
                })
            })
            .collect();
        let changed = |&point: &Vec3| {
            let (mut yes, mut all) = (0, 0);
            for (camera, map) in &maps {
                if let Some(([u, v], _)) = camera.project_inside(DVec3::from(point).to_array()) {
                    all += 1;
                    yes += usize::from(map[v as usize * camera.width + u as usize]);
                }
            }
            2 * yes > all || all == 0
        };
        Ok(points.par_iter().map(changed).collect())
    }
}

/// The pictures of a training time.
fn pictures<M>(run: &Run<M>, time: f32) -> Result<BTreeMap<usize, Picture>, Error> {
    let background = run.scene.settings.background;
    let views: Vec<&View> = run.views().filter(|view| view.time == time).collect();
    let picture = |view: &View| {
        let small = view.at_most(MAX_SIDE, background)?;
        let colors = smoothed(&small.rgb, &small.camera);
        let camera = small.camera;
        Ok((view.camera_index, Picture { camera, colors }))
    };
    views.into_par_iter().map(picture).collect()
}

/// Marks everything within a square of `radius` around what is marked.
fn dilated(map: &[bool], width: usize, radius: usize) -> Vec<bool> {
    // Along lines of so many pixels, each `stride` after the one before it.
    let along = |map: &[bool], length: usize, stride: usize, starts: Vec<usize>| {
        let mut marked = vec![false; map.len()];
        for start in starts {
            for k in (0..length).filter(|k| map[start + k * stride]) {
                for near in k.saturating_sub(radius)..(k + radius + 1).min(length) {
                    marked[start + near * stride] = true;
                }
            }
        }
        marked
    };
    let height = map.len() / width.max(1);
    let rows = along(map, width, 1, (0..height).map(|row| row * width).collect());
    along(&rows, height, width, (0..width).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_mark_spreads_to_a_square_and_not_beyond_the_picture() {
        let (width, height) = (7, 5);
        let mut map = vec![false; width * height];
        map[width + 1] = true;
        map[4 * width + 6] = true;
        let found = dilated(&map, width, 2);
        for (pixel, &marked) in found.iter().enumerate() {
            let (row, column) = (pixel / width, pixel % width);
            let near = |r: usize, c: usize| row.abs_diff(r) <= 2 && column.abs_diff(c) <= 2;
            assert_eq!(marked, near(1, 1) || near(4, 6), "{row} {column}");
        }
    }
}
