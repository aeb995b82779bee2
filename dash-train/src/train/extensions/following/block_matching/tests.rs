use std::path::PathBuf;
use std::sync::Arc;

use burn::tensor::Device;
use dash_kernels::Camera;
use dash_model::SpaceBox;
use dash_model::decomposition::MotionStatistics;

use super::*;
use crate::dataset::{Dataset, Layout, View};
use crate::train::core::Extension;
use crate::train::extensions::following::Following;
use crate::train::{
    Preset, TrainConfig, Trainer, latest_checkpoint, load_checkpoint, save_checkpoint,
};

/// Points of a small body.
pub(super) const N: usize = 100;
/// Its way up to the last known frame, and from there to the new one.
pub(super) const WAY: Vec3 = Vec3::new(0.15, -0.3, 0.0);
pub(super) const SHIFT: Vec3 = Vec3::new(0.12, 0.25, 0.05);
const WIDTH: usize = 80;
const HEIGHT: usize = 60;
const FRAMES: usize = 5;
const CAMERAS: usize = 8;

/// The body at the last known frame.
pub(super) fn cloud() -> Vec<Vec3> {
    let along = |i: usize| (i as f32 - 4.5) * 0.04;
    (0..N)
        .map(|row| Vec3::new(along(row % 10), along(row / 10), 0.05 * (row % 3) as f32))
        .collect()
}

/// The colour of each of its points.
pub(super) fn color(row: usize) -> [f32; 3] {
    let (column, line) = ((row % 10) as f32, (row / 10) as f32);
    [0.2 + 0.08 * column, 0.9 - 0.08 * line, 0.5]
}

fn camera(k: usize) -> Camera {
    let turn = (k as f64 - 3.5) * 0.25;
    let eye = [4.0 * turn.sin(), 0.6 + 0.1 * k as f64, -4.0 * turn.cos()];
    let (cx, cy) = (WIDTH as f64 / 2.0, HEIGHT as f64 / 2.0);
    Camera::new(110.0, 110.0, cx, cy, WIDTH, HEIGHT).look_at(eye, [0.0; 3], [0.0, -1.0, 0.0])
}

/// The body, displaced, before a dark wall, or the wall alone.
fn picture(camera: &Camera, displaced: Vec3, hidden: bool) -> Vec<[f32; 3]> {
    let mut colors: Vec<[f32; 3]> = (0..WIDTH * HEIGHT)
        .map(|pixel| [0.1 + 0.05 * ((pixel % 7) as f32 / 6.0), 0.1, 0.12])
        .collect();
    for (row, place) in cloud().into_iter().enumerate().filter(|_| !hidden) {
        let place = (place + displaced).as_dvec3().to_array();
        let Some(([u, v], _)) = camera.project_inside(place) else {
            continue;
        };
        for y in v as usize..(v as usize + 2).min(HEIGHT) {
            for x in u as usize..(u as usize + 2).min(WIDTH) {
                colors[y * WIDTH + x] = color(row);
            }
        }
    }
    colors
}

/// A camera's pictures of the body, where it is and displaced.
pub(super) fn pair(k: usize, shift: Vec3, hidden: bool) -> Pair {
    let camera = camera(k);
    Pair {
        colors: [
            picture(&camera, Vec3::ZERO, false),
            picture(&camera, shift, hidden),
        ],
        cameras: [camera.clone(), camera],
    }
}

/// The body's displacement at each of five frames: it rests in the middle, goes down and is thrown back.
fn displaced(frame: usize) -> Vec3 {
    [-2.0 * WAY, -WAY, Vec3::ZERO, WAY, WAY + SHIFT][frame]
}

/// Frames of a rig, or of one camera after the other.
fn dataset(in_turns: bool) -> Dataset {
    let views = (0..CAMERAS * FRAMES).map(|i| {
        let (k, frame) = (i % CAMERAS, i / CAMERAS);
        let camera = camera(k);
        let pixels = picture(&camera, displaced(frame), false);
        let pixels = pixels.iter().flatten().map(|v| (v * 255.0).round() as u8);
        let place = if in_turns { i } else { frame * CAMERAS };
        let last = if in_turns {
            CAMERAS * FRAMES - 1
        } else {
            CAMERAS * (FRAMES - 1)
        };
        let time = place as f32 / last as f32;
        let mut view = View::from_rgb8("made", camera, time, pixels.collect());
        (view.camera_index, view.frame) = (k, if in_turns { i } else { frame });
        view
    });
    Dataset {
        name: "made".into(),
        root: PathBuf::new(),
        layout: Layout::Blender,
        n_frames: if in_turns { CAMERAS * FRAMES } else { FRAMES },
        n_cameras: CAMERAS,
        stated_span: None,
        views: views.collect(),
        points: None,
        background: None,
    }
}

