use std::f64::consts::FRAC_PI_2;

use dash_kernels::Camera;
use serde_json::{Value, json};

use super::super::{Layout, LoadOptions, Partition};
use crate::test_kit::{Fixture, H, W, assert_cameras_equal, axis, camera, negated};

/// Camera-to-world with OpenGL axes.
pub(super) fn matrix(camera: &Camera) -> Value {
    let columns = [
        axis(camera, 0),
        negated(axis(camera, 1)),
        negated(axis(camera, 2)),
        camera.position(),
    ];
    let mut rows: Vec<Vec<f64>> = (0..3)
        .map(|r| columns.iter().map(|column| column[r]).collect())
        .collect();
    rows.push(vec![0.0, 0.0, 0.0, 1.0]);
    json!(rows)
}

pub(super) fn frame(path: &str, time: f64, camera_index: usize) -> Value {
    json!({"file_path": path, "time": time, "transform_matrix": matrix(&camera(camera_index))})
}

pub(super) fn file(frames: &[Value]) -> Value {
    // The fixture's cameras have fx = 9 at W = 8.
    json!({"camera_angle_x": 2.0 * (4.0f64 / 9.0).atan(), "frames": frames})
}

/// D-NeRF: RGBA images without extension in the JSON, cameras 0, 1, 0 | 2.
pub(super) fn dnerf() -> Fixture {
    let fixture = Fixture::new();
    let train = [
        frame("./train/r_0", 0.0, 0),
        frame("./train/r_1", 0.3, 1),
        frame("./train/r_2", 1.0, 0),
    ];
    fixture.write("transforms_train.json", file(&train).to_string());
    fixture.write(
        "transforms_test.json",
        file(&[frame("./test/r_0", 0.3, 2)]).to_string(),
    );
    fixture.write("transforms_val.json", "not read when there is a test file");
    for name in ["train/r_0", "train/r_1", "train/r_2", "test/r_0"] {
        let pixel = image::Rgba([200, 100, 0, 51]);
        image::RgbaImage::from_pixel(W as u32, H as u32, pixel)
            .save(fixture.path(&format!("{name}.png")))
            .expect("fixture image");
    }
    fixture
}

/// One `transforms.json` over `n` RGB images.
pub(super) fn single(n: usize, shared: Value) -> Fixture {
    let fixture = Fixture::new();
    let frames: Vec<Value> = (0..n)
        .map(|i| json!({"file_path": format!("images/{i}.png"), "transform_matrix": matrix(&camera(i))}))
        .collect();
    write_single(&fixture, shared, &frames);
    for index in 0..n {
        fixture.image(&format!("images/{index}.png"), W, H, [index as u8; 3]);
    }
    fixture
}

pub(super) fn write_single(fixture: &Fixture, mut top: Value, frames: &[Value]) {
    top["frames"] = json!(frames);
    fixture.write("transforms.json", top.to_string());
}

#[test]
fn dnerf_cameras_times_splits_and_transparency() {
    let dataset = dnerf().load().expect("loads");
    assert_eq!(dataset.layout, Layout::Blender);
    assert_eq!((dataset.n_cameras, dataset.n_frames), (3, 3));
    assert_eq!(dataset.background, Some([1.0; 3]));
    let listed: Vec<_> = dataset
        .views
        .iter()
        .map(|v| {
            (
                v.name.as_str(),
                v.camera_index,
                v.frame,
                v.time,
                v.partition,
            )
        })
        .collect();
    assert_eq!(
        listed,
        [
            ("train/r_0", 0, 0, 0.0, Partition::Train),
            ("train/r_1", 1, 1, 0.3, Partition::Train),
            ("train/r_2", 0, 2, 1.0, Partition::Train),
            ("test/r_0", 2, 1, 0.3, Partition::Test),
        ]
    );
    for view in &dataset.views {
        assert_cameras_equal(&view.camera, &camera(view.camera_index));
    }
    let view = &dataset.views[0];
    // 51 / 255 = 0.2: c * 0.2 + 0.8 over white.
    for (got, expected) in
        view.rgb([1.0; 3])
            .expect("in memory")
            .iter()
            .zip([0.956_862_75, 0.878_431_4, 0.8])
    {
        assert!(
            (got - expected).abs() < 1e-6,
            "got {got}, expected {expected}"
        );
    }
    assert!((view.alpha().expect("in memory").expect("RGBA")[5] - 0.2).abs() < 1e-6);
}

