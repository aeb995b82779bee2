//! Scene flow of a rig: Gaussians are registered to one frame after another, outwards from where the warm-up saw them.
//!
//! At each frame they start from where their last velocity takes them, or block matching finds them. A small grid of offsets,
//! which begins at zero, is then fitted to that frame's pictures alone. Where Gaussians are at other frames does not change
//! meanwhile; what they look like improves with each picture.

mod changes;
mod present;
mod saved;

use std::collections::BTreeMap;

use burn::tensor::{Gradients, Tensor, TensorData};
use dash_model::{HashEncoderConfig, TrajectoryBasis};
use glam::Vec3;
use rayon::prelude::*;

use self::changes::Changes;
use self::present::Present;
use super::block_matching::{self, Ahead};
use crate::Error;
use crate::dataset::View;
use crate::train::core::{GradientVisit, Rate, Run, TimeSpan, to_host};
use crate::train::paper::Dash;

/// Name of the offsets among parameters.
const OFFSETS: &str = "scene_flow";
/// Levels of the grid of offsets, and cells a side at the coarsest and at the finest.
const LEVELS: usize = 4;
const CELLS: [u32; 2] = [16, 128];
/// Base-2 logarithm of the entries of a level, at most.
const LOG2_ENTRIES: u32 = 15;
/// Features of a level, the first three of which are an offset; levels add up.
const FEATURES: usize = 4;
/// Learning rate of the offsets, in shares of the image's width, and its factor at a frame's last step.
const RATE: f32 = 3e-4;
const RATE_LEFT: f32 = 0.1;
/// Share of the typical gradient that is added to Adam's denominator: cells that hardly matter should hardly move.
const DAMPING: f32 = 0.2;
/// Share of its last velocity that a Gaussian starts with, since errors would go on like motion.
const KEPT_VELOCITY: f32 = 0.8;
/// A velocity of so much of the image's width a frame is kept by half of that: what is slower is mostly noise.
const SLOW: f32 = 3e-4;
/// What is displaced by more, in shares of the image's width, may move even if pictures are as in the middle.
const DISPLACED: f32 = 1e-3;
/// How far Gaussians are looked for in the first new frame, in shares of the image's width.
const FIRST_REACH: f32 = 0.05;
/// Frames before a new one whose fastest velocity block matching looks at: what bounces is slow for a moment.
const LOOKED_BACK: usize = 4;

/// See the module.
pub(super) struct SceneFlow {
    /// Displacements of all Gaussians from their means, by place among the training times.
    known: BTreeMap<usize, Vec<Vec3>>,
    /// The place where Gaussians are at their means.
    middle: usize,
    /// World units that take the image's width, at the typical distance.
    width: f32,
    present: Option<Present>,
    changes: Option<Changes>,
}

impl SceneFlow {
    /// Of a run at the end of its warm-up.
    pub(super) fn new(run: &Run<Dash>) -> Self {
        let middle = middle(run);
        let at_rest = vec![Vec3::ZERO; run.scene.static_set.len()];
        Self {
            known: BTreeMap::from([(middle, at_rest)]),
            middle,
            width: typical_width(run),
            present: None,
            changes: None,
        }
    }

    /// Goes on to the frame of this step, one of `[begin, end)`.
    pub(super) fn advance(
        &mut self,
        run: &mut Run<Dash>,
        [begin, end]: [usize; 2],
    ) -> Result<(), Error> {
        let order = outwards(self.middle, run.times.all().len());
        let n = order.len();
        let first_step = |k: usize| begin + k * (end - begin) / n;
        // With fewer steps than frames, some frames have none.
        let Some(k) = (0..n).rev().find(|&k| first_step(k) <= run.step) else {
            return Ok(());
        };
        let is_present = |present: &Present| present.place == order[k];
        if self.present.as_ref().is_some_and(is_present) {
            return Ok(());
        }
        self.settle(run)?;
        for &place in &order[..k] {
            if !self.known.contains_key(&place) {
                let expected = self.expected(run, place);
                self.known.insert(place, expected);
            }
        }
        let steps = [first_step(k), first_step(k + 1)];
        self.present = Some(self.meet(run, order[k], steps)?);
        run.sampler.restart();
        Ok(())
    }

    /// Whether the step's frame is that of a view.
    pub(super) fn shows(&self, run: &Run<Dash>, view: &View) -> bool {
        let time = |present: &Present| run.times.all()[present.place];
        self.present
            .as_ref()
            .is_some_and(|present| view.time == time(present))
    }

