//! Appearance: Gaussians that stay where they are and change colour, such as those of a screen, a lamp's light or a shadow, become
//! dynamic, too. The field then has a head for opacities and colours.
//!
//! Where a Gaussian changes colour, all cameras that see it agree on that at each time. Where something passes before it, some cameras
//! see it still, and others not; where its motion is not followed well, each misses something else. So the change is what nearly all
//! cameras agree on, and what counts is how far it goes over the clip.

use std::collections::BTreeMap;

use burn::tensor::{Tensor, TensorData};
use dash_kernels::rows::join_rows;
use dash_kernels::splats::{BLUE, GREEN, N_COLUMNS, RED};
use rayon::prelude::*;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::Error;
use crate::dataset::View;
use crate::train::core::visibility::gradient_of;
use crate::train::core::{Extension, Ranges, Run, Section, to_host};
use crate::train::paper::Dash;

/// Least share of all Gaussians, with a backdrop's, that must change colour. Of fewer no picture gets better, and the head costs.
const MIN_SHARE: f32 = 0.005;
/// Times of the clip that are looked at.
const TIMES: usize = 12;
/// Cameras that are looked at, the same ones at each time.
const CAMERAS: usize = 6;
/// Fewest cameras that must show a Gaussian at a time for that to count.
const MIN_CAMERAS: usize = 2;
/// Of so many cameras one may disagree.
const DISSENT: usize = 6;
/// A Gaussian that moves must change by so many times as much as one that rests: where it is off its way, it misses colours, too.
const MOVING: f32 = 2.0;
/// Least of a Gaussian that a picture must show to tell its colour, pixels.
const LEAST_SHOWN: f32 = 0.5;
/// Two numbers of a colour are compared: brightness, and red against blue.
const CHANNELS: usize = 2;

/// `[extensions.appearance]`
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct AppearanceConfig {
    /// Least change of colour over the clip (1: from black to white) that makes a resting Gaussian dynamic, in captures of
    /// synchronised cameras. A moving one must change by twice as much. Source: ours.
    pub change: f32,
}

impl Section for AppearanceConfig {
    fn check(&self, ranges: &mut Ranges) {
        ranges.positive("change", self.change);
    }
}

/// See [`AppearanceConfig`].
pub struct Appearance(AppearanceConfig);

impl Appearance {
    /// From its section.
    pub fn new(config: AppearanceConfig) -> Self {
        Self(config)
    }
}

impl Extension<Dash> for Appearance {
    fn name(&self) -> &'static str {
        "appearance"
    }

    fn init(&mut self, run: &mut Run<Dash>) {
        let change = self.0.change;
        // One camera at a time does not tell a change of colour from an object that passes before it.
        if run.is_synchronized() {
            run.method.find_changing =
                Some(Box::new(move |run, moving| changing(run, moving, change)));
        }
    }
}

/// Which Gaussians change colour by so much, before the decomposition; none where hardly any does. Those that rest become dynamic. Of
/// flicker, scene flow takes some for motion, so those that move tell, too, whether the field needs the head.
fn changing(run: &Run<Dash>, moving: &[bool], least: f32) -> Result<Vec<bool>, Error> {
    let mut cameras: Vec<Vec<Vec<Misses>>> = Vec::new();
    for views in looks(run) {
        let of_times = views.into_iter().map(|view| match view {
            Some(view) => misses(run, view),
            None => Ok(Vec::new()),
        });
        cameras.push(of_times.collect::<Result<_, Error>>()?);
    }
    let changes = |row: usize| {
        let of_camera = |times: &Vec<Vec<Misses>>| {
            let at = |of_time: &Vec<Misses>| of_time.get(row).copied().flatten();
            times.iter().map(at).collect()
        };
        let of_cameras: Vec<Vec<Misses>> = cameras.iter().map(of_camera).collect();
        let least = if moving[row] { MOVING * least } else { least };
        change(&of_cameras) >= least
    };
    let found: Vec<bool> = (0..moving.len()).into_par_iter().map(changes).collect();
    let backdrop = run.backdrop.as_ref().map_or(0, |backdrop| backdrop.len());
    Ok(enough(found, moving, moving.len() + backdrop))
}