#[test]
fn test_cameras_override_the_files() {
    let options = LoadOptions {
        test_cameras: Some(vec![0]),
        ..LoadOptions::default()
    };
    let dataset = dnerf().load_with(&options).expect("loads");
    let tested: Vec<bool> = dataset
        .views
        .iter()
        .map(|v| v.partition == Partition::Test)
        .collect();
    assert_eq!(tested, [true, false, true, false]);
    let options = LoadOptions {
        test_cameras: Some(vec![7]),
        ..LoadOptions::default()
    };
    assert!(
        dnerf()
            .load_with(&options)
            .expect_err("3 cameras")
            .to_string()
            .contains("0 to 2")
    );
}

#[test]
fn a_part_of_the_frames_spans_all_of_time() {
    let options = LoadOptions {
        max_frames: Some(2),
        ..LoadOptions::default()
    };
    let dataset = dnerf().load_with(&options).expect("loads");
    let times: Vec<_> = dataset.views.iter().map(|v| (v.frame, v.time)).collect();
    assert_eq!(
        (dataset.n_frames, times),
        (2, vec![(0, 0.0), (1, 1.0), (1, 1.0)])
    );
}

#[test]
fn the_frames_own_intrinsics_count_and_times_in_seconds_are_normalised() {
    let fixture = dnerf();
    let mut first = frame("train/r_0.png", 2.0, 0);
    let own = json!({"fl_x": 10.0, "fl_y": 11.0, "cx": 3.5, "cy": 2.5, "w": W as f64, "h": H});
    for (key, value) in own.as_object().expect("an object") {
        first[key] = value.clone();
    }
    let second = frame("train/r_1.png", 7.0, 1);
    fixture.write(
        "transforms_train.json",
        json!({"camera_angle_x": FRAC_PI_2, "frames": [first, second]}).to_string(),
    );
    fixture.write(
        "transforms_test.json",
        file(&[frame("test/r_0", 12.0, 2)]).to_string(),
    );
    let views = fixture.load().expect("loads").views;
    let expected = Camera {
        fx: 10.0,
        fy: 11.0,
        cx: 3.5,
        cy: 2.5,
        ..camera(0)
    };
    assert_cameras_equal(&views[0].camera, &expected);
    // Half of the width at 45 degrees.
    assert_cameras_equal(
        &views[1].camera,
        &Camera {
            fx: 4.0,
            fy: 4.0,
            ..camera(1)
        },
    );
    assert_eq!(
        views.iter().map(|v| v.time).collect::<Vec<_>>(),
        [0.0, 0.5, 1.0]
    );
}

#[test]
fn cameras_may_differ_in_size_and_lens() {
    let fixture = Fixture::new();
    let mut wide = json!({"file_path": "images/0.png", "transform_matrix": matrix(&camera(0))});
    let own =
        json!({"w": 2 * W, "h": H, "fl_x": 9.0, "cx": W as f64 - 0.5, "camera_model": "PINHOLE"});
    for (key, value) in own.as_object().expect("an object") {
        wide[key] = value.clone();
    }
    let other =
        json!({"file_path": "images/1.png", "transform_matrix": matrix(&camera(1)), "k1": 1.0});
    let top = json!({"w": W, "h": H, "fl_x": 9.0, "camera_model": "OPENCV"});
    write_single(&fixture, top, &[wide, other]);
    fixture.image("images/0.png", 2 * W, H, [0; 3]);
    fixture.image("images/1.png", W, H, [0; 3]);
    let views = fixture.load().expect("loads").views;
    let expected = Camera {
        width: 2 * W,
        cx: W as f64 - 0.5,
        ..camera(0)
    };
    assert_cameras_equal(&views[0].camera, &expected);
    assert!(views[1].camera.fx > 9.0 && views[1].camera.width == W);
}

