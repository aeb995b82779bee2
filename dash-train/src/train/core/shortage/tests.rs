use std::path::PathBuf;

use super::*;
use crate::dataset::Layout;
use crate::ply::PointCloud;
use crate::train::{Preset, TrainConfig, Trainer};
use burn::tensor::Device;
use std::sync::Arc;

const SIDE: usize = 16;

/// A camera's place and where it looks.
type Stand = ([f64; 3], [f64; 3]);

fn camera((eye, target): Stand) -> Camera {
    let side = SIDE as f64;
    Camera::new(side, side, 0.5 * side, 0.5 * side, SIDE, SIDE).look_at(
        eye,
        target,
        [0.0, 1.0, 0.0],
    )
}

/// The pose rounded to six digits: its rotation is not quite orthonormal.
fn rounded(mut camera: Camera) -> Camera {
    let round = |v: f64| (v * 1e6).round() / 1e6;
    let position = camera.position().map(round);
    camera.rotation = camera.rotation.map(|row| row.map(round));
    for (row, t) in camera.rotation.iter().zip(&mut camera.translation) {
        *t = -(0..3).map(|i| row[i] * position[i]).sum::<f64>();
    }
    camera
}

fn dataset(train: &[Camera], test: &[Camera], points: &[[f32; 3]]) -> Dataset {
    let view = |camera: &Camera, index: usize, n: usize, partition| {
        // A checkerboard of the pixels' own: pictures of one place agree.
        let pixels = (0..SIDE * SIDE * 3).map(|i| (i * 37 % 251) as u8).collect();
        let time = index as f32 / (n.max(2) - 1) as f32;
        View {
            camera_index: index,
            partition,
            frame: index,
            ..View::from_rgb8(&format!("r_{index}"), camera.clone(), time, pixels)
        }
    };
    let n = train.len();
    let trained = train.iter().enumerate();
    let mut views: Vec<View> = trained
        .map(|(i, camera)| view(camera, i, n, Partition::Train))
        .collect();
    let held_out = test.iter().enumerate();
    views.extend(held_out.map(|(i, camera)| view(camera, i, n, Partition::Test)));
    Dataset {
        name: "made".into(),
        root: PathBuf::from("made"),
        layout: Layout::Blender,
        n_frames: n,
        n_cameras: n,
        stated_span: None,
        frame_rate: None,
        views,
        points: (!points.is_empty()).then(|| PointCloud {
            positions: points.to_vec(),
            colors: vec![[90; 3]; points.len()],
        }),
        background: None,
    }
}

fn stands(n: usize, stand: impl Fn(f64) -> Stand) -> Vec<Camera> {
    (0..n).map(|k| camera(stand(k as f64))).collect()
}

/// A camera at `eye` that turns by 0.03 from one view to the next.
fn turning(n: usize, eye: [f64; 3]) -> Vec<Camera> {
    stands(n, |k| {
        let (s, c) = (0.03 * k).sin_cos();
        (eye, [eye[0] + s, eye[1], eye[2] + c])
    })
}

fn around(n: usize, centre: [f64; 3], radius: f64) -> Vec<Camera> {
    stands(n, |k| {
        let (s, c) = (0.4 * k).sin_cos();
        (
            [centre[0] + radius * s, centre[1], centre[2] + radius * c],
            centre,
        )
    })
}

const AHEAD: [f32; 3] = [0.0, 0.0, 4.0];

