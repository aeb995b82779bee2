//! What cameras do to colours, and that it is found.

use std::sync::Arc;

use dash_kernels::splats::{N_COLUMNS, RED};

use super::*;
use crate::dataset::Dataset;
use crate::synth;
use crate::train::{Keep, Preset, TrainConfig, Trainer};

/// Gains of the cameras of [`dataset`], beside their mean.
const GAINS: [f32; 4] = [0.8, 0.9, 1.0, 0.9];

/// A clip of one frame whose cameras have exposures of their own.
fn dataset() -> Dataset {
    let mut dataset = synth::loaded(GAINS.len() + 1, 1, [48, 36]);
    let cameras: Vec<usize> = training_cameras(&dataset);
    for view in &mut dataset.views {
        let Some(place) = cameras.iter().position(|&c| c == view.camera_index) else {
            continue;
        };
        let rgb = view.rgb([0.0; 3]).expect("in memory");
        let exposed = rgb.iter().map(|v| (v * GAINS[place] * 255.0).round() as u8);
        let exposed = View::from_rgb8(
            &view.name,
            view.camera.clone(),
            view.time,
            exposed.collect(),
        );
        view.pixels = exposed.pixels;
    }
    dataset
}

fn training_cameras(dataset: &Dataset) -> Vec<usize> {
    let views = dataset.views_of(crate::dataset::Partition::Train);
    let mut cameras: Vec<usize> = views.map(|view| view.camera_index).collect();
    cameras.sort_unstable();
    cameras.dedup();
    cameras
}

/// Cameras that have an exposure.
fn n_cameras(exposure: &Exposure) -> usize {
    exposure.responses.as_ref().map_or(0, |r| r.rows.len())
}

/// The exposures of all cameras, row by row.
fn set(exposure: &mut Exposure, rows: &[[f32; RESPONSE]]) {
    let responses = exposure.responses.as_mut().expect("several cameras");
    let values = TensorData::new(rows.concat(), [rows.len(), RESPONSE]);
    responses.values = Tensor::from_data(values, &responses.values.device());
}

fn trainer(dataset: Dataset) -> Trainer {
    let mut config = TrainConfig::preset(Preset::Quick);
    config.keep(Keep::All);
    config.iterations = 400;
    config.initial_points = [500, 2_000];
    Trainer::new(config, Arc::new(dataset), &Device::flex()).expect("valid")
}

#[test]
fn colours_are_scaled_and_shifted_and_nothing_else() {
    let mut trainer = trainer(dataset());
    let run = &mut trainer.run;
    let mut exposure = Exposure::new(ExposureConfig { rate: 0.1 });
    Extension::<_>::init(&mut exposure, run);
    let dataset = run.dataset.clone();
    let index = run.train_views[0];
    let view = &dataset.views[index];
    let values = [0.1, -0.2, 0.3, 0.01, 0.02, -0.03];
    let rows = &exposure.responses.as_ref().expect("several cameras").rows;
    let mut all = vec![[0.0; RESPONSE]; rows.len()];
    all[rows[&view.camera_index]] = values;
    set(&mut exposure, &all);
    exposure.before_forward(run, view).expect("nothing fails");

    let device = run.device.clone();
    let rows: Vec<f32> = (0..3 * N_COLUMNS)
        .map(|k| (k * 37 % 101) as f32 / 101.0)
        .collect();
    let splats = Tensor::<2>::from_data(TensorData::new(rows.clone(), [3, N_COLUMNS]), &device);
    let out = exposure.splats(run, splats);
    let is_color = |column: usize| (RED..RED + CHANNELS).contains(&column);
    for (k, (&before, after)) in rows.iter().zip(to_host(out.clone())).enumerate() {
        let column = k % N_COLUMNS;
        let expected = match is_color(column) {
            true => before * (1.0 + values[column - RED]) + values[CHANNELS + column - RED],
            false => before,
        };
        assert!((after - expected).abs() < 1e-6, "{k}: {after} {expected}");
    }
    // The gradient of a weighted sum: of gains the weighted colours, of offsets the weights.
    let weights = Tensor::<2>::from_data(
        TensorData::new(
            (0..3 * N_COLUMNS).map(|k| k as f32).collect::<Vec<_>>(),
            [3, N_COLUMNS],
        ),
        &device,
    );
    let gradients = (out * weights).sum().backward();
    let (_, leaf) = exposure.present.last().expect("a camera of several");
    let gradient = to_host(leaf.grad(&gradients).expect("tracked"));
    for channel in 0..CHANNELS {
        let of = |row: usize| row * N_COLUMNS + RED + channel;
        let gain: f32 = (0..3).map(|row| rows[of(row)] * of(row) as f32).sum();
        let offset: f32 = (0..3).map(|row| of(row) as f32).sum();
        assert!((gradient[channel] - gain).abs() < 1e-3 * gain);
        assert!((gradient[CHANNELS + channel] - offset).abs() < 1e-3 * offset);
    }
}

