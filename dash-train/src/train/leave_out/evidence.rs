//! Whether anything moves at all, told from the videos of cameras that stand still before any training.
//!
//! What moves changes neighbouring places at neighbouring times; noise does not. So pictures are
//! averaged over small blocks, their changes over time smoothed over neighbours in space and time, and
//! the largest such change compared with the largest after each block's times were shuffled.

use std::collections::BTreeMap;

use rand::SeedableRng;
use rand::seq::SliceRandom;
use rand_pcg::Pcg64;
use rayon::prelude::*;

use super::{Decision, FIELD};
use crate::TrainError;
use crate::dataset::View;
use crate::train::trainer::Trainer;

/// Most frames of a camera that are looked at.
const MAX_FRAMES: usize = 24;
/// Fewest: changes of fewer show nothing about their order.
const MIN_FRAMES: usize = 3;
/// Blocks across a picture.
const BLOCKS: usize = 80;
/// Sides of a block, pixels.
const SIDES: (usize, usize) = (2, 16);
/// Shuffles: that the largest change of all is not a shuffled one has probability 1 in 20 where nothing moves,
/// and then only costs time.
const SHUFFLES: usize = 19;
/// Smoothed changes below one step of an 8-bit channel show nothing.
const FLOOR: f32 = 1.0 / 255.0;
/// Seed of the shuffles, which no other choice of the run depends on.
const SEED: u64 = 0x5eed;

/// Changes of a camera's blocks over time `[frames, rows, columns, 3]`.
struct Changes {
    size: [usize; 3],
    values: Vec<f32>,
}

/// The decision whether anything moves; `None` where cameras move too, so that videos do not tell.
pub(super) fn of_motion(trainer: &Trainer) -> Result<Option<Decision>, TrainError> {
    let background = trainer.scene.settings.background;
    let mut cameras: BTreeMap<usize, Vec<&View>> = BTreeMap::new();
    for &index in &trainer.train_views {
        let view = &trainer.dataset.views[index];
        cameras.entry(view.camera_index).or_default().push(view);
    }
    let (mut moved, mut shuffled) = (0.0f32, 0.0f32);
    for views in cameras.values_mut() {
        views.sort_by_key(|view| view.frame);
        let stands = views.iter().all(|view| view.camera == views[0].camera);
        if !stands || views.len() < MIN_FRAMES {
            return Ok(None);
        }
        let n = views.len().min(MAX_FRAMES);
        let chosen = (0..n).map(|k| views[k * (views.len() - 1) / (n - 1)]);
        let changes = Changes::of(chosen, background)?;
        moved = moved.max(changes.largest());
        shuffled = shuffled.max(changes.largest_shuffled());
        if moved > FLOOR && moved > shuffled {
            break;
        }
    }
    let moves = moved > FLOOR && moved > shuffled;
    let mut decision = Decision::new(trainer, FIELD);
    decision.left_out = !moves;
    decision.reason = format!(
        "largest coherent change over time in the videos {:.2} of 255, {:.2} with times shuffled \
             {SHUFFLES} times; {} above both that and 1",
        255.0 * moved,
        255.0 * shuffled,
        if moves { "it is" } else { "it has to be" }
    );
    Ok(Some(decision))
}

impl Changes {
    fn of<'a>(
        views: impl Iterator<Item = &'a View>,
        background: [f32; 3],
    ) -> Result<Self, TrainError> {
        let (mut values, mut size, mut frames) = (Vec::new(), [0, 0], 0);
        for view in views {
            let (width, height) = (view.camera.width, view.camera.height);
            let side = (width / BLOCKS).clamp(SIDES.0, SIDES.1);
            size = [height.div_ceil(side), width.div_ceil(side)];
            frames += 1;
            values.extend(blocks(&view.rgb(background)?, width, side, size));
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

    /// The largest change after smoothing, root mean square over the channels.
    fn largest(&self) -> f32 {
        let [frames, rows, columns] = self.size;
        let mut smooth = smoothed(&self.values, 3, columns * 3);
        smooth = smoothed(&smooth, columns * 3, rows * columns * 3);
        smooth = smoothed(&smooth, rows * columns * 3, frames * rows * columns * 3);
        smooth
            .chunks_exact(3)
            .map(|c| ((c[0] * c[0] + c[1] * c[1] + c[2] * c[2]) / 3.0).sqrt())
            .fold(0.0, f32::max)
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
                Self { size, values }.largest()
            })
            .reduce(|| 0.0, f32::max)
    }
}

/// Means over blocks of a picture `[H, W, 3]`, row by row.
fn blocks(rgb: &[f32], width: usize, side: usize, [rows, columns]: [usize; 2]) -> Vec<f32> {
    let mut sums = vec![0.0f32; rows * columns * 3];
    let mut counts = vec![0u32; rows * columns];
    for (pixel, color) in rgb.chunks_exact(3).enumerate() {
        let block = pixel / width / side * columns + pixel % width / side;
        counts[block] += 1;
        for (sum, value) in sums[3 * block..].iter_mut().zip(color) {
            *sum += value;
        }
    }
    for (sum, &count) in sums.chunks_exact_mut(3).zip(&counts) {
        sum.iter_mut().for_each(|value| *value /= count as f32);
    }
    sums
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

    const SIZE: [usize; 3] = [12, 20, 30];

    fn changes(noise: f32, moving: impl Fn(usize, usize, usize) -> f32) -> Changes {
        let mut rng = Pcg64::seed_from_u64(7);
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

    #[test]
    fn noise_alone_is_not_above_its_shuffles() {
        let still = changes(0.1, |_, row, column| (row * column) as f32 / 600.0);
        let (moved, shuffled) = (still.largest(), still.largest_shuffled());
        assert!(moved < 1.1 * shuffled, "{moved}, shuffled {shuffled}");
        let none = changes(0.0, |_, row, _| row as f32);
        assert!(none.largest() < FLOOR, "{}", none.largest());
    }

    #[test]
    fn a_block_that_moves_through_noise_stands_above_them() {
        let moving = changes(0.1, |frame, row, column| {
            if row == 9 && column == frame + 5 {
                0.5
            } else {
                0.0
            }
        });
        let (moved, shuffled) = (moving.largest(), moving.largest_shuffled());
        assert!(
            moved > shuffled && moved > FLOOR,
            "{moved}, shuffled {shuffled}"
        );
    }

    #[test]
    fn blocks_at_the_border_are_means_too() {
        let picture: Vec<f32> = (0..5 * 3).flat_map(|i| [i as f32, 1.0, 0.0]).collect();
        let means = blocks(&picture, 5, 2, [2, 3]);
        // Pixels 0, 1, 5, 6; the corner is pixel 14 alone.
        assert_eq!(means[..3], [3.0, 1.0, 0.0]);
        assert_eq!(means[15..], [14.0, 1.0, 0.0]);
    }
}
