//! Whether anything moves at all, told from the videos of cameras that stand still before any training.
//!
//! Pictures are averaged over small blocks, and the blocks' changes over time looked at in two ways.
//! What moves slowly changes neighbouring places at neighbouring times, which noise does not: smoothed
//! over neighbours in space and time, its largest change is above the largest after each block's times
//! were shuffled. What moves fast changes a place for a moment, by more than noise does.

use std::collections::BTreeMap;

use rand::SeedableRng;
use rand::seq::SliceRandom;
use rand_pcg::Pcg64;
use rayon::prelude::*;

use super::FIELD;
use crate::Error;
use crate::dataset::View;
use crate::numbers::median;
use crate::train::core::{Decision, Run};
use crate::train::extensions::blocks::Blocks;

/// Most pixels of all videos that are looked at; where there are more, something could move between
/// those that are.
const MAX_PIXELS: usize = 2_000_000_000;
/// Fewest frames of a camera: changes of fewer show nothing about their order.
const MIN_FRAMES: usize = 3;
const SHUFFLES: usize = 19;
/// How far above the largest shuffled change motion is. Where nothing moves, the largest changes differ by
/// some percent from shuffle to shuffle, and there are many cameras; to see motion where there is none only
/// costs time.
const ABOVE: f32 = 1.25;
/// A momentary change is one of this many times what is typical: the largest of a million normal
/// changes is below 6 standard deviations, which are 4 times the median of their sizes.
const MOMENTARY: f32 = 8.0 / 0.6745;
/// Changes below one step of an 8-bit channel show nothing.
const FLOOR: f32 = 1.0 / 255.0;
/// Seed of the shuffles, which no other choice of the run depends on.
const SEED: u64 = 0x5eed;

/// Changes of a camera's blocks over time `[frames, rows, columns, 3]`.
struct Changes {
    size: [usize; 3],
    values: Vec<f32>,
}

/// The decision whether anything moves; `None` where cameras move too, so that videos do not tell.
pub(super) fn of_motion<M>(run: &Run<M>) -> Result<Option<Decision>, Error> {
    let background = run.scene.settings.background;
    let mut cameras: BTreeMap<usize, Vec<&View>> = BTreeMap::new();
    for &index in &run.train_views {
        let view = &run.dataset.views[index];
        cameras.entry(view.camera_index).or_default().push(view);
    }
    let pixels = |view: &View| view.camera.width * view.camera.height;
    let all: usize = cameras.values().flatten().map(|view| pixels(view)).sum();
    if all > MAX_PIXELS {
        return Ok(None);
    }
    let mut most = Seen::default();
    for views in cameras.values_mut() {
        views.sort_by_key(|view| view.frame);
        let stands = views.iter().all(|view| view.camera == views[0].camera);
        if !stands || views.len() < MIN_FRAMES {
            return Ok(None);
        }
        let seen = Seen::in_video(&Changes::of(views, background)?);
        if seen.motion() || seen.smoothed > most.smoothed {
            most = seen;
        }
        if most.motion() {
            break;
        }
    }
    let mut decision = Decision::kept(run.step, FIELD);
    decision.left_out = !most.motion();
    let verdict = if most.motion() {
        "that is motion"
    } else {
        "motion is above 1, and either a quarter above what shuffling leaves or above 12 times what is \
         typical"
    };
    decision.reason = format!(
        "changes over time of the video that changes most, of 255: smoothed at most {:.2}, {:.2} with \
         times shuffled {SHUFFLES} times; momentary at most {:.2}, typically {:.2}; {verdict}",
        255.0 * most.smoothed,
        255.0 * most.shuffled,
        255.0 * most.momentary,
        255.0 * most.typical,
    );
    Ok(Some(decision))
}

/// The largest changes of a video.
#[derive(Default)]
struct Seen {
    smoothed: f32,
    shuffled: f32,
    momentary: f32,
    typical: f32,
}

impl Seen {
    fn in_video(changes: &Changes) -> Self {
        let sizes = changes.sizes();
        Self {
            smoothed: changes.largest_smoothed(),
            shuffled: changes.largest_shuffled(),
            momentary: sizes.iter().copied().fold(0.0, f32::max),
            typical: median(sizes).unwrap_or(0.0),
        }
    }

    fn motion(&self) -> bool {
        let slow = self.smoothed > FLOOR && self.smoothed > ABOVE * self.shuffled;
        let fast = self.momentary > FLOOR && self.momentary > MOMENTARY * self.typical;
        slow || fast
    }
}

/// Root mean square over the channels of values `[.., 3]`.
fn sizes(values: &[f32]) -> impl Iterator<Item = f32> {
    let colors = values.chunks_exact(3);
    colors.map(|c| ((c[0] * c[0] + c[1] * c[1] + c[2] * c[2]) / 3.0).sqrt())
}

impl Changes {
    fn of(views: &[&View], background: [f32; 3]) -> Result<Self, Error> {
        let (mut values, mut size, mut frames) = (Vec::new(), [0, 0], 0);
        for view in views {
            let blocks = Blocks::of(view.camera.width, view.camera.height);
            size = [blocks.rows, blocks.columns];
            frames += 1;
            values.extend(blocks.means(&view.rgb(background)?));
        }
        let mut changes = Self {
            size: [frames, size[0], size[1]],
            values,
        };
        changes.subtract_means();
        Ok(changes)
    }

