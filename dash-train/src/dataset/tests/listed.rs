//! Files that poses list in other words than they are called, or that are missing.

use serde_json::{Value, json};

use super::super::{LoadOptions, Partition};
use super::blender::{dnerf, file, frame, matrix, single, write_single};
use super::nerfies::capture;
use crate::test_kit::{Fixture, H, W, camera, npy, write_model};

fn names(fixture: &Fixture, options: &LoadOptions) -> Vec<String> {
    let dataset = fixture.load_with(options).expect("loads");
    dataset.views.into_iter().map(|view| view.name).collect()
}

fn skipping() -> LoadOptions {
    LoadOptions {
        skip_broken: true,
        ..LoadOptions::default()
    }
}

#[test]
fn missing_images_are_left_out_where_asked() {
    let fixture = single(4, json!({"fl_x": 9.0}));
    fixture.remove("images/2.png");
    let advice = "or leave it out with --skip-broken";
    fixture.refuses(&["images/2.png", "no such file", advice]);
    let kept = names(&fixture, &skipping());
    assert_eq!(kept, ["images/0", "images/1", "images/3"]);
    for index in [0, 1, 3] {
        fixture.remove(&format!("images/{index}.png"));
    }
    let error = fixture.load_with(&skipping()).expect_err("none is left");
    assert!(error.to_string().contains("transforms.json"), "{error}");

    let fixture = capture();
    fixture.remove("rgb/2x/000020.png");
    fixture.refuses(&["dataset.json", "000020", advice]);
    assert_eq!(names(&fixture, &skipping()).len(), 5);
    fixture.remove("camera/000030.json");
    fixture.image("rgb/2x/000020.png", W, H, [0; 3]);
    let words = ["the camera", "000030.json, found no such file", advice];
    fixture.refuses(&words);
    let kept = names(&fixture, &skipping());
    assert_eq!(kept, ["000000", "000020", "000040", "000010", "000050"]);

    let fixture = Fixture::new();
    let images = [
        ("a.png", camera(0)),
        ("b.png", camera(1)),
        ("c.png", camera(2)),
    ];
    write_model(&fixture, "sparse/0", &images);
    fixture.image("images/a.png", W, H, [0; 3]);
    fixture.image("images/c.png", W, H, [0; 3]);
    fixture.refuses(&["images.txt", "b.png", advice]);
    assert_eq!(names(&fixture, &skipping()), ["a", "c"]);
    fixture.remove("images/a.png");
    fixture.remove("images/c.png");
    let error = fixture.load_with(&skipping()).expect_err("none is left");
    assert!(error.to_string().contains("images.txt"), "{error}");
}

#[test]
fn paths_with_backslashes_and_paths_that_lead_back_are_read() {
    let fixture = single(4, json!({"fl_x": 9.0}));
    let absolute = fixture.path("images/2.png");
    let paths = [
        "images\\0.png",
        ".\\images\\1",
        absolute.to_str().expect("a name in UTF-8"),
    ];
    let frames: Vec<Value> = (0..3).map(|i| frame(paths[i], 0.5 * i as f64, i)).collect();
    // Lists of what to hold out are written in the same way.
    let top = json!({"fl_x": 9.0, "test_filenames": [paths[0], paths[2]]});
    write_single(&fixture, top, &frames);
    let dataset = fixture.load().expect("loads");
    let listed: Vec<_> = dataset
        .views
        .iter()
        .map(|v| (v.name.as_str(), v.partition == Partition::Test))
        .collect();
    let expected = [("images/0", true), ("images/1", false), ("images/2", true)];
    assert_eq!(listed, expected);
}

#[test]
fn images_with_another_extension_are_read() {
    let fixture = single(2, json!({"fl_x": 9.0}));
    fixture.remove("images/1.png");
    fixture.image("images/1.JPG", W, H, [7; 3]);
    assert_eq!(
        names(&fixture, &LoadOptions::default()),
        ["images/0", "images/1"]
    );
    fixture.remove("images/1.JPG");
    fixture.write("images/1.webp", "RIFF");
    fixture.refuses(&["images/1.png", "1.webp: only PNG and JPEG are read"]);

    let fixture = capture();
    for index in 0..6 {
        for folder in ["2x", "4x"] {
            fixture.remove(&format!("rgb/{folder}/{:06}.png", index * 10));
        }
        fixture.write(&format!("rgb/2x/{:06}.webp", index * 10), "RIFF");
    }
    fixture.refuses(&["rgb", "000000.webp: only PNG and JPEG are read"]);
}