#[test]
fn the_exposures_of_cameras_are_found_beside_their_mean() {
    let mut trainer = trainer(dataset());
    let mut exposure = Exposure::new(ExposureConfig { rate: 5e-3 });
    Extension::<_>::init(&mut exposure, &mut trainer.run);
    let at = trainer
        .hooks
        .extensions
        .iter()
        .position(|e| e.name() == "exposure");
    trainer.hooks.extensions[at.expect("of the preset")] = Box::new(exposure);
    while !trainer.is_finished() {
        trainer.step().expect("trains");
    }
    let found = &trainer.hooks.extensions[at.expect("there")];
    let found: &dyn std::any::Any = found.as_ref();
    let found: &Exposure = found.downcast_ref().expect("an exposure");
    // What becomes of a medium gray.
    let (gains, offsets) = (0..CHANNELS, CHANNELS..2 * CHANNELS);
    let sum = |r: &[f32], of: &std::ops::Range<usize>| r[of.clone()].iter().sum::<f32>();
    let responses = found.responses.as_ref().expect("several cameras");
    let gray: Vec<f32> = to_host(responses.values.clone())
        .chunks_exact(RESPONSE)
        .map(|r| (sum(r, &gains) + sum(r, &offsets) / 0.5) / 3.0)
        .collect();
    let mean = GAINS.iter().sum::<f32>() / GAINS.len() as f32;
    assert!(gray.iter().sum::<f32>().abs() < 1e-5, "{gray:?}");
    for (found, gain) in gray.iter().zip(GAINS) {
        let expected = gain / mean - 1.0;
        assert!(
            (found - expected).abs() < 0.04,
            "{gray:?}, expected {expected}"
        );
    }
}

#[test]
fn one_camera_is_left_as_it_is() {
    let mut dataset = synth::loaded(4, 2, [32, 24]);
    let first = dataset.views_of(crate::dataset::Partition::Train).next();
    let first = first.expect("a view").camera_index;
    dataset.views.retain(|view| view.camera_index == first);
    let mut trainer = trainer(dataset);
    let run = &mut trainer.run;
    let mut exposure = Exposure::new(ExposureConfig { rate: 0.1 });
    Extension::<_>::init(&mut exposure, run);
    let dataset = run.dataset.clone();
    let first = &dataset.views[0];
    exposure.before_forward(run, first).expect("nothing fails");
    assert!(exposure.present.is_empty());
}

#[test]
fn a_camera_whose_only_picture_is_all_there_is_of_a_time_is_left_as_it_is() {
    let of_views = |keep: fn(usize, usize) -> bool| {
        let mut dataset = synth::loaded(4, 4, [32, 24]);
        let cameras = training_cameras(&dataset);
        dataset.views.retain(|view| {
            let camera = cameras.iter().position(|&c| c == view.camera_index);
            camera.is_some_and(|camera| keep(camera, view.frame))
        });
        let mut trainer = trainer(dataset);
        let mut exposure = Exposure::new(ExposureConfig { rate: 0.1 });
        Extension::<_>::init(&mut exposure, &mut trainer.run);
        n_cameras(&exposure)
    };
    assert_eq!(of_views(|_, _| true), 3);
    assert_eq!(
        of_views(|_, frame| frame == 0),
        3,
        "nothing but cameras differs"
    );
    assert_eq!(
        of_views(|camera, frame| frame % 3 == camera),
        1,
        "the one with two"
    );
    assert_eq!(of_views(|camera, frame| frame == camera), 0);
}

#[test]
fn cameras_that_are_alike_lose_their_exposures() {
    // How many cameras keep an exposure, of so many steps and of offsets of so much up and down.
    let left = |steps: u64, offset: f32| {
        let mut trainer = trainer(dataset());
        let run = &mut trainer.run;
        let mut exposure = Exposure::new(ExposureConfig { rate: 0.1 });
        Extension::<_>::init(&mut exposure, run);
        let sign = |k: usize| if k.is_multiple_of(2) { 1.0 } else { -1.0 };
        let rows: Vec<_> = (0..GAINS.len())
            .map(|k| [sign(k) * offset; RESPONSE])
            .collect();
        set(&mut exposure, &rows);
        let responses = exposure.responses.as_mut().expect("several cameras");
        responses.moments.iter_mut().for_each(|m| m.steps = steps);
        run.step = 159;
        exposure.after_step(run).expect("nothing to read");
        assert_eq!(n_cameras(&exposure), GAINS.len());
        run.step = 160;
        exposure.after_step(run).expect("nothing to read");
        let n = n_cameras(&exposure);
        let mut again = Exposure::new(ExposureConfig { rate: 0.1 });
        Extension::<_>::init(&mut again, run);
        let saved = Extension::<crate::train::paper::Dash>::save(&exposure);
        again.restore(run, saved).expect("its own");
        assert_eq!(n_cameras(&again), n);
        n
    };
    assert_eq!(left(20, 0.002), 0);
    assert_eq!(left(19, 0.002), GAINS.len(), "not known yet");
    assert_eq!(left(20, 0.003), GAINS.len(), "0.0045 of a medium gray");
}