    fn subtract_means(&mut self) {
        let frame = self.size[1] * self.size[2] * 3;
        let mut means = vec![0.0f64; frame];
        for values in self.values.chunks_exact(frame) {
            for (mean, value) in means.iter_mut().zip(values) {
                *mean += f64::from(*value) / self.size[0] as f64;
            }
        }
        for values in self.values.chunks_exact_mut(frame) {
            for (value, mean) in values.iter_mut().zip(&means) {
                *value -= *mean as f32;
            }
        }
    }

    /// The size of every change.
    fn sizes(&self) -> Vec<f32> {
        sizes(&self.values).collect()
    }

    /// The size of the largest change after smoothing.
    fn largest_smoothed(&self) -> f32 {
        let [frames, rows, columns] = self.size;
        let mut smooth = smoothed(&self.values, 3, columns * 3);
        smooth = smoothed(&smooth, columns * 3, rows * columns * 3);
        smooth = smoothed(&smooth, rows * columns * 3, frames * rows * columns * 3);
        sizes(&smooth).fold(0.0, f32::max)
    }

    /// The same, largest over shuffles of every block's times.
    fn largest_shuffled(&self) -> f32 {
        let [frames, rows, columns] = self.size;
        let blocks = rows * columns;
        (0..SHUFFLES as u64)
            .into_par_iter()
            .map(|shuffle| {
                let mut rng = Pcg64::seed_from_u64(SEED ^ shuffle);
                let mut order: Vec<usize> = (0..frames).collect();
                let mut values = vec![0.0; self.values.len()];
                for block in 0..blocks {
                    order.shuffle(&mut rng);
                    for (to, &from) in order.iter().enumerate() {
                        let (to, from) = ((to * blocks + block) * 3, (from * blocks + block) * 3);
                        values[to..to + 3].copy_from_slice(&self.values[from..from + 3]);
                    }
                }
                let size = self.size;
                Self { size, values }.largest_smoothed()
            })
            .reduce(|| 0.0, f32::max)
    }
}

/// Means over three neighbours along an axis of `stride` values, in runs of `length` values; the ends
/// have two.
fn smoothed(values: &[f32], stride: usize, length: usize) -> Vec<f32> {
    let mut out = values.to_vec();
    for (run, out) in values
        .chunks_exact(length)
        .zip(out.chunks_exact_mut(length))
    {
        for (i, out) in out.iter_mut().enumerate() {
            let (mut sum, mut count) = (run[i], 1.0);
            if i >= stride {
                sum += run[i - stride];
                count += 1.0;
            }
            if i + stride < length {
                sum += run[i + stride];
                count += 1.0;
            }
            *out = sum / count;
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use rand::Rng;

    use super::*;
    use crate::test_kit::slow_clips;

    const SIZE: [usize; 3] = [12, 20, 30];

    fn changes(seed: u64, noise: f32, moving: impl Fn(usize, usize, usize) -> f32) -> Changes {
        let mut rng = Pcg64::seed_from_u64(seed);
        let mut values = Vec::new();
        for frame in 0..SIZE[0] {
            for row in 0..SIZE[1] {
                for column in 0..SIZE[2] {
                    for _ in 0..3 {
                        let noise = noise * (rng.random::<f32>() - 0.5);
                        values.push(noise + moving(frame, row, column));
                    }
                }
            }
        }
        let mut changes = Changes { size: SIZE, values };
        changes.subtract_means();
        changes
    }

    fn motion(changes: &Changes) -> bool {
        Seen::in_video(changes).motion()
    }

    #[test]
    fn noise_alone_is_no_motion() {
        let still = |_: usize, row: usize, column: usize| (row * column) as f32 / 600.0;
        for seed in 0..20 {
            assert!(!motion(&changes(seed, 0.1, still)), "seed {seed}");
        }
        assert!(!motion(&changes(0, 0.0, still)));
    }

    #[test]
    fn slow_motion_is_motion_at_every_rate_and_noise() {
        for (clip, moves) in slow_clips() {
            let dataset = clip.dataset();
            let views: Vec<&View> = dataset.views.iter().collect();
            let changes = Changes::of(&views, [0.0; 3]).expect("in memory");
            assert_eq!(motion(&changes), moves, "{clip:?}");
        }
    }

    #[test]
    fn what_moves_through_noise_is_seen_slow_or_fast() {
        // A wide faint shadow, below the noise in each block.
        let slow = changes(7, 0.1, |frame, _, column| {
            if column.abs_diff(2 * frame) < 6 {
                0.03
            } else {
                0.0
            }
        });
        assert!(motion(&slow));
        // One bright block that is somewhere else in every frame.
        let fast = changes(7, 0.02, |frame, row, column| {
            if row == 9 && column == 2 * frame {
                0.5
            } else {
                0.0
            }
        });
        assert!(motion(&fast));
    }
}