/// How large a world unit appears in these pictures, in shares of the width.
const SCALE: f32 = 110.0 / 4.0 / WIDTH as f32;

/// A run whose coarse field knows the way to the fourth of five frames, and that the body goes on like that; a world
/// unit appears as large as `scale`.
fn trainer(dataset: Dataset, scale: f32) -> Trainer {
    let mut config = TrainConfig::preset(Preset::Quick);
    config.iterations = 400;
    config.initial_points[0] = 50;
    let mut trainer = Trainer::new(config, Arc::new(dataset), &Device::flex()).expect("valid");
    let points: Vec<[f32; 3]> = cloud().iter().map(Vec3::to_array).collect();
    let colors: Vec<[f32; 3]> = (0..N).map(color).collect();
    let mut rows = GaussianRows::from_points(&points, &colors, 0, 0.05);
    rows.opacity_logits.fill(dash_model::logit(0.9));
    trainer.start_from(&rows);
    // As far as the cameras are away.
    trainer.run.region = SpaceBox {
        min: [-4.0; 3],
        max: [4.0; 3],
        clamp: true,
    };
    trainer.run.start_motion().expect("valid");
    trainer.run.method.statistics = MotionStatistics::new(N);
    trainer.run.method.statistics.add(&[scale; N], &[1.0; N]);
    let ways = [
        ([0.5, 0.75], WAY),
        ([0.75, 1.0], 2.0 * WAY),
        ([0.5, 0.25], -WAY),
        ([0.25, 0.0], -2.0 * WAY),
    ];
    // What is taught of one time moves the others a little.
    for (times, place) in ways.into_iter().cycle().take(4 * ways.len()) {
        let moved: Vec<(usize, Vec3)> = (0..N).map(|row| (row, place)).collect();
        let coefficients = coefficients(&trainer);
        teach(&mut trainer.run, &moved, coefficients, times).expect("valid");
    }
    trainer
}

fn coefficients(trainer: &Trainer) -> Tensor<2> {
    let coefficients = trainer.run.coefficients().expect("valid");
    coefficients.expect("it moves").detach()
}

/// The mean displacement of the body at a time.
fn mean_at(trainer: &Trainer, time: f32) -> Vec3 {
    let basis = trainer.run.method.basis;
    let moved = basis.displacement(coefficients(trainer), time);
    let moved = to_host(moved.expect("valid"));
    moved.chunks_exact(3).map(Vec3::from_slice).sum::<Vec3>() / N as f32
}

/// Passes all steps of following without training in them.
fn follow(trainer: &mut Trainer) {
    let stages = trainer.run.stages();
    let following = trainer.hooks.get_mut::<Following>().expect("on");
    for step in stages.warmup..stages.handover {
        trainer.run.step = step;
        following.before_step(&mut trainer.run).expect("pictures");
    }
}

#[test]
fn the_field_is_taught_where_a_body_is_that_did_not_go_on_as_it_went() {
    let mut trainer = trainer(dataset(false), SCALE);
    let before = [0.25, 0.75, 1.0].map(|time| mean_at(&trainer, time));
    assert!(before[1].distance(WAY) < 0.05, "{before:?}");
    assert!(before[2].distance(WAY + SHIFT) > 0.4, "{before:?}");
    follow(&mut trainer);
    let after = [0.25, 0.75, 1.0].map(|time| mean_at(&trainer, time));
    assert!(after[2].distance(WAY + SHIFT) < 0.1, "{after:?}");
    // Spans on the other side of the middle are none of its business.
    assert!(after[0].distance(before[0]) < 0.05, "{before:?} {after:?}");
}

