use dash_kernels::Camera;
use serde_json::{Value, json};

use super::super::{Layout, LoadOptions, Partition};
use crate::test_kit::{Fixture, H, W, assert_cameras_equal, camera, npy, real_capture};

const SCALE: f64 = 0.5;
const CENTER: [f64; 3] = [1.0, -2.0, 0.25];

/// At image size 2W x 2H, in the unscaled world.
fn stated(index: usize) -> Value {
    let camera = large(index);
    let scaled = camera.position();
    let position = [0, 1, 2].map(|axis| scaled[axis] / SCALE + CENTER[axis]);
    json!({
        "orientation": camera.rotation,
        "position": position,
        "focal_length": camera.fx,
        "principal_point": [camera.cx, camera.cy],
        "skew": 0.0,
        "pixel_aspect_ratio": camera.fy / camera.fx,
        "radial_distortion": [0.0, 0.0, 0.0],
        "tangential_distortion": [0.0, 0.0],
        "image_size": [camera.width, camera.height],
    })
}

fn expected(index: usize) -> Camera {
    Camera {
        cx: 4.5,
        fy: 9.5,
        ..camera(index)
    }
}

fn large(index: usize) -> Camera {
    expected(index).resized(2 * W, 2 * H)
}

fn points() -> Vec<u8> {
    let header = "{'descr': '<f8', 'fortran_order': False, 'shape': (2, 3), }";
    // The scaled world's origin, which all cameras see in their middle, and a point none sees.
    let far = [1e4, 1e4, 1e4];
    let values: Vec<u8> = CENTER
        .iter()
        .chain(&far)
        .flat_map(|v| v.to_le_bytes())
        .collect();
    npy(header, &values)
}

/// A validation rig: two cameras at each of three times, the second held out.
pub(super) fn capture() -> Fixture {
    let fixture = Fixture::new();
    let id = |index: usize| format!("{:06}", index * 10);
    let ids: Vec<String> = (0..6).map(id).collect();
    let of = |rest: usize| -> Vec<&String> { ids.iter().skip(rest).step_by(2).collect() };
    fixture.write(
        "dataset.json",
        json!({"count": 6, "ids": ids, "train_ids": of(0), "val_ids": of(1)}).to_string(),
    );
    let entry = |index: usize| json!({"warp_id": (4 + index / 2), "appearance_id": 0, "camera_id": (index % 2)});
    let metadata: serde_json::Map<String, Value> =
        (0..6).map(|index| (id(index), entry(index))).collect();
    fixture.write("metadata.json", json!(metadata).to_string());
    let scene = json!({"scale": SCALE, "center": CENTER, "near": 0.1, "far": 2.0});
    fixture.write("scene.json", scene.to_string());
    fixture.write("points.npy", points());
    for index in 0..6 {
        fixture.write(
            &format!("camera/{}.json", id(index)),
            stated(index).to_string(),
        );
        fixture.image(
            &format!("rgb/2x/{}.png", id(index)),
            W,
            H,
            [40, index as u8, 9],
        );
        fixture.image(&format!("rgb/4x/{}.png", id(index)), W / 2, H / 2, [0; 3]);
    }
    fixture
}

#[test]
fn cameras_times_splits_and_points_of_a_validation_rig() {
    let dataset = capture().load().expect("loads");
    assert_eq!(dataset.layout, Layout::Nerfies);
    assert_eq!(
        (dataset.n_cameras, dataset.n_frames, dataset.views.len()),
        (6, 3, 6)
    );
    for (at, view) in dataset.views.iter().enumerate() {
        // Training ids first: 0, 2, 4, then 1, 3, 5.
        let index = if at < 3 { 2 * at } else { 2 * at - 5 };
        assert_eq!(view.name, format!("{:06}", index * 10));
        assert_cameras_equal(&view.camera, &expected(index));
        assert_eq!(
            (view.frame, view.time),
            (index / 2, (index / 2) as f32 / 2.0)
        );
        assert_eq!(view.partition == Partition::Test, index % 2 == 1);
        assert_eq!(view.rgb([0.0; 3]).expect("reads")[1], index as f32 / 255.0);
    }
    let points = dataset.points.expect("points.npy");
    assert_eq!(points.positions[0], [0.0; 3]);
    // The median of the training views' 0, 2, 4; unseen points are gray.
    assert_eq!(points.colors, [[40, 2, 9], [128; 3]]);
}