    /// Where Gaussians are at the step's frame, relative to their means `[N, 3]`.
    pub(super) fn displacement(&mut self, run: &Run<Dash>) -> Result<Option<Tensor<2>>, Error> {
        let Some(present) = &mut self.present else {
            return Ok(None);
        };
        let n = present.from.len();
        let [from, expected, moves] = present.on_device(run).clone();
        let levels = present
            .offsets
            .forward(from)?
            .reshape([n, LEVELS, FEATURES]);
        let offsets = levels.sum_dim(1).reshape([n, FEATURES]).narrow(1, 0, 3);
        Ok(Some(expected + offsets * moves * self.width))
    }

    /// Shows the offsets.
    pub(super) fn gradients(&self, visit: &mut GradientVisit<'_>) {
        if let Some(present) = &self.present {
            visit.module(&present.offsets);
        }
    }

    /// One step of Adam on the offsets.
    pub(super) fn learn(&mut self, run: &mut Run<Dash>, gradients: &mut Gradients) {
        let Some(mut present) = self.present.take() else {
            return;
        };
        let [from, to] = present.steps;
        let progress = (run.step - from) as f32 / (to - from).max(1) as f32;
        let rate = Rate {
            rate: RATE * (1.0 - (1.0 - RATE_LEFT) * progress),
            damping: DAMPING,
            views: run.config.batch,
        };
        present.offsets = run
            .optimizer
            .step(OFFSETS, present.offsets, gradients, |_| rate);
        self.present = Some(present);
    }

    /// Lets state per Gaussian follow an edit of their rows.
    pub(super) fn gather(&mut self, sources: &[Option<usize>]) {
        let pick = |values: &mut Vec<Vec3>| {
            let picked = sources
                .iter()
                .map(|source| source.map_or(Vec3::ZERO, |row| values[row]));
            *values = picked.collect();
        };
        self.known.values_mut().for_each(pick);
        if let Some(present) = &mut self.present {
            present.on_device = None;
            pick(&mut present.from);
            pick(&mut present.expected);
            let moves = sources
                .iter()
                .map(|source| source.map_or(1.0, |row| present.moves[row]));
            present.moves = moves.collect();
        }
    }

    /// The coefficients `[N, B * 3]` of trajectories through where Gaussians are at the ends of a polyline's spans.
    pub(super) fn trajectories(
        mut self,
        run: &mut Run<Dash>,
        basis: TrajectoryBasis,
    ) -> Result<Tensor<2>, Error> {
        self.settle(run)?;
        let times = run.times.all();
        let (first, last) = (self.known.first_key_value(), self.known.last_key_value());
        let at = |time: f32, row: usize| {
            let after = times.partition_point(|&t| t < time);
            let before = self.known.range(..after).next_back().or(first);
            let after = self.known.range(after..).next().or(last);
            let (Some((&a, from)), Some((&b, to))) = (before, after) else {
                return Vec3::ZERO;
            };
            let share = (time - times[a]) / (times[b] - times[a]).max(f32::MIN_POSITIVE);
            from[row].lerp(to[row], share.clamp(0.0, 1.0))
        };
        let (n, spans) = (run.scene.static_set.len(), basis.len());
        let coefficients: Vec<f32> = (0..n)
            .into_par_iter()
            .flat_map_iter(|row| {
                let end = move |k: usize| at(k as f32 / spans as f32, row);
                (0..spans).flat_map(move |k| (end(k + 1) - end(k)).to_array())
            })
            .collect();
        Ok(Tensor::from_data(
            TensorData::new(coefficients, [n, 3 * spans]),
            &run.device,
        ))
    }

    /// Begins a frame.
    fn meet(
        &mut self,
        run: &mut Run<Dash>,
        place: usize,
        steps: [usize; 2],
    ) -> Result<Present, Error> {
        let means = to_host(run.scene.static_set.means.val());
        let means: Vec<Vec3> = means.chunks_exact(3).map(Vec3::from_slice).collect();
        let moved = |displacements: &[Vec3]| -> Vec<Vec3> {
            means
                .iter()
                .zip(displacements)
                .map(|(&mean, &moved)| mean + moved)
                .collect()
        };
        let mut expected = self.expected(run, place);
        let changes = match self.changes.take() {
            Some(changes) => changes,
            None => Changes::since(run, run.times.all()[self.middle])?,
        };
        let before: Vec<(usize, &Vec<Vec3>)> = self.inwards(place).take(LOOKED_BACK).collect();
        let last = before.first().map_or(&expected, |&(_, last)| last).clone();
        let from = moved(&last);
        let times = run.times.all();
        let changed = changes.around(run, times[place], &from)?;
        // At first no velocity is known.
        let begins = before.len() == 1;
        let reach = |&changed: &bool| match begins && changed {
            true => FIRST_REACH * self.width,
            false => 0.0,
        };
        let ahead = Ahead {
            time: times[place],
            known: before.iter().map(|&(place, _)| times[place]).collect(),
            before: before
                .iter()
                .map(|&(_, displacements)| moved(displacements))
                .collect(),
            expected: moved(&expected),
            reach: changed.iter().map(reach).collect(),
        };
        let found = block_matching::find(run, &ahead)?;
        self.changes = Some(changes);
        let mut moves: Vec<f32> = changed
            .into_iter()
            .zip(&last)
            .map(|(changed, last)| {
                f32::from(u8::from(changed || last.length() > DISPLACED * self.width))
            })
            .collect();
        for row in 0..moves.len() {
            if moves[row] == 0.0 {
                expected[row] = last[row];
            }
        }
        for (row, shift) in found {
            expected[row] = last[row] + shift;
            moves[row] = 1.0;
        }
        run.optimizer.forget(OFFSETS);
        let offsets = grid().init(&mut run.rng, &run.device)?;
        Ok(Present {
            place,
            steps,
            from,
            expected,
            moves,
            on_device: None,
            offsets,
        })
    }