#[test]
fn what_a_capture_lacks_is_named() {
    let origin = [0.0; 3];
    let away = [3.2, -1.1, 7.9];
    let fixed = |n, eye: [f64; 3]| stands(n, |_| (eye, [eye[0], eye[1], eye[2] + 1.0]));
    let rounded_turn: Vec<Camera> = turning(6, away).into_iter().map(rounded).collect();
    let two = around(2, [0.0, 0.0, 4.0], 4.0);
    let twice = [two.clone(), two.clone()].concat();
    let rig = around(5, [0.0, 0.0, 4.0], 4.0);
    let map = around(5, [690_000.0, 5_330_000.0, 500.0], 5.0);
    let tiny = around(5, [0.0, 0.0, 1e-3], 1e-4);
    let tests = |cameras: &[Camera]| cameras[..2].to_vec();
    let turned: Vec<Camera> = turning(2, [0.5, 0.0, 0.0]);
    let cases: Vec<(&str, Dataset, &[&str])> = vec![
        (
            "one view",
            dataset(&fixed(1, away), &[], &[]),
            &["one view to train on and no points"],
        ),
        (
            "one of two held out",
            dataset(&two[..1], &two[1..], &[]),
            &["one view", "(1 held out) and no"],
        ),
        (
            "one view with points",
            dataset(&fixed(1, origin), &[], &[AHEAD]),
            &["one view", "only the points"],
        ),
        (
            "fixed",
            dataset(&fixed(6, away), &[], &[]),
            &["no parallax", "a fixed camera", "distance 1"],
        ),
        (
            "fixed with points",
            dataset(&fixed(6, origin), &[], &[AHEAD]),
            &["no parallax", "only the points"],
        ),
        (
            "turning",
            dataset(&turning(6, away), &[], &[]),
            &["no parallax", "only turns"],
        ),
        (
            "turning, six digits",
            dataset(&rounded_turn, &[], &[]),
            &["no parallax", "only turns"],
        ),
        (
            "turning, far away",
            dataset(&turning(4, [90.0, 5.0, 40.0]), &[], &[]),
            &["only turns"],
        ),
        (
            "turning, at the origin",
            dataset(&turning(9, origin), &[], &[]),
            &["only turns"],
        ),
        ("two cameras", dataset(&two, &[], &[]), &["two places only"]),
        (
            "two cameras, two times",
            dataset(&twice, &[], &[]),
            &["4 training views", "two places only"],
        ),
        (
            "points behind",
            dataset(&rig, &[], &[[300.0, 0.0, 300.0], [400.0, 0.0, 500.0]]),
            &["none of the 2 points"],
        ),
        (
            "points behind all",
            dataset(&turned, &[], &[[0.0, 0.0, -5.0]]),
            &["only turns", "1 are behind all"],
        ),
        (
            "points beside",
            dataset(&rig, &[], &[[0.0, 500.0, 4.0]]),
            &["none of the 1 points"],
        ),
        (
            "tests trained on",
            dataset(&rig, &tests(&rig), &[AHEAD]),
            &["2 of the 2 held-out views"],
        ),
        ("rig", dataset(&rig, &[], &[AHEAD]), &[]),
        ("rig in map coordinates", dataset(&map, &[], &[]), &[]),
        ("tiny rig", dataset(&tiny, &[], &[]), &[]),
        (
            "other tests",
            dataset(&rig, &around(3, [0.0, 0.0, 4.0], 4.1), &[AHEAD]),
            &[],
        ),
    ];
    for (name, dataset, parts) in cases {
        let found = shortages(&dataset);
        let text: Vec<&str> = found
            .iter()
            .map(|shortage| shortage.text.as_str())
            .collect();
        let text = text.join("; ");
        assert_eq!(found.is_empty(), parts.is_empty(), "{name}: {text}");
        for part in parts {
            assert!(text.contains(part), "{name}: `{part}` in {text}");
        }
    }
}

/// A run at its first step.
fn begun(dataset: Dataset) -> Result<Trainer, Error> {
    let config = TrainConfig::preset(Preset::Quick);
    Trainer::new(config, Arc::new(dataset), &Device::flex())
}

#[test]
fn without_parallax_the_scene_is_about_as_large_as_one() {
    let away = [3.2, -1.1, 7.9];
    let rounded_turn: Vec<Camera> = turning(6, away).into_iter().map(rounded).collect();
    let far = [90.0, 5.0, 40.0];
    for (name, cameras) in [
        ("fixed", stands(6, |_| (away, [3.2, -1.1, 9.0]))),
        ("fixed, two views", stands(2, |_| (away, [3.2, -1.1, 9.0]))),
        ("turning", turning(6, away)),
        ("turning, six digits", rounded_turn),
        ("turning, far away", turning(5, far)),
        ("turning, at the origin", turning(5, [0.0; 3])),
    ] {
        let dataset = dataset(&cameras, &[], &[]);
        assert!(shortages(&dataset).iter().all(|s| !s.is_fatal), "{name}");
        let trainer = begun(dataset).unwrap_or_else(|e| panic!("{name}: {e}"));
        let (n_static, _) = trainer.scene().counts();
        assert!(n_static > 100, "{name}: {n_static} Gaussians");
        let extent = trainer.run().extent;
        assert!((0.1..10.0).contains(&extent), "{name}: extent {extent}");
        let near = trainer.scene().settings.near_plane;
        assert!((0.1..1.0).contains(&near), "{name}: near plane {near}");
    }
}

#[test]
fn without_any_gaussian_training_does_not_begin() {
    let rig = around(5, [0.0, 0.0, 4.0], 4.0);
    let black_and_white = |mut dataset: Dataset| {
        for (index, view) in dataset.views.iter_mut().enumerate() {
            let pixels = vec![255 * (index % 2) as u8; SIDE * SIDE * 3];
            let (name, time) = (view.name.clone(), view.time);
            *view = View {
                camera_index: index,
                ..View::from_rgb8(&name, view.camera.clone(), time, pixels)
            };
        }
        dataset
    };
    let apart = stands(2, |k| {
        ([900.0 * k, 0.0, 0.0], [900.0 * k, 0.0, 1.0 - 2.0 * k])
    });
    let fixed = stands(2, |_| ([1.0; 3], [1.0, 1.0, 2.0]));
    for (name, dataset) in [
        ("one view", dataset(&rig[..1], &[], &[])),
        (
            "pictures that disagree",
            black_and_white(dataset(&rig[..2], &[], &[])),
        ),
        (
            "a fixed camera's that disagree",
            black_and_white(dataset(&fixed, &[], &[])),
        ),
        ("views that share nothing", dataset(&apart, &[], &[])),
        (
            "one view, points behind",
            dataset(&rig[..1], &[], &[[0.0, 0.0, 90.0]]),
        ),
    ] {
        let error = begun(dataset)
            .err()
            .unwrap_or_else(|| panic!("{name} begins"));
        assert!(matches!(error, Error::TooLittle { .. }), "{name}: {error}");
        assert!(
            error.to_string().starts_with("made: expected"),
            "{name}: {error}"
        );
    }
}