#[test]
fn the_largest_images_count_and_time_ids_come_before_warp_ids() {
    let fixture = capture();
    for index in 0..6 {
        fixture.image(
            &format!("rgb/1x/{:06}.png", index * 10),
            2 * W,
            2 * H,
            [0; 3],
        );
    }
    let entries: serde_json::Map<String, Value> = (0..6)
        .map(|i| {
            (
                format!("{:06}", i * 10),
                json!({"warp_id": 0, "time_id": (10 * i)}),
            )
        })
        .collect();
    fixture.write("metadata.json", json!(entries).to_string());
    fixture.remove("scene.json");
    let dataset = fixture.load().expect("loads");
    assert_eq!(dataset.n_frames, 6);
    let view = &dataset.views[2];
    assert_eq!((view.camera.width, view.camera.height), (2 * W, 2 * H));
    assert!((view.time - 0.8).abs() < 1e-6, "{}", view.time);
    // Without scene.json the world is the files'.
    let position = large(4).position();
    for axis in 0..3 {
        let got = view.camera.position()[axis];
        assert!(
            (got - position[axis] / SCALE - CENTER[axis]).abs() < 1e-9,
            "{got}"
        );
    }
}

#[test]
fn what_is_listed_to_train_on_and_to_test_with_is_only_tested_with() {
    let held_out = |train: &[usize], val: &[usize]| {
        let fixture = capture();
        let ids = |list: &[usize]| -> Vec<String> {
            list.iter()
                .map(|index| format!("{:06}", index * 10))
                .collect()
        };
        let lists = json!({"train_ids": ids(train), "val_ids": ids(val)});
        fixture.write("dataset.json", lists.to_string());
        let dataset = fixture.load().expect("loads");
        let test = dataset.views_of(Partition::Test);
        test.map(|view| view.name.clone()).collect::<Vec<_>>()
    };
    assert_eq!(held_out(&[0, 1, 2, 3], &[1, 4]), ["000010", "000040"]);
    // With nothing else to train on, they are trained on.
    assert_eq!(held_out(&[0, 1], &[0, 1, 5]), ["000050"]);
}

#[test]
fn without_validation_ids_every_eighth_is_held_out() {
    let fixture = capture();
    fixture.write(
        "dataset.json",
        json!({"ids": ["000000", "000010", "000020"]}).to_string(),
    );
    let dataset = fixture.load().expect("loads");
    let splits: Vec<Partition> = dataset.views.iter().map(|view| view.partition).collect();
    assert_eq!(
        splits,
        [Partition::Test, Partition::Train, Partition::Train]
    );
}

#[test]
fn lenses_are_undone_and_the_older_key_is_known() {
    let fixture = capture();
    let mut file = stated(0);
    file["radial_distortion"] = json!([1.0, 0.0, 0.0]);
    fixture.write("camera/000000.json", file.to_string());
    let zoomed = fixture.load().expect("loads").views[0].camera.fx;
    assert!(zoomed > 9.0 && zoomed < 18.0, "{zoomed}");
    let mut file = stated(0);
    let object = file.as_object_mut().expect("an object");
    object.remove("tangential_distortion");
    object.insert("tangential".into(), json!([0.5, 0.0]));
    fixture.write("camera/000000.json", file.to_string());
    let zoomed = fixture.load().expect("loads").views[0].camera.fx;
    assert!(zoomed > 9.0 && zoomed < 18.0, "{zoomed}");
}

