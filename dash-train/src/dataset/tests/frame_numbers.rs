//! Which frame an image shows, by the numbers in names and by times.

use dash_kernels::Camera;
use serde_json::json;

use super::super::{Dataset, Layout, LoadOptions, load_decodable};
use super::blender::{matrix, write_single};
use super::n3dv::rows;
use crate::test_kit::{Fixture, H, W, assert_cameras_equal, camera, npy_f64, write_model};

/// Two cameras with these images.
fn rig(names: [&[&str]; 2]) -> Fixture {
    let fixture = Fixture::new();
    fixture.write("poses_bounds.npy", npy_f64(&rows(2)));
    for (camera, names) in names.into_iter().enumerate() {
        for name in names {
            fixture.image(&format!("cam0{camera}/{name}.png"), W, H, [0; 3]);
        }
    }
    fixture
}

fn shown(dataset: &Dataset) -> Vec<(&str, usize, f32)> {
    let views = dataset.views.iter();
    views
        .map(|view| (view.name.as_str(), view.frame, view.time))
        .collect()
}

#[test]
fn times_are_as_far_apart_as_the_numbers_of_frames() {
    let dataset = rig([&["0000", "0004", "0005"]; 2]).load().expect("loads");
    let times: Vec<(usize, f32)> = dataset.views.iter().map(|v| (v.frame, v.time)).collect();
    let once = [(0, 0.0), (1, 0.8), (2, 1.0)];
    assert_eq!(times, [once, once].concat());
    // Names without numbers, or with some that don't rise, are evenly spaced.
    for names in [["a", "b", "c"], ["a7", "b3", "c4"], ["a7", "b", "c9"]] {
        let dataset = rig([&names; 2]).load().expect("loads");
        let times: Vec<f32> = dataset.views.iter().map(|v| v.time).collect();
        assert_eq!(times, [0.0, 0.5, 1.0, 0.0, 0.5, 1.0], "{names:?}");
    }
}

#[test]
fn frames_that_a_camera_lacks_are_named_or_left_out() {
    let fixture = rig([&["0", "1", "2", "3"], &["0", "1", "3"]]);
    fixture.refuses(&["cam01", "4 frames", "found 3", "--skip-broken"]);
    let skipping = LoadOptions {
        skip_broken: true,
        ..LoadOptions::default()
    };
    let dataset = fixture.load_with(&skipping).expect("seven are left");
    let third = 1.0 / 3.0;
    let expected = [
        ("cam00/0", 0, 0.0),
        ("cam00/1", 1, third),
        ("cam00/2", 2, 2.0 * third),
        ("cam00/3", 3, 1.0),
        ("cam01/0", 0, 0.0),
        ("cam01/1", 1, third),
        ("cam01/3", 3, 1.0),
    ];
    assert_eq!((shown(&dataset), dataset.n_frames), (expected.into(), 4));
    // Those who look at everything are told.
    let (dataset, broken) = load_decodable(fixture.root(), &skipping).expect("loads");
    assert_eq!((dataset.views.len(), broken.len()), (7, 1));
    assert!(broken[0].to_string().contains("cam01"), "{}", broken[0]);

    // Each camera lacks another one.
    let fixture = rig([&["0", "1", "2", "4"], &["0", "1", "3", "4"]]);
    fixture.refuses(&["cam01", "2 (frame 2)", "3 (frame 3)", "--skip-broken"]);
    let dataset = fixture.load_with(&skipping).expect("eight are left");
    assert_eq!((dataset.views.len(), dataset.n_frames), (8, 5));
    // Nothing in common: which frames are of one time is not known.
    let fixture = rig([&["0", "1", "2"], &["7", "8", "9"]]);
    assert!(fixture.load_with(&skipping).is_err());
}

#[test]
fn frames_are_numbered_by_the_digits_that_differ_within_a_camera() {
    for [first, second] in [
        [
            ["0_cam00", "1_cam00", "9_cam00"],
            ["0_cam01", "1_cam01", "9_cam01"],
        ],
        [["0_rgb_v2", "1_rgb_v2", "9_rgb_v2"]; 2],
    ] {
        let fixture = rig([&first, &second]);
        let dataset = fixture.load().expect("loads");
        assert_eq!((dataset.n_cameras, dataset.n_frames), (2, 3));
        assert_eq!(dataset.views[4].time, (1.0f64 / 9.0) as f32);
        fixture.image(&format!("cam01/{}.jpg", second[1]), W, H, [0; 3]);
        let words = format!("{} (frame 1)", second[1]);
        fixture.refuses(&["cam01", &words, "twice"]);
    }
}

#[test]
fn cameras_whose_clocks_and_poses_jitter_are_told_apart_all_the_same() {
    let fixture = Fixture::new();
    let mut frames = Vec::new();
    for index in 0..3 {
        for frame in 0..4 {
            let name = format!("images/{index}_{frame}.png");
            fixture.image(&name, W, H, [0; 3]);
            let jitter = f64::from((7 * index + 3 * frame) % 5);
            let mut camera = camera(index as usize);
            camera.translation[0] += 4e-6 * jitter;
            let time = 0.25 * f64::from(frame) + 1e-4 * jitter;
            frames.push(
                json!({"file_path": name, "time": time, "transform_matrix": matrix(&camera)}),
            );
        }
    }
    write_single(&fixture, json!({"fl_x": 9.0}), &frames);
    let dataset = fixture.load().expect("loads");
    assert_eq!((dataset.n_cameras, dataset.n_frames), (3, 4));
}

#[test]
fn cameras_and_frames_may_both_be_numbers() {
    for n_frames in [4, 1] {
        let fixture = Fixture::new();
        for index in 0..3 {
            for frame in 0..n_frames {
                fixture.image(&format!("images/{index}/{frame}.png"), W, H, [0; 3]);
            }
        }
        let images = ["0/0.png", "1/0.png", "2/0.png"];
        let images: Vec<(&str, Camera)> = (0..3).map(|i| (images[i], camera(i))).collect();
        write_model(&fixture, "sparse/0", &images);
        let dataset = fixture.load().expect("loads");
        // One image per folder may as well be a static capture.
        let layout = if n_frames > 1 {
            Layout::Rig
        } else {
            Layout::Colmap
        };
        assert_eq!((dataset.layout, dataset.n_frames), (layout, n_frames));
        assert_eq!(dataset.views.len(), 3 * n_frames);
        for view in &dataset.views {
            assert_cameras_equal(&view.camera, &camera(view.camera_index));
        }
    }
}

#[test]
fn names_whose_order_in_time_is_not_known_are_refused() {
    for names in [
        ["frame_0009", "frame_000a", "frame_0010"],
        ["-1", "0", "1"],
        ["31-01-2024", "01-02-2024", "02-02-2024"],
        ["1.5", "1.25", "2.0"],
        ["30-Jan", "31-Jan", "01-Feb"],
        ["11.59 AM", "1.00 PM", "1.01 PM"],
    ] {
        rig([&names; 2]).refuses(&[
            "cam00",
            "in the order of time",
            "rename the frames 00000, 00001",
        ]);
        // One image per camera is of one time whatever its name.
        for name in names {
            rig([&[name]; 2]).load().expect("loads");
        }
    }
    // A year that stands first orders as names do.
    let dates = ["2023-12-31_23-59-59", "2024-01-01_00-00-00"];
    assert_eq!(rig([&dates; 2]).load().expect("loads").n_frames, 2);
}
