//! Which pictures of `transforms*.json` are trained on, the cameras that these are of, and their times.

use serde_json::{Value, json};

use super::super::{Dataset, LoadOptions, Partition};
use super::blender::{dnerf, file, frame, matrix, single, write_single};
use crate::test_kit::{Fixture, H, W, camera};

/// The names of views, and whether they are held out.
fn partitions(dataset: &Dataset) -> Vec<(&str, bool)> {
    let views = dataset.views.iter();
    views
        .map(|view| (view.name.as_str(), view.partition == Partition::Test))
        .collect()
}

#[test]
fn pictures_that_are_held_out_are_not_trained_on() {
    let fixture = dnerf();
    let again = [
        frame("test/r_0", 0.3, 2),
        frame("./test/../train/r_1.png", 0.3, 1),
    ];
    fixture.write("transforms_test.json", file(&again).to_string());
    let dataset = fixture.load().expect("two are left");
    let expected = [
        ("train/r_0", false),
        ("train/r_2", false),
        ("test/r_0", true),
        ("train/r_1", true),
    ];
    assert_eq!(partitions(&dataset), expected);

    let all = [
        frame("train/r_0", 0.0, 0),
        frame("train/r_1", 0.3, 1),
        frame("train/r_2", 1.0, 0),
    ];
    fixture.write("transforms_test.json", file(&all).to_string());
    fixture.refuses(&[
        "transforms_test.json: expected other pictures",
        "transforms_train.json",
        "all 3 of them",
    ]);
    // Where cameras are held out, it does not matter who lists a picture.
    let by_camera = LoadOptions {
        test_cameras: Some(vec![1]),
        ..LoadOptions::default()
    };
    let dataset = fixture.load_with(&by_camera).expect("loads");
    let expected = [
        ("train/r_0", false),
        ("train/r_1", true),
        ("train/r_2", false),
    ];
    assert_eq!(partitions(&dataset), expected);
}

#[test]
fn views_of_a_dropped_camera_are_gone() {
    let fixture = dnerf();
    let whole = fixture.load().expect("loads");
    let dropped = whole.views[0].camera_name.clone();
    let options = LoadOptions {
        drop_cameras: vec![dropped.clone()],
        ..LoadOptions::default()
    };
    let dataset = fixture.load_with(&options).expect("loads");
    let stays = |view: &&crate::dataset::View| view.camera_name != dropped;
    assert_eq!(
        dataset.views.len(),
        whole.views.iter().filter(stays).count()
    );
    assert!(dataset.views.iter().all(|view| stays(&view)));
}

#[cfg(unix)]
#[test]
fn links_to_pictures_that_are_trained_on_are_these() {
    let fixture = dnerf();
    fixture.remove("test/r_0.png");
    let (train, test) = (fixture.path("train/r_1.png"), fixture.path("test/r_0.png"));
    std::os::unix::fs::symlink(train, test).expect("a link");
    let dataset = fixture.load().expect("loads");
    let expected = [
        ("train/r_0", false),
        ("train/r_2", false),
        ("test/r_0", true),
    ];
    assert_eq!(partitions(&dataset), expected);
}

#[test]
fn nerfstudios_list_of_what_to_train_on_is_kept_to() {
    let names = |indices: &[usize]| -> Vec<String> {
        let name = |index: &usize| format!("images/{index}.png");
        indices.iter().map(name).collect()
    };
    // Five pictures by lists to train on, to validate with and to test with.
    let partition = |train: &[usize], val: &[usize], test: &[usize]| -> Vec<(usize, bool)> {
        let lists = json!({
            "fl_x": 9.0,
            "train_filenames": names(train),
            "val_filenames": names(val),
            "test_filenames": names(test),
        });
        let dataset = single(5, lists).load().expect("loads");
        let number = |name: &str| -> usize {
            let digits = name.trim_start_matches("images/");
            digits.parse().expect("a number")
        };
        let listed = partitions(&dataset).into_iter();
        listed
            .map(|(name, held_out)| (number(name), held_out))
            .collect()
    };
    let (train, test) = (false, true);
    assert_eq!(
        partition(&[0, 1], &[2], &[3]),
        [(0, train), (1, train), (3, test)]
    );
    assert_eq!(
        partition(&[0, 1], &[2], &[]),
        [(0, train), (1, train), (2, test)]
    );
    // In both lists it is held out.
    assert_eq!(partition(&[0, 1], &[], &[1]), [(0, train), (1, test)]);
    // Validation serves for training only where it is not listed what does.
    let all_but_one = [(0, train), (1, train), (2, train), (3, test), (4, train)];
    assert_eq!(partition(&[], &[2], &[3]), all_but_one);
}

/// Pictures with these names of cameras, indices of poses, and times.
fn named(pictures: &[(&str, usize, f64)]) -> Fixture {
    let fixture = Fixture::new();
    let entry = |(index, &(name, pose, time)): (usize, &(&str, usize, f64))| -> Value {
        let path = format!("images/{index}.png");
        fixture.image(&path, W, H, [0; 3]);
        json!({
            "file_path": path,
            "camera_name": name,
            "time": time,
            "transform_matrix": matrix(&camera(pose)),
        })
    };
    let frames: Vec<Value> = pictures.iter().enumerate().map(entry).collect();
    write_single(&fixture, json!({"fl_x": 9.0}), &frames);
    fixture
}

#[test]
fn a_name_of_several_poses_is_not_a_still_cameras() {
    let still = [
        ("right", 1, 0.0),
        ("left", 0, 0.0),
        ("right", 1, 1.0),
        ("left", 0, 1.0),
    ];
    let dataset = named(&still).load().expect("loads");
    let names: Vec<&str> = dataset
        .views
        .iter()
        .map(|v| v.camera_name.as_str())
        .collect();
    assert_eq!(
        (dataset.n_cameras, names),
        (2, vec!["right", "left", "right", "left"])
    );
    let carried = [0, 1, 2, 3].map(|k| ("phone", k, k as f64 / 3.0));
    let dataset = named(&carried).load().expect("loads");
    let indices: Vec<usize> = dataset.views.iter().map(|v| v.camera_index).collect();
    assert_eq!((dataset.n_cameras, indices), (4, vec![0, 1, 2, 3]));
    assert_eq!(dataset.views[3].camera_name, "cam03");
}

#[test]
fn times_in_seconds_of_a_short_clip_are_stretched_and_told() {
    let times = |stated: [f64; 3]| {
        let pictures = [0, 1, 2].map(|k| ("phone", k, stated[k]));
        let dataset = named(&pictures).load().expect("loads");
        let times: Vec<f32> = dataset.views.iter().map(|view| view.time).collect();
        (times, dataset.stated_span)
    };
    let stretched = (vec![0.0, 0.5, 1.0], Some([0.0, 0.5]));
    assert_eq!(times([0.0, 0.25, 0.5]), stretched);
    let kept = [0.0, 0.25, 0.983];
    assert_eq!(times(kept), (kept.map(|t| t as f32).into(), None));
}