#[test]
fn malformed_files_are_named() {
    let fixture = capture();
    for (key, value, word) in [
        ("skew", json!(3.0), "skew 3"),
        ("focal_length", json!(0.0), "focal lengths 0"),
        ("image_size", json!([7.5, 6]), "7.5"),
        ("image_size", json!([2 * W, 3 * H]), "8x6"),
        ("image_size", json!([W, H]), "9, 6 for 8x6"),
        (
            "principal_point",
            json!([9.0, 1.0]),
            "the middle of pictures",
        ),
        ("radial_distortion", json!([0, 0, 0, 0]), "at most 3 radial"),
        (
            "orientation",
            json!([[1, 0, 0], [0, 1, 0], [0, 0, -1]]),
            "mirrored",
        ),
        ("orientation", json!([[1, 0, 0], [0, 1, 0]]), "line"),
    ] {
        let mut file = stated(0);
        file[key] = value;
        fixture.write("camera/000000.json", file.to_string());
        fixture.refuses(&["000000", word]);
    }
    fixture.write("camera/000000.json", stated(0).to_string());
    for id in ["../000000", "/etc/passwd", ""] {
        fixture.write("dataset.json", json!({"train_ids": [id]}).to_string());
        fixture.write("metadata.json", json!({id: {"warp_id": 0}}).to_string());
        fixture.refuses(&["dataset.json"]);
    }
    let fixture = capture();
    fixture.write(
        "dataset.json",
        json!({"train_ids": ["000000", "x"]}).to_string(),
    );
    fixture.refuses(&["metadata.json", "`x`"]);
    fixture.write("dataset.json", json!({"train_ids": []}).to_string());
    fixture.refuses(&["dataset.json", "at least one id"]);
    let fixture = capture();
    fixture.write(
        "scene.json",
        json!({"scale": 0.0, "center": [0, 0, 0]}).to_string(),
    );
    fixture.refuses(&["scene.json", "positive"]);
    fixture.write(
        "scene.json",
        json!({"scale": 1.0, "center": [0, 0, 0]}).to_string(),
    );
    fixture.remove("rgb/2x/000030.png");
    fixture.refuses(&["dataset.json", "000030"]);
}

#[test]
fn broken_images_are_named_or_left_out() {
    let fixture = capture();
    fixture.write("rgb/2x/000020.png", "damaged");
    fixture.refuses(&["000020.png"]);
    let skipping = LoadOptions {
        skip_broken: true,
        ..LoadOptions::default()
    };
    let dataset = fixture.load_with(&skipping).expect("five are left");
    assert_eq!((dataset.views.len(), dataset.n_frames), (5, 3));
    assert!(dataset.views.iter().all(|view| view.name != "000020"));
    for index in 0..6 {
        fixture.write(&format!("rgb/2x/{:06}.png", index * 10), "");
    }
    let none = LoadOptions {
        test_cameras: Some(vec![0]),
        ..skipping
    };
    let error = fixture.load_with(&none).expect_err("nothing is left");
    assert!(error.to_string().contains("dataset.json"), "{error}");
}

#[test]
fn truncated_files_are_errors() {
    let fixture = capture();
    for (name, step) in [
        ("dataset.json", 3),
        ("metadata.json", 5),
        ("scene.json", 1),
        ("points.npy", 3),
        ("camera/000000.json", 5),
        ("rgb/2x/000000.png", 3),
    ] {
        fixture.survives_truncation(name, step);
    }
}

/// One file of the captures themselves.
#[test]
fn a_published_camera_is_read() {
    let Some(path) = real_capture("hypernerf_camera.json") else {
        return;
    };
    let bytes = std::fs::read(&path).expect("a file");
    let file: super::super::poses::nerfies::CameraFile =
        serde_json::from_slice(&bytes).expect("a camera");
    let (camera, distortion) = file.camera(&path, |position| position).expect("sound");
    assert_eq!((camera.width, camera.height), (2448, 3264));
    assert!((camera.fy / camera.fx - 1.001_061_237_772_971_7).abs() < 1e-12);
    assert!((camera.forward()[2] + 0.916_893_090_302_165_6).abs() < 1e-6);
    assert!((camera.position()[1] + 3.264_288_588_749_180_6).abs() < 1e-9);
    // The parser of JSON numbers may be off by the last bit.
    assert!((distortion.k[0] - 0.100_424_435_561_285_97).abs() < 1e-15);
    assert!((distortion.k[1] + 0.209_085_083_965_117_07).abs() < 1e-15);
    assert!((distortion.p[0] - 0.001_109_850_269_091_041).abs() < 1e-15);
    assert!((distortion.p[1] + 2.573_327_879_777_951_6e-5).abs() < 1e-15);
}
