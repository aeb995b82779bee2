//! Small motion counts more in the error, while the coarse field looks for motion.
//!
//! An object on a few pixels has next to no say in the mean over a picture, nor in the one field that moves the whole
//! scene: the field leaves it behind in the steps that it takes for larger ones.

use std::collections::BTreeMap;

use crate::Error;
use crate::dataset::{Dataset, View};
use crate::numbers::median;
use crate::train::core::{Run, TimeSpan};
use crate::train::extensions::blocks::Blocks;

/// Least difference of a block's mean colour that is a change, in any channel.
const LEAST_CHANGE: f32 = 0.04;
/// How many times the typical difference of a picture's blocks a change is: noise, and exposure that varies,
/// are none.
const ABOVE_TYPICAL: f32 = 6.0;
/// Most that a pixel counts beyond what it does by itself: the fewer change, the more likely by chance.
const MOST: f32 = 10.0;
/// Pictures of each camera that are asked how much of it changes.
const LOOKS: usize = 8;
/// Least share of a camera's pictures that changed blocks count as.
const MIN_SHARE: f32 = 0.03;

/// What each camera saw where following motion begins, and how much more counts what has moved since.
pub(super) struct SmallMotion {
    starts: BTreeMap<usize, Start>,
}

struct Start {
    grid: Blocks,
    blocks: Vec<f32>,
    weight: f32,
}

impl SmallMotion {
    /// Of a run, since the span that it starts from.
    pub(super) fn since<M>(run: &Run<M>, span: TimeSpan) -> Result<Self, Error> {
        let background = run.scene.settings.background;
        Self::compare(span, &run.dataset, &run.train_views, background, MIN_SHARE)
    }

    /// Compares a few training views of each camera that stands still with the one nearest to the middle of
    /// the span that following starts from. Where not even the one that differs most does so on a share
    /// `least` of its blocks, those that differ are to count as that much.
    fn compare(
        span: TimeSpan,
        dataset: &Dataset,
        train_views: &[usize],
        background: [f32; 3],
        least: f32,
    ) -> Result<Self, Error> {
        let mut cameras: BTreeMap<usize, Vec<&View>> = BTreeMap::new();
        for &index in train_views {
            let view = &dataset.views[index];
            cameras.entry(view.camera_index).or_default().push(view);
        }
        let away = |view: &View| (view.time - span.middle()).abs();
        let mut starts = BTreeMap::new();
        for (index, mut views) in cameras {
            views.sort_by(|a, b| a.time.total_cmp(&b.time));
            let nearest = views.iter().min_by(|a, b| away(a).total_cmp(&away(b)));
            let Some(&first) = nearest else { continue };
            if views.iter().any(|view| view.camera != first.camera) {
                continue;
            }
            let grid = Blocks::of(first.camera.width, first.camera.height);
            let blocks = grid.means(&first.rgb(background)?);
            let mut most = 0.0f32;
            let looks = LOOKS.min(views.len());
            for look in 0..looks {
                let view = views[look * (views.len() - 1) / (looks - 1).max(1)];
                let changed = changed(&blocks, &grid.means(&view.rgb(background)?));
                let n = changed.iter().filter(|&&changed| changed).count();
                most = most.max(n as f32 / changed.len() as f32);
            }
            let weight = (least / most - 1.0).clamp(0.0, MOST);
            if most > 0.0 && weight > 0.0 {
                let start = Start {
                    grid,
                    blocks,
                    weight,
                };
                starts.insert(index, start);
            }
        }
        Ok(Self { starts })
    }

    /// How much each pixel of a view's picture `rgb [H, W, 3]` counts beyond what it does by itself, `[H * W]`;
    /// `None` where none counts more.
    pub(super) fn weights(&self, view: &View, rgb: &[f32]) -> Option<Vec<f32>> {
        let start = self.starts.get(&view.camera_index)?;
        let changed = changed(&start.blocks, &start.grid.means(rgb));
        if !changed.contains(&true) {
            return None;
        }
        let weight_of = |pixel| f32::from(u8::from(changed[start.grid.at(pixel)])) * start.weight;
        Some((0..rgb.len() / 3).map(weight_of).collect())
    }
}

/// Which blocks differ between two pictures, of block means `[blocks, 3]`.
fn changed(start: &[f32], now: &[f32]) -> Vec<bool> {
    let pairs = start.chunks_exact(3).zip(now.chunks_exact(3));
    let differences: Vec<f32> = pairs
        .map(|(a, b)| (0..3).map(|c| (a[c] - b[c]).abs()).fold(0.0, f32::max))
        .collect();
    let typical = median(differences.iter().copied()).unwrap_or(0.0);
    let change = LEAST_CHANGE.max(ABOVE_TYPICAL * typical);
    differences.iter().map(|&d| d > change).collect()
}