    /// Keeps what the frame has taught.
    fn settle(&mut self, run: &Run<Dash>) -> Result<(), Error> {
        let found = self.displacement(run)?;
        if let (Some(found), Some(present)) = (found, self.present.take()) {
            let found = to_host(found.detach());
            let found = found.chunks_exact(3).map(Vec3::from_slice);
            self.known.insert(present.place, found.collect());
        }
        Ok(())
    }

    /// What is known of frames from one towards the middle, and beyond.
    fn inwards(&self, place: usize) -> Box<dyn Iterator<Item = (usize, &Vec<Vec3>)> + '_> {
        let known = |(&place, known)| (place, known);
        if place > self.middle {
            Box::new(self.known.range(..place).rev().map(known))
        } else {
            Box::new(self.known.range(place + 1..).map(known))
        }
    }

    /// Where the last velocity leads.
    fn expected(&self, run: &Run<Dash>, place: usize) -> Vec<Vec3> {
        let times = run.times.all();
        let mut inwards = self.inwards(place);
        let Some((a, last)) = inwards.next() else {
            return vec![Vec3::ZERO; run.scene.static_set.len()];
        };
        let Some((b, earlier)) = inwards.next() else {
            return last.clone();
        };
        let ratio = (times[place] - times[a]) / (times[a] - times[b]);
        let slow = (SLOW * self.width).powi(2);
        let pairs = last.iter().zip(earlier);
        let ahead = pairs.map(|(&last, &earlier)| {
            let way = (last - earlier) * ratio;
            let squared = way.length_squared();
            last + way * (KEPT_VELOCITY * squared / (squared + slow))
        });
        ahead.collect()
    }
}

/// The grid of offsets; they are as good as zero at first.
fn grid() -> HashEncoderConfig {
    let [coarsest, finest] = CELLS;
    let mut config = HashEncoderConfig::new(LEVELS, LOG2_ENTRIES, [coarsest; 3], [finest; 3]);
    config.n_features_per_level = FEATURES;
    config
}

/// The training time in the middle of the span that training starts from.
fn middle(run: &Run<Dash>) -> usize {
    let middle = run.start.map_or(0.5, TimeSpan::middle);
    let times = run.times.all();
    let away = |place: usize| (times[place] - middle).abs();
    (0..times.len())
        .min_by(|&a, &b| away(a).total_cmp(&away(b)))
        .unwrap_or(0)
}

/// All places but the middle, in turns after and before it.
fn outwards(middle: usize, n: usize) -> Vec<usize> {
    let away = 1..n;
    away.flat_map(|away| {
        let after = Some(middle + away).filter(|&place| place < n);
        [after, middle.checked_sub(away)]
    })
    .flatten()
    .collect()
}

/// World units that take the image's width at the typical distance of what training pictures show.
fn typical_width(run: &Run<Dash>) -> f32 {
    const ASKED: usize = 1_000;
    let means = to_host(run.scene.static_set.means.val());
    let stride = (means.len() / 3).div_ceil(ASKED).max(1);
    let cameras: BTreeMap<usize, _> = run
        .views()
        .map(|view| (view.camera_index, &view.camera))
        .collect();
    let mut widths: Vec<f32> = cameras
        .values()
        .flat_map(|camera| {
            let asked = means.chunks_exact(3).step_by(stride);
            asked.filter_map(|mean| {
                let point: [f64; 3] = std::array::from_fn(|axis| f64::from(mean[axis]));
                let (_, depth) = camera.project_inside(point)?;
                Some((depth * camera.width as f64 / camera.fx) as f32)
            })
        })
        .collect();
    widths.sort_by(f32::total_cmp);
    widths.get(widths.len() / 2).copied().unwrap_or(run.extent)
}

#[cfg(test)]
mod tests;