#[test]
fn points_that_are_named_and_missing_are_no_error() {
    let fixture = single(2, json!({"fl_x": 9.0, "ply_file_path": "sparse_pc.ply"}));
    assert_eq!(fixture.load().expect("loads").points, None);
    let fixture = capture();
    let header = "{'descr': '<f8', 'fortran_order': False, 'shape': (0, 3), }";
    fixture.write("points.npy", npy(header, &[]));
    assert_eq!(fixture.load().expect("loads").points, None);
}

#[test]
fn files_of_test_views_without_frames_are_as_if_absent() {
    let fixture = dnerf();
    fixture.write("transforms_test.json", file(&[]).to_string());
    fixture.write(
        "transforms_val.json",
        file(&[frame("test/r_0", 0.3, 2)]).to_string(),
    );
    let held_out = |fixture: &Fixture| -> Vec<String> {
        let dataset = fixture.load().expect("loads");
        let views = dataset.views_of(Partition::Test);
        views.map(|view| view.name.clone()).collect()
    };
    assert_eq!(held_out(&fixture), ["test/r_0"]);
    fixture.write("transforms_val.json", file(&[]).to_string());
    assert_eq!(held_out(&fixture), ["train/r_0"], "every eighth");
    fixture.write("transforms_train.json", file(&[]).to_string());
    fixture.refuses(&["transforms_train.json", "at least one frame"]);
}

#[test]
fn numbers_of_times_serve_where_no_frame_has_a_time() {
    let fixture = single(3, json!({"fl_x": 9.0}));
    let entries = |times: [Value; 3]| {
        let entry = |(index, own): (usize, Value)| {
            let mut entry = json!({
                "file_path": format!("images/{index}.png"),
                "transform_matrix": matrix(&camera(0)),
                "timestep_index": 2 * index,
            });
            for (key, value) in own.as_object().expect("an object") {
                entry[key] = value.clone();
            }
            entry
        };
        let frames: Vec<Value> = times.into_iter().enumerate().map(entry).collect();
        write_single(&fixture, json!({"fl_x": 9.0}), &frames);
        fixture.load()
    };
    let times = |dataset: super::super::Dataset| -> Vec<f32> {
        dataset.views.iter().map(|view| view.time).collect()
    };
    let none = || json!({});
    let numbered = entries([none(), none(), none()]).expect("loads");
    assert_eq!(
        (numbered.n_frames, times(numbered)),
        (3, vec![0.0, 0.5, 1.0])
    );
    let at = |time: f64| json!({"time": time});
    let timed = entries([at(0.0), at(0.3), at(0.9)]).expect("loads");
    assert_eq!(times(timed), [0.0, 0.3, 0.9]);
    assert!(entries([at(0.0), none(), none()]).is_err(), "mixed times");
    // Without a number for each there is no time at all, as before.
    let unknown = json!({"timestep_index": "two"});
    let without = entries([none(), none(), unknown]).expect("loads");
    assert!(without.is_static());
}

#[test]
fn times_of_nerfies_captures_may_be_written_as_fractions_but_not_be_any() {
    let fixture = capture();
    let with = |time: f64| {
        let entry = |index: usize| (format!("{:06}", index * 10), json!({"time_id": time}));
        let entries: serde_json::Map<String, Value> = (0..6).map(entry).collect();
        fixture.write("metadata.json", json!(entries).to_string());
    };
    with(3.0);
    assert_eq!(fixture.load().expect("loads").n_frames, 1);
    with(3.5);
    fixture.refuses(&["metadata.json", "whole numbers", "3.5 for `000000`"]);
    fixture.remove("metadata.json");
    fixture.refuses(&["dataset.json, metadata.json and camera/"]);
}

#[test]
fn a_byte_order_mark_before_json_does_no_harm() {
    for (fixture, name) in [
        (single(2, json!({"fl_x": 9.0})), "transforms.json"),
        (capture(), "dataset.json"),
        (capture(), "camera/000000.json"),
    ] {
        let mut bytes = b"\xef\xbb\xbf".to_vec();
        bytes.extend(std::fs::read(fixture.path(name)).expect("fixture file"));
        fixture.write(name, bytes);
        fixture.load().expect(name);
    }
}
