use std::path::PathBuf;
use std::sync::Arc;

use burn::tensor::Device;
use dash_kernels::Camera;
use dash_model::SpaceBox;

use super::*;
use crate::dataset::{Dataset, Layout, View};
use crate::train::core::ViewSums;
use crate::train::{Preset, TrainConfig, Trainer};

/// Points of a small body.
pub(in super::super) const N: usize = 100;
/// Its way up to the last known frame, and from there to the new one.
pub(super) const WAY: Vec3 = Vec3::new(0.15, -0.3, 0.0);
pub(super) const SHIFT: Vec3 = Vec3::new(0.12, 0.25, 0.05);
const WIDTH: usize = 80;
const HEIGHT: usize = 60;
pub(in super::super) const FRAMES: usize = 5;
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
pub(in super::super) fn displaced(frame: usize) -> Vec3 {
    [-2.0 * WAY, -WAY, Vec3::ZERO, WAY, WAY + SHIFT][frame]
}

/// Frames of a rig; the body goes so many times as far as [`displaced`] says.
fn dataset(speed: f32) -> Dataset {
    let views = (0..CAMERAS * FRAMES).map(|i| {
        let (k, frame) = (i % CAMERAS, i / CAMERAS);
        let camera = camera(k);
        let pixels = picture(&camera, speed * displaced(frame), false);
        let pixels = pixels.iter().flatten().map(|v| (v * 255.0).round() as u8);
        let time = frame as f32 / (FRAMES - 1) as f32;
        let mut view = View::from_rgb8("made", camera, time, pixels.collect());
        (view.camera_index, view.frame) = (k, frame);
        view
    });
    Dataset {
        name: "made".into(),
        root: PathBuf::new(),
        layout: Layout::Blender,
        n_frames: FRAMES,
        n_cameras: CAMERAS,
        stated_span: None,
        frame_rate: None,
        views: views.collect(),
        points: None,
        background: None,
    }
}

/// How large a world unit appears in these pictures, in shares of the width.
pub(in super::super) const SCALE: f32 = 110.0 / 4.0 / WIDTH as f32;

/// A run of the body, at rest so far; a world unit appears as large as `scale`.
pub(in super::super) fn trainer(scale: f32, speed: f32) -> Trainer {
    let mut config = TrainConfig::preset(Preset::Quick);
    config.iterations = 400;
    config.sh_degree = 0;
    config.initial_points[0] = 50;
    let mut trainer =
        Trainer::new(config, Arc::new(dataset(speed)), &Device::flex()).expect("valid");
    let points: Vec<[f32; 3]> = cloud().iter().map(Vec3::to_array).collect();
    let colors: Vec<[f32; 3]> = (0..N).map(color).collect();
    let mut rows = GaussianRows::from_points(&points, &colors, 0, 0.05);
    rows.opacity_logits.fill(dash_model::logit(0.9));
    rows.log_scales.fill([0.02f32.ln(); 3]);
    trainer.start_from(&rows);
    // As far as the cameras are away.
    trainer.run.region = SpaceBox {
        min: [-4.0; 3],
        max: [4.0; 3],
        clamp: true,
    };
    trainer.run.start_motion().expect("valid");
    let device = trainer.run.device.clone();
    trainer.run.method.scales = ViewSums::from_totals(&[scale; N], &[1.0; N], &device);
    trainer
}

/// The body has gone from the middle to the fourth of five frames, and is expected to go on like that.
fn ahead() -> Ahead {
    let at = |displaced: Vec3| cloud().into_iter().map(|place| place + displaced).collect();
    Ahead {
        time: 1.0,
        known: vec![0.75, 0.5],
        before: vec![at(WAY), at(Vec3::ZERO)],
        expected: at(2.0 * WAY),
        reach: vec![0.0; N],
    }
}

#[test]
fn a_body_that_did_not_go_on_as_it_went_is_found() {
    let found = find(&trainer(SCALE, 1.0).run, &ahead()).expect("pictures");
    let mut rows: Vec<usize> = found.iter().map(|&(row, _)| row).collect();
    rows.sort_unstable();
    assert_eq!(rows, (0..N).collect::<Vec<_>>());
    let mean = found.iter().map(|&(_, shift)| shift).sum::<Vec3>() / N as f32;
    assert!(mean.distance(SHIFT) < 0.1, "{mean}");
}

#[test]
fn slow_bodies_are_not_searched() {
    let slow = trainer(0.03 * SCALE, 1.0);
    assert_eq!(find(&slow.run, &ahead()).expect("pictures"), []);
}

#[test]
fn at_the_first_new_frame_a_body_is_searched_as_far_as_is_said() {
    // From the middle to the fourth frame.
    let mut first = ahead();
    (first.time, first.known) = (0.75, vec![0.5]);
    first.before = vec![cloud()];
    first.expected = cloud();
    let run = &trainer(SCALE, 1.0).run;
    assert_eq!(find(run, &first).expect("pictures"), []);
    first.reach = vec![0.3; N];
    let found = find(run, &first).expect("pictures");
    let mean = found.iter().map(|&(_, shift)| shift).sum::<Vec3>() / N as f32;
    assert!(found.len() == N && mean.distance(WAY) < 0.1, "{mean}");
}