#[test]
fn nerfstudios_lists_say_what_is_held_out() {
    for (key, held_out) in [
        ("test_filenames", true),
        ("val_filenames", true),
        ("train_filenames", false),
    ] {
        // The last is outside, and no picture's.
        let lists = json!({"fl_x": 9.0, key: ["./images/1.png", "images/2.png", "../x.png"]});
        let dataset = single(4, lists).load().expect("loads");
        let listed: Vec<usize> = (0..4)
            .filter(|&index| dataset.views[index].partition == Partition::Test)
            .collect();
        // Without lists of what to hold out: what is not to be trained on.
        let expected = if held_out { [1, 2] } else { [0, 3] };
        assert_eq!(listed, expected, "{key}");
    }
}

#[test]
fn broken_images_are_left_out_where_asked() {
    let fixture = single(4, json!({"fl_x": 9.0}));
    fixture.write("images/2.png", "damaged");
    fixture.refuses(&["2.png"]);
    let skipping = LoadOptions {
        skip_broken: true,
        ..LoadOptions::default()
    };
    let dataset = fixture.load_with(&skipping).expect("three are left");
    let names: Vec<&str> = dataset.views.iter().map(|v| v.name.as_str()).collect();
    assert_eq!(names, ["images/0", "images/1", "images/3"]);
    for index in 0..4 {
        fixture.write(&format!("images/{index}.png"), "");
    }
    let none = LoadOptions {
        test_cameras: Some(vec![0]),
        ..skipping
    };
    let error = fixture.load_with(&none).expect_err("nothing is left");
    assert!(error.to_string().contains("transforms.json"), "{error}");
}

#[test]
fn without_times_it_is_static_and_every_eighth_name_is_held_out() {
    let dataset = single(17, json!({"fl_x": 9.0, "w": W, "h": H}))
        .load()
        .expect("loads");
    assert!(dataset.is_static() && dataset.views.iter().all(|v| v.time == 0.0 && v.frame == 0));
    assert_eq!((dataset.n_cameras, dataset.background), (17, None));
    let held_out: Vec<&str> = dataset
        .views_of(Partition::Test)
        .map(|v| v.name.as_str())
        .collect();
    // Natural order: 8 and 16, not 15 (which is eighth in plain order).
    assert_eq!(held_out, ["images/0", "images/8", "images/16"]);
    let alone = single(1, json!({"fl_x": 9.0}))
        .load()
        .expect("one view to train on");
    assert_eq!(alone.views_of(Partition::Train).count(), 1);
}

#[test]
fn mixed_or_endless_times_are_errors() {
    let fixture = dnerf();
    let mut untimed = frame("train/r_1", 0.0, 1);
    untimed["time"] = Value::Null;
    fixture.write(
        "transforms_train.json",
        file(&[frame("train/r_0", 0.5, 0), untimed]).to_string(),
    );
    fixture.refuses(&["transforms_train.json", "train/r_1", "`time`"]);
    let text = file(&[frame("train/r_0", 0.5, 0)]).to_string();
    fixture.write("transforms_train.json", text.replace("0.5", "1e999"));
    fixture.refuses(&["transforms_train.json"]);
    fixture.write("transforms_train.json", text.replace("0.5", "NaN"));
    fixture.refuses(&["transforms_train.json"]);
}