/// Those found, where they are enough of all Gaussians; and of them those that rest, where these are enough. Without this, a few at an
/// object's border would become dynamic in each scene.
fn enough(mut found: Vec<bool>, moving: &[bool], all: usize) -> Vec<bool> {
    let least = MIN_SHARE * all as f32;
    let rests = |row: usize| !moving[row];
    let n_found = found.iter().filter(|found| **found).count();
    let n_resting = (0..found.len())
        .filter(|&row| found[row] && rests(row))
        .count();
    for (row, found) in found.iter_mut().enumerate() {
        *found &= n_found as f32 >= least && (!rests(row) || n_resting as f32 >= least);
    }
    found
}

/// By how much a picture misses what a Gaussian shows in it, mean over its pixels; `None` where it hardly shows it.
type Misses = Option<[f32; CHANNELS]>;

/// Views of some cameras, each at some times of the clip.
fn looks(run: &Run<Dash>) -> Vec<Vec<Option<&View>>> {
    let mut of_camera: BTreeMap<usize, BTreeMap<u32, &View>> = BTreeMap::new();
    for view in run.views() {
        let of_time = of_camera.entry(view.camera_index).or_default();
        of_time.entry(view.time.to_bits()).or_insert(view);
    }
    let (times, cameras) = (run.times.all(), of_camera.into_values());
    let cameras: Vec<BTreeMap<u32, &View>> = cameras.collect();
    let times: Vec<u32> = spread(times, TIMES).map(|time| time.to_bits()).collect();
    let looks = spread(&cameras, CAMERAS).map(|camera| {
        let views = times.iter().map(|time| camera.get(time).copied());
        views.collect()
    });
    looks.collect()
}

/// At most so many of some things, evenly apart.
fn spread<T>(all: &[T], most: usize) -> impl Iterator<Item = &T> {
    let n = all.len().min(most);
    (0..n).map(move |k| &all[(2 * k + 1) * all.len() / (2 * n)])
}

/// What a view misses of each Gaussian.
fn misses(run: &Run<Dash>, view: &View) -> Result<Vec<Misses>, Error> {
    let (scene, camera) = (&run.scene, &view.camera);
    let splats = match run.coefficients()? {
        None => scene.static_splats(camera)?,
        Some(coefficients) => {
            let displacement = run.method.basis.displacement(coefficients, view.time)?;
            scene.static_splats_at(scene.static_set.means.val() + displacement, camera)?
        }
    };
    let mut splats = splats.inner();
    let n = splats.dims()[0];
    if let Some(backdrop) = &run.backdrop {
        splats = join_rows(splats, backdrop.splats(camera)?)?;
    }
    let shape = [camera.height, camera.width, 1];
    let (truth, counted) = view.rgb_and_counted(scene.settings.background)?;
    let counted = counted.unwrap_or_else(|| vec![1.0; camera.width * camera.height]);
    // The red of a splat enters a pixel with its weight: what is multiplied with red is summed with the weights of blending, and so
    // with blue and green.
    let sums = gradient_of(scene, splats, camera, |image| {
        let drawn = to_host(image.clone().narrow(2, 0, 3).inner());
        let pixels = drawn
            .chunks_exact(3)
            .zip(truth.chunks_exact(3))
            .zip(&counted);
        let of_pixel = |((drawn, truth), &counts): ((&[f32], &[f32]), &f32)| {
            let miss = |k: usize| counts * (truth[k] - drawn[k]);
            let [red, green, blue] = [0, 1, 2].map(miss);
            ((red + green + blue) / 3.0, (red - blue) / 2.0)
        };
        let (brightness, tint): (Vec<f32>, Vec<f32>) = pixels.map(of_pixel).unzip();
        let times = |channel: usize, values: Vec<f32>| {
            let values = Tensor::<3>::from_data(TensorData::new(values, shape), &run.device);
            (image.clone().narrow(2, channel, 1) * values).sum()
        };
        times(0, brightness) + times(1, counted.clone()) + times(2, tint)
    })?;
    let of_row = |row: &[f32]| {
        let shown = row[GREEN];
        (shown >= LEAST_SHOWN).then(|| [row[RED] / shown, row[BLUE] / shown])
    };
    Ok(sums.chunks_exact(N_COLUMNS).take(n).map(of_row).collect())
}

