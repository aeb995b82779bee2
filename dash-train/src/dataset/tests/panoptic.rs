//! The layout of Dynamic 3D Gaussians.

use dash_kernels::Camera;
use serde_json::{Value, json};

use super::super::{FrameRange, Layout, LoadOptions, Partition};
use crate::synth::{SynthConfig, SynthLayout, write};
use crate::test_kit::{Fixture, H, W, assert_cameras_equal, camera};

/// Numbers of the cameras, in no order; the second is the test camera.
const IDS: [u64; 3] = [7, 10, 2];
/// Numbers of the frames, of which one is missing.
const FRAMES: [usize; 3] = [4, 5, 7];

/// A file with some of the cameras at every time.
fn meta(cameras: &[usize]) -> Value {
    let at_each_time = |of: &dyn Fn(usize, usize) -> Value| -> Vec<Vec<Value>> {
        let row = |frame: &usize| cameras.iter().map(|&index| of(index, *frame)).collect();
        FRAMES.iter().map(row).collect()
    };
    let intrinsics = |index: usize| {
        let Camera { fx, fy, cx, cy, .. } = camera(index);
        json!([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
    };
    let pose = |index: usize| {
        let camera = camera(index);
        let row = |axis: usize| {
            let [x, y, z] = camera.rotation[axis];
            [x, y, z, camera.translation[axis]]
        };
        json!([row(0), row(1), row(2), [0, 0, 0, 1]])
    };
    json!({
        "w": W, "h": H,
        "k": at_each_time(&|index, _| intrinsics(index)),
        "w2c": at_each_time(&|index, _| pose(index)),
        "fn": at_each_time(&|index, frame| json!(format!("{}/{frame:06}.jpg", IDS[index]))),
        "cam_id": at_each_time(&|index, _| json!(IDS[index])),
    })
}

fn capture() -> Fixture {
    let fixture = Fixture::new();
    fixture.write("train_meta.json", meta(&[0, 2]).to_string());
    fixture.write("test_meta.json", meta(&[1]).to_string());
    for id in IDS {
        for frame in FRAMES {
            let name = format!("ims/{id}/{frame:06}.jpg");
            fixture.image(&name, W, H, [40, id as u8, frame as u8]);
        }
    }
    fixture
}

#[test]
fn cameras_times_and_test_views() {
    let dataset = capture().load().expect("loads");
    assert_eq!(dataset.layout, Layout::Panoptic);
    assert_eq!(
        (dataset.n_cameras, dataset.n_frames, dataset.views.len()),
        (3, 3, 9)
    );
    for view in &dataset.views {
        let id: u64 = view.camera_name.parse().expect("a number");
        let index = IDS.iter().position(|&known| known == id).expect("known");
        assert_cameras_equal(&view.camera, &camera(index));
        assert_eq!(view.camera_index, [1, 2, 0][index]);
        // As far apart as the frames' numbers.
        assert_eq!(
            view.time,
            [0.0, 1.0 / 3.0, 1.0][view.frame],
            "{}",
            view.name
        );
        assert_eq!(view.name, format!("{id}/{:06}", FRAMES[view.frame]));
        assert_eq!(view.partition == Partition::Test, index == 1);
    }
}

#[test]
fn without_a_test_file_the_first_camera_is_held_out() {
    let fixture = capture();
    fixture.write("train_meta.json", meta(&[0, 1, 2]).to_string());
    let held_out = |options: &LoadOptions| -> Vec<String> {
        let dataset = fixture.load_with(options).expect("loads");
        let mut names: Vec<String> = dataset
            .views_of(Partition::Test)
            .map(|view| view.camera_name.clone())
            .collect();
        names.dedup();
        names
    };
    let all = LoadOptions::default();
    // Both files list camera 10: it is tested with.
    assert_eq!(held_out(&all), ["10"]);
    fixture.remove("test_meta.json");
    assert_eq!(held_out(&all), ["2"]);
    let chosen = LoadOptions {
        test_cameras: Some(vec![1]),
        ..all
    };
    assert_eq!(held_out(&chosen), ["7"]);
}

#[test]
fn a_part_of_the_frames_and_of_the_cameras() {
    let options = LoadOptions {
        frames: Some(FrameRange::Between { first: 1, last: 2 }),
        drop_cameras: vec!["7".into()],
        ..LoadOptions::default()
    };
    let dataset = capture().load_with(&options).expect("loads");
    let mut views = dataset.views.iter();
    assert_eq!((dataset.n_frames, views.len()), (2, 4));
    assert!(views.all(|view| view.camera_name != "7" && view.frame < 2));
}

#[test]
fn names_that_do_not_count_the_times_are_only_names() {
    let fixture = capture();
    let mut train = meta(&[0, 2]);
    // The first camera's names fall, so times are evenly apart.
    train["fn"] = json!([
        ["7/000007.jpg", "2/000004.jpg"],
        ["7/000005.jpg", "2/000005.jpg"],
        ["7/000004.jpg", "2/000007.jpg"]
    ]);
    fixture.write("train_meta.json", train.to_string());
    let dataset = fixture.load().expect("loads");
    assert_eq!((dataset.n_frames, dataset.views.len()), (3, 9));
    assert!(
        dataset
            .views
            .iter()
            .all(|view| view.time == view.frame as f32 / 2.0)
    );
}

#[test]
fn what_is_wrong_is_named() {
    let with = |change: &dyn Fn(&mut Value)| {
        let fixture = capture();
        let mut train = meta(&[0, 2]);
        change(&mut train);
        fixture.write("train_meta.json", train.to_string());
        fixture
    };
    let cut = with(&|meta| {
        meta["k"].as_array_mut().map(Vec::pop);
    });
    cut.refuses(&["train_meta.json", "as many times", "[2, 3, 3, 3]"]);
    let fewer = with(&|meta| {
        meta["cam_id"][1].as_array_mut().map(Vec::pop);
    });
    fewer.refuses(&["as many cameras", "[2, 2, 2, 1] at time 1"]);
    let skewed = with(&|meta| meta["k"][2][1][0][1] = json!(3.0));
    skewed.refuses(&["pixels without skew", "at time 2, camera 2"]);
    let mirrored = with(&|meta| {
        for axis in 0..4 {
            meta["w2c"][0][0][0][axis] = json!(-meta["w2c"][0][0][0][axis].as_f64().expect("one"));
        }
    });
    mirrored.refuses(&["w2c", "mirrored", "at time 0, camera 7"]);
    let transposed = with(&|meta| meta["w2c"][0][0][3] = json!([1.0, 2.0, 3.0, 1.0]));
    transposed.refuses(&["last row of [1.0, 2.0, 3.0, 1.0]"]);
    let outside = with(&|meta| meta["fn"][0][0] = json!("../../secret.jpg"));
    outside.refuses(&["train_meta.json", "inside the dataset's folder"]);
    let gone = with(&|meta| meta["fn"][0][0] = json!("7/000099.jpg"));
    gone.refuses(&["ims/7/000099.jpg"]);
    capture().survives_truncation("train_meta.json", 97);
}

#[test]
fn points_and_colours_come_from_the_archive() {
    let folder = tempfile::tempdir().expect("a scratch folder");
    let out = folder.path().join("clip");
    let config = SynthConfig {
        layout: SynthLayout::Panoptic,
        cameras: 3,
        frames: 2,
        width: 32,
        height: 24,
        ..SynthConfig::default()
    };
    let summary = write(&out, &config).expect("writes");
    let points = |root: &std::path::Path| {
        let dataset = super::load(root, &LoadOptions::default()).expect("loads");
        dataset.points
    };
    let cloud = points(&out).expect("points");
    assert_eq!(cloud.positions.len(), summary.points);
    let same = SynthConfig {
        layout: SynthLayout::N3dv,
        ..config
    };
    let beside = folder.path().join("n3dv");
    write(&beside, &same).expect("writes");
    assert_eq!(Some(cloud), points(&beside));
    let path = out.join("init_pt_cld.npz");
    let bytes = std::fs::read(&path).expect("reads");
    std::fs::write(&path, &bytes[..bytes.len() / 2]).expect("writes");
    let error = super::load(&out, &LoadOptions::default()).expect_err("damaged");
    assert!(error.to_string().contains("init_pt_cld.npz"), "{error}");
}