#[test]
fn distortion_is_undone_and_unknown_lenses_are_refused() {
    let lens = json!({"camera_model": "OPENCV", "fl_x": 9.0, "w": W, "h": H, "k1": 1.0});
    let dataset = single(2, lens).load().expect("loads");
    let camera = &dataset.views[0].camera;
    assert!(
        camera.fx > 9.0 && camera.fx < 12.0,
        "zoomed past the empty border: {}",
        camera.fx
    );
    let negligible = json!({"fl_x": 9.0, "w": W, "h": H, "k1": 1e-9});
    assert_eq!(
        single(2, negligible).load().expect("loads").views[0]
            .camera
            .fx,
        9.0
    );
    for top in [
        json!({"camera_model": "OPENCV_FISHEYE", "fl_x": 9.0}),
        json!({"is_fisheye": true, "fl_x": 9.0}),
        json!({"camera_model": "EQUIRECTANGULAR", "fl_x": 9.0}),
        json!({"fl_x": 9.0, "k1": -40.0}),
    ] {
        single(2, top).refuses(&["transforms.json"]);
    }
}

#[test]
fn paths_that_leave_the_folder_are_refused() {
    for path in [
        "../secret.png",
        "/etc/hostname",
        "images/../../secret.png",
        "",
    ] {
        let fixture = single(2, json!({"fl_x": 9.0}));
        write_single(&fixture, json!({"fl_x": 9.0}), &[frame(path, 0.0, 0)]);
        fixture.refuses(&["transforms.json", "inside", path]);
        write_single(
            &fixture,
            json!({"fl_x": 9.0, "ply_file_path": path}),
            &[frame("images/0", 0.0, 0)],
        );
        fixture.refuses(&["transforms.json", "inside", path]);
    }
}

#[test]
fn malformed_entries_name_the_file_and_the_frame() {
    let good = || json!({"fl_x": 9.0, "w": W, "h": H});
    let set = |key: &str, value: Value| {
        let mut top = good();
        top[key] = value;
        top
    };
    for (top, word) in [
        (json!({}), "camera_angle_x"),
        (set("fl_x", json!(0.0)), "focal lengths 0"),
        (set("fl_y", json!(-2.0)), "-2"),
        (set("w", json!(7.5)), "7.5"),
        (set("w", json!(1e300)), "whole numbers"),
        (set("w", json!(2 * W)), "16x6"),
        (set("fl_x", json!("wide")), "invalid type"),
    ] {
        single(2, top).refuses(&[word]);
    }
    let fixture = single(2, good());
    for (value, word) in [
        (json!([[1, 0, 0, 0], [0, 1, 0, 0]]), "2 rows"),
        (json!([[1, 0, 0], [0, 1, 0], [0, 0, 1]]), "[3, 3, 3]"),
        (json!([]), "0 rows"),
        (json!([[0, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0]]), "zeros"),
        (
            json!([[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, -1, 0]]),
            "mirrored",
        ),
        (
            json!([[1, 1, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0]]),
            "perpendicular",
        ),
    ] {
        let entry = json!({"file_path": "images/1.png", "transform_matrix": value});
        write_single(&fixture, good(), &[entry]);
        fixture.refuses(&["transforms.json", word]);
    }
    write_single(&fixture, good(), &[]);
    fixture.refuses(&["transforms.json", "at least one frame"]);
    write_single(&fixture, good(), &[frame("images/77", 0.0, 0)]);
    fixture.refuses(&["transforms.json", "images/77", "no such file"]);
}

#[test]
fn truncated_files_are_errors() {
    let fixture = dnerf();
    fixture.survives_truncation("transforms_train.json", 1);
    fixture.survives_truncation("transforms_test.json", 7);
    fixture.survives_truncation("train/r_1.png", 1);
}

#[test]
fn masks_of_test_views() {
    let fixture = dnerf();
    image::GrayImage::from_pixel(W as u32, H as u32, image::Luma([255]))
        .save(fixture.path("motion_masks/test/r_0.png"))
        .expect("writes");
    let views = fixture.load().expect("loads").views;
    let mask = views[3].motion_mask().expect("reads").expect("a mask");
    assert_eq!(mask[..], [255; W * H]);
    fixture.image("motion_masks/test/r_0.png", 2 * W, H, [255; 3]);
    fixture.refuses(&["motion_masks", "r_0.png", "8x6", "16x6"]);
}