#[test]
fn where_a_body_was_found_is_remembered_until_following_ends() {
    let mut trainer = trainer(dataset(false), SCALE);
    let cost = |trainer: &Trainer| {
        let run = &trainer.run;
        let field = run.method.motion.as_ref().expect("it moves");
        let cost = remembered(trainer).cost(field, run.method.basis, run.step, &run.device);
        cost.expect("valid").map_or(0.0, |cost| to_host(cost)[0])
    };
    assert_eq!(cost(&trainer), 0.0, "nothing was found yet");
    follow(&mut trainer);
    assert!(cost(&trainer) < 1e-3, "it is where it was found");
    let elsewhere: Vec<(usize, Vec3)> = (0..N).map(|row| (row, 2.0 * WAY)).collect();
    let coefficients = coefficients(&trainer);
    teach(&mut trainer.run, &elsewhere, coefficients, [0.75, 1.0]).expect("valid");
    assert!(cost(&trainer) > 0.5, "it has been forgotten");

    let folder = tempfile::tempdir().expect("a folder");
    save_checkpoint(&trainer, folder.path(), 1.0).expect("written");
    let path = latest_checkpoint(folder.path()).expect("read");
    let path = path.expect("just written");
    let dataset = trainer.run.dataset.clone();
    let (resumed, _) = load_checkpoint(&path, dataset, &Device::flex()).expect("read");
    assert_eq!(remembered(&resumed), remembered(&trainer));

    trainer.run.step = trainer.run.stages().handover;
    let following = trainer.hooks.get_mut::<Following>().expect("on");
    following.before_step(&mut trainer.run).expect("hands over");
    assert_eq!(remembered(&trainer), &Memory::default());
}

/// What the run remembers.
fn remembered(trainer: &Trainer) -> &Memory {
    &trainer.hooks.get::<Following>().expect("on").memory
}

#[test]
fn slow_bodies_and_monocular_captures_teach_nothing() {
    for (in_turns, scale) in [(false, 0.03 * SCALE), (true, SCALE)] {
        let mut trainer = trainer(dataset(in_turns), scale);
        let before = to_host(coefficients(&trainer));
        follow(&mut trainer);
        assert_eq!(
            before,
            to_host(coefficients(&trainer)),
            "{in_turns} {scale}"
        );
    }
}

#[test]
fn others_keep_their_trajectories() {
    let mut trainer = trainer(dataset(false), SCALE);
    let before = to_host(coefficients(&trainer));
    let top = |row: &usize| *row >= N / 2;
    let to = Vec3::new(0.0, 0.5, 0.2);
    let moved: Vec<(usize, Vec3)> = (0..N).filter(top).map(|row| (row, to)).collect();
    let from = coefficients(&trainer);
    let off = |trainer: &Trainer| {
        let basis = trainer.run.method.basis;
        let now = basis.displacement(coefficients(trainer), 1.0);
        let now = to_host(now.expect("valid"));
        let off = |row: usize| Vec3::from_slice(&now[3 * row..]).distance(to);
        // Next to those that stay the field has to give in.
        (3 * N / 4..N).map(off).sum::<f32>() / (N / 4) as f32
    };
    let far = off(&trainer);
    teach(&mut trainer.run, &moved, from, [0.75, 1.0]).expect("valid");
    assert!(off(&trainer) < 0.3 * far, "{} {far}", off(&trainer));
    let after = to_host(coefficients(&trainer));
    let width = before.len() / N;
    let changed = |rows: std::ops::Range<usize>| {
        let pairs = before.iter().zip(&after).skip(width * rows.start);
        let squares = pairs.take(width * rows.len()).map(|(a, b)| (a - b).powi(2));
        (squares.sum::<f32>() / rows.len() as f32).sqrt()
    };
    let (kept, taught) = (changed(0..N / 4), changed(3 * N / 4..N));
    assert!(kept < 0.4 * taught, "{kept} {taught}");
}

#[test]
fn a_trajectory_is_led_to_a_place_by_its_last_spans() {
    let basis = TrajectoryBasis::Polyline {
        spans: 6,
        anchor: 0.5,
    };
    let given: Vec<f32> = (0..18).map(|i| (i as f32 * 0.7).sin()).collect();
    let to = Vec3::new(1.0, -2.0, 0.5);
    // (times, spans that may change): the last by itself where it has begun, else the one before it too.
    for ([known, time], free) in [
        ([0.8, 1.0], vec![5]),
        ([0.8, 0.95], vec![5]),
        ([0.7, 0.85], vec![4, 5]),
        ([0.2, 0.0], vec![0]),
        ([0.4, 0.3], vec![1, 2]),
    ] {
        let mut led = given.clone();
        lead_to(basis, &mut led, to, [known, time]);
        let weights = basis.at(time);
        let place: Vec3 = weights
            .iter()
            .zip(led.chunks_exact(3))
            .map(|(weight, part)| *weight * Vec3::from_slice(part))
            .sum();
        assert!(place.distance(to) < 1e-5, "{time}: {place}");
        for k in 0..6 {
            let is_same = led[3 * k..3 * k + 3] == given[3 * k..3 * k + 3];
            assert_eq!(is_same, !free.contains(&k), "{time}: span {k}");
        }
    }
    let mut led = given.clone();
    lead_to(basis, &mut led, to, [0.4, 0.5]);
    assert_eq!(led, given, "nothing is displaced at the anchor");
}