/// How much a Gaussian's colour changes over the clip, given what each camera misses of it at each time, as nearly all cameras agree.
/// What a camera always misses is its own exposure.
fn change(of_cameras: &[Vec<Misses>]) -> f32 {
    let of_channel = |channel: usize| {
        let from_its_mean = |times: &Vec<Misses>| {
            let values = times.iter().map(|miss| miss.map(|miss| miss[channel]));
            let values: Vec<Option<f32>> = values.collect();
            let seen = || values.iter().flatten();
            let mean = seen().sum::<f32>() / seen().count().max(1) as f32;
            values.iter().map(|value| value.map(|v| v - mean)).collect()
        };
        let cameras: Vec<Vec<Option<f32>>> = of_cameras.iter().map(from_its_mean).collect();
        let n_times = cameras.first().map_or(0, Vec::len);
        let at_time = |time: usize| {
            let mut seen: Vec<f32> = cameras.iter().filter_map(|times| times[time]).collect();
            seen.sort_by(f32::total_cmp);
            let (n, others) = (seen.len(), seen.len() / DISSENT);
            (n >= MIN_CAMERAS).then(|| [seen[others], seen[n - 1 - others]])
        };
        let agreed: Vec<[f32; 2]> = (0..n_times).filter_map(at_time).collect();
        let at_least = agreed.iter().map(|[low, _]| *low).reduce(f32::max);
        let at_most = agreed.iter().map(|[_, high]| *high).reduce(f32::min);
        at_least.zip(at_most).map_or(0.0, |(high, low)| high - low)
    };
    (0..CHANNELS).map(of_channel).fold(0.0, f32::max)
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use burn::tensor::Device;

    use super::*;
    use crate::dataset::Dataset;
    use crate::synth;
    use crate::train::{Keep, Preset, TrainConfig, Trainer};

    /// A camera that misses so much brightness at each time.
    fn camera(brightness: [f32; 3]) -> Vec<Misses> {
        brightness.map(|value| Some([value, 0.0])).to_vec()
    }

    #[test]
    fn a_colour_changes_where_the_cameras_agree_on_it() {
        let close = |found: f32, expected: f32| assert!((found - expected).abs() < 1e-6, "{found}");
        // Each camera has an exposure of its own.
        let lit = [[0.1, 0.1, 0.4], [-0.2, -0.2, 0.1], [0.0, 0.0, 0.3]].map(camera);
        close(change(&lit), 0.3);
        let tints = lit.map(|times| times.iter().map(|m| m.map(|[b, _]| [0.0, -b])).collect());
        close(change(&tints), 0.3);
        // Something passes, and hides the Gaussian from one camera after the other.
        let passed = [[0.6, 0.0, 0.0], [0.0, 0.6, 0.0], [0.0, 0.0, 0.6]].map(camera);
        close(change(&passed), 0.0);
        // Where its motion is not followed, each camera misses something else.
        let off = [[0.1, 0.4, 0.0], [0.1, 0.1, 0.0], [0.1, 0.2, 0.0]].map(camera);
        close(change(&off), 0.1);
        // Of six cameras one may disagree.
        let six = [[0.0, 0.0, 0.3]; 5].into_iter().chain([[0.3, 0.0, 0.0]]);
        let six: Vec<Vec<Misses>> = six.map(camera).collect();
        close(change(&six), 0.3);
        // What one camera alone shows, at all or at a time, does not count.
        close(change(&[camera([0.0, 0.5, 0.0])]), 0.0);
        let mut hidden = [[0.0, 0.0, 0.9], [0.0, 0.0, 0.0]].map(camera);
        hidden[1][2] = None;
        close(change(&hidden), 0.0);
        close(change(&[vec![None; 3], vec![None; 3]]), 0.0);
        close(change(&[]), 0.0);
    }

    #[test]
    fn a_few_that_change_do_not_count() {
        let moving = [vec![true; 50], vec![false; 950]].concat();
        let with = |rows: std::ops::Range<usize>| {
            let found = (0..1_000).map(|row| rows.contains(&row)).collect();
            enough(found, &moving, 1_000)
                .into_iter()
                .filter(|f| *f)
                .count()
        };
        assert_eq!(with(0..4), 0);
        assert_eq!(with(0..5), 5, "flicker that passes for motion");
        assert_eq!(with(46..52), 4, "two that rest stay");
        assert_eq!(with(46..55), 9);
        assert_eq!(with(50..54), 0);
    }

    /// Half the side of the spot that changes, pixels.
    const HALF: usize = 3;

    /// The pixels of a view around a point, as places of their red.
    fn spot(view: &View, point: [f64; 3]) -> Vec<usize> {
        let Some(([u, v], _)) = view.camera.project_inside(point) else {
            return Vec::new();
        };
        let around = |at: f64, size: usize| {
            (at as usize).saturating_sub(HALF)..(at as usize + HALF + 1).min(size)
        };
        let columns = around(u, view.camera.width);
        around(v, view.camera.height)
            .flat_map(|row| {
                let width = view.camera.width;
                columns
                    .clone()
                    .map(move |column| 3 * (row * width + column))
            })
            .collect()
    }

    /// A clip in which nothing moves, and a spot is red at even frames and blue at odd ones.
    fn flickering() -> (Dataset, [f64; 3]) {
        let mut dataset = synth::loaded(6, 8, [48, 36]);
        let first: Vec<View> = dataset
            .views
            .iter()
            .filter(|v| v.frame == 0)
            .cloned()
            .collect();
        let config = TrainConfig::preset(Preset::Quick);
        let trainer = Trainer::new(config, Arc::new(dataset.clone()), &Device::flex());
        let region = trainer.expect("valid").run.region;
        let middle = |axis: usize| f64::from(0.5 * (region.min[axis] + region.max[axis]));
        let point = std::array::from_fn(middle);
        for view in &mut dataset.views {
            let still = first.iter().find(|v| v.camera_index == view.camera_index);
            let rgb = still
                .expect("at every time")
                .rgb([0.0; 3])
                .expect("in memory");
            let mut bytes: Vec<u8> = rgb.iter().map(|v| (v * 255.0).round() as u8).collect();
            let color = match view.frame.is_multiple_of(2) {
                true => [230, 30, 30],
                false => [30, 30, 230],
            };
            for place in spot(view, point) {
                bytes[place..place + 3].copy_from_slice(&color);
            }
            let painted = View::from_rgb8(&view.name, view.camera.clone(), view.time, bytes);
            view.pixels = painted.pixels;
        }
        (dataset, point)
    }

    /// A run on it, and the mean absolute error of the spot in its training views.
    fn trained(dataset: &Dataset, point: [f64; 3], set: &str) -> (Trainer, f64) {
        let mut config = TrainConfig::preset(Preset::Quick);
        config.keep(Keep::All);
        config.iterations = 400;
        config.initial_points = [500, 2_000];
        config.set(set).expect("a known key");
        let mut trainer =
            Trainer::new(config, Arc::new(dataset.clone()), &Device::flex()).expect("valid");
        while !trainer.is_finished() {
            trainer.step().expect("a step");
        }
        let (mut sum, mut n) = (0.0, 0);
        for view in trainer.run.views() {
            let drawn = trainer
                .scene()
                .render(&view.camera, view.time)
                .expect("drawn");
            let (drawn, truth) = (to_host(drawn.rgb()), view.rgb([0.0; 3]).expect("in memory"));
            for value in spot(view, point)
                .into_iter()
                .flat_map(|place| place..place + 3)
            {
                sum += f64::from((drawn[value] - truth[value]).abs());
                n += 1;
            }
        }
        (trainer, sum / f64::from(n))
    }

    #[test]
    fn what_flickers_is_dynamic_and_its_colours_are_learned() {
        let (dataset, point) = flickering();
        let (with, error) = trained(&dataset, point, "extensions.appearance.change=0.1");
        let dynamic = with.scene().dynamic.as_ref().expect("what flickers");
        assert!(dynamic.field.config().heads.appearance);
        let (_, without) = trained(&dataset, point, "extensions.appearance=none");
        assert!(error < 0.5 * without, "{error} with, {without} without");
    }
}