#[cfg(test)]
mod tests {
    use std::path::PathBuf;

    use dash_kernels::Camera;

    use super::*;
    use crate::dataset::Layout;
    use crate::train::core::capture::start_span;

    const SIDE: usize = 40;

    fn camera(turn: f64) -> Camera {
        let camera = Camera::new(40.0, 40.0, 20.0, 20.0, SIDE, SIDE);
        let eye = [3.0 * turn.cos(), 1.0, 3.0 * turn.sin()];
        camera.look_at(eye, [0.0; 3], [0.0, 1.0, 0.0])
    }

    /// Grey with noise; at `frame` a bright square of `size` pixels a side, ten pixels further each frame.
    fn picture(frame: usize, size: usize, noise: usize) -> Vec<u8> {
        let mut rgb: Vec<u8> = (0..SIDE * SIDE * 3)
            .map(|i| (100 + (i * 7919 + frame * 104_729) % 31 * noise / 31) as u8)
            .collect();
        for row in 4..4 + size {
            for column in 10 * frame..10 * frame + size {
                let pixel = 3 * (row * SIDE + column);
                rgb[pixel..pixel + 3].fill(250);
            }
        }
        rgb
    }

    /// Five cameras, three frames.
    fn dataset(size: usize, noise: usize) -> Dataset {
        let views = (0..15).map(|i| {
            let (camera_index, frame) = (i % 5, i / 5);
            let time = 0.5 * frame as f32;
            let rgb = picture(frame, size, noise);
            let mut view = View::from_rgb8("made", camera(camera_index as f64), time, rgb);
            (view.camera_index, view.frame) = (camera_index, frame);
            view
        });
        Dataset {
            name: "made".into(),
            root: PathBuf::new(),
            layout: Layout::Blender,
            n_frames: 3,
            n_cameras: 5,
            stated_span: None,
            frame_rate: None,
            views: views.collect(),
            points: None,
            background: None,
        }
    }

    fn weights(dataset: &Dataset, view: usize, least: f32) -> Option<Vec<f32>> {
        let all: Vec<usize> = (0..dataset.views.len()).collect();
        let span = start_span(dataset, &all).expect("a rig");
        let moved = SmallMotion::compare(span, dataset, &all, [0.0; 3], least).expect("pictures");
        let view = &dataset.views[view];
        moved.weights(view, &view.rgb([0.0; 3]).expect("a picture"))
    }

    #[test]
    fn what_moved_counts_as_the_least_share_where_it_is_and_was() {
        for noise in [0, 12] {
            let dataset = dataset(4, noise);
            // The last frame of the second camera: the square is at column 20, and was at 10.
            let found = weights(&dataset, 11, 0.06).expect("something moved");
            let has_moved = |pixel: usize| {
                let (row, column) = (pixel / SIDE, pixel % SIDE);
                (4..8).contains(&row) && ((10..14).contains(&column) || (20..24).contains(&column))
            };
            for (pixel, &weight) in found.iter().enumerate() {
                assert_eq!(
                    weight > 0.0,
                    has_moved(pixel),
                    "pixel {pixel}, noise {noise}"
                );
            }
            let moved = found.iter().filter(|&&weight| weight > 0.0);
            let counts: f32 = moved.map(|weight| 1.0 + weight).sum();
            assert!((counts / (0.06 * 1_600.0) - 1.0).abs() < 1e-5, "{counts}");
        }
    }

    #[test]
    fn what_covers_enough_or_rests_counts_as_it_does() {
        let large = dataset(8, 0);
        assert_eq!(weights(&large, 11, 0.06), None);
        assert!(weights(&large, 11, 0.1).is_some());
        // The frame from which motion is followed.
        assert_eq!(weights(&large, 6, 0.1), None);
        assert_eq!(weights(&dataset(0, 12), 11, 0.1), None);
    }

    #[test]
    fn a_few_pixels_have_a_limit_and_a_moving_camera_tells_nothing() {
        let mut dataset = dataset(4, 0);
        let most = |weights: Vec<f32>| weights.into_iter().fold(0.0, f32::max);
        assert_eq!(weights(&dataset, 11, 1.0).map(most), Some(MOST));
        dataset.views[11].camera = camera(0.3);
        assert_eq!(weights(&dataset, 1, 1.0), None);
        assert!(weights(&dataset, 2, 1.0).is_some());
    }
}
