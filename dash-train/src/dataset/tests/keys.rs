//! Keys of `transforms.json` that say something of pixels and poses.

use dash_kernels::Camera;
use serde_json::{Value, json};

use super::blender::{matrix, single, write_single};
use super::colmap::points_bin;
use crate::ply::{PointCloud, write_points};
use crate::test_kit::{Fixture, H, W, camera};

/// Two images with detail, so that an undone lens is seen in their pixels; further keys of the file and of a frame.
fn capture(top: Value, frame: Value) -> Fixture {
    let fixture = Fixture::new();
    let frames: Vec<Value> = (0..2)
        .map(|index| {
            let name = format!("images/{index}.png");
            image::RgbImage::from_fn(W as u32, H as u32, |x, y| {
                image::Rgb([
                    (40 * x % 250) as u8,
                    (60 * y % 250) as u8,
                    (33 * (x + y) % 250) as u8,
                ])
            })
            .save(fixture.path(&name))
            .expect("fixture image");
            merged(
                json!({"file_path": name, "transform_matrix": matrix(&camera(index))}),
                &frame,
            )
        })
        .collect();
    let shared = json!({"fl_x": 9.0, "fl_y": 9.0, "cx": 4.0, "cy": 3.0, "w": W, "h": H});
    write_single(&fixture, merged(shared, &top), &frames);
    fixture
}

fn merged(mut into: Value, from: &Value) -> Value {
    for (key, value) in from.as_object().expect("an object") {
        into[key] = value.clone();
    }
    into
}

/// The cameras and pixels of a capture.
fn seen(fixture: &Fixture) -> Vec<(Camera, Vec<f32>)> {
    let views = fixture.load().expect("loads").views;
    let pixels = |view: &super::super::View| view.rgb([0.0; 3]).expect("in memory").to_vec();
    views
        .iter()
        .map(|view| (view.camera.clone(), pixels(view)))
        .collect()
}

#[test]
fn lists_of_distortion_are_as_single_coefficients() {
    let none = seen(&capture(json!({}), json!({})));
    let keys = json!({"k1": 0.2, "k2": 0.05, "k3": 0.01, "k4": -0.002, "p1": 0.01, "p2": -0.02});
    let list = json!({"distortion_params": [0.2, 0.05, 0.01, -0.002, 0.01, -0.02]});
    let expected = seen(&capture(keys.clone(), json!({})));
    assert_ne!(expected, none, "the lens is undone");
    for (name, top, frame) in [
        ("a list of the file", list.clone(), json!({})),
        ("a list of a frame", json!({}), list.clone()),
        ("single ones of a frame", json!({}), keys.clone()),
        ("both, which agree", keys.clone(), list.clone()),
        ("both in one place", merged(keys.clone(), &list), json!({})),
        (
            "a frame's list before the file's",
            json!({"distortion_params": [0.1, 0, 0, 0, 0, 0]}),
            list.clone(),
        ),
        (
            "a frame's list before the file's coefficients",
            json!({"k1": -0.1, "p2": 0.3}),
            list.clone(),
        ),
        (
            "a frame's coefficients beside the file's list",
            json!({"distortion_params": [0.3, 0.05, 0.01, -0.002, 0.01, 0.5]}),
            json!({"k1": 0.2, "p2": -0.02}),
        ),
    ] {
        assert_eq!(seen(&capture(top, frame)), expected, "{name}");
    }
    for (name, value) in [
        ("zeros", json!([0, 0, 0, 0, 0, 0])),
        ("zeros of another lens", json!(vec![0; 12])),
        ("nothing", json!([])),
        ("null", json!(null)),
    ] {
        assert_eq!(
            seen(&capture(json!({"distortion_params": value}), json!({}))),
            none,
            "{name}"
        );
    }
}

#[test]
fn lists_of_distortion_that_can_not_be_meant_are_refused() {
    for (value, words) in [
        (
            json!([0.1, 0.2, 0.0, 0.0]),
            &["distortion_params", "4 numbers", "images/0.png"][..],
        ),
        (
            json!([0.1, 0.2, 0.0, 0.0, 0.0]),
            &["distortion_params", "5 numbers"],
        ),
        (
            json!([0.1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0]),
            &["12 numbers"],
        ),
        (json!("0.1 0.2"), &["transforms.json", "string"]),
        (json!({"k1": 0.1}), &["transforms.json", "map"]),
        (json!([f64::INFINITY, 0, 0, 0, 0, 0]), &["transforms.json"]),
    ] {
        for [top, frame] in [
            [json!({"distortion_params": value}), json!({})],
            [json!({}), json!({"distortion_params": value})],
        ] {
            // Infinity is null in JSON, which is no number.
            capture(top, frame).refuses(words);
        }
    }
    let differ = json!({"k1": 0.2, "distortion_params": [0.1, 0, 0, 0, 0, 0]});
    capture(differ, json!({})).refuses(&["others than k1 to p2"]);
}

#[test]
fn fields_of_view_in_degrees_are_focal_lengths() {
    let degrees = |side: usize| (2.0 * (side as f64 / 2.0 / 9.0).atan()).to_degrees();
    for top in [
        json!({"x_fov": degrees(W)}),
        json!({"y_fov": degrees(H)}),
        json!({"x_fov": degrees(W), "y_fov": degrees(H)}),
        json!({"camera_angle_x": degrees(W).to_radians(), "x_fov": 170.0}),
        json!({"fl_x": 9.0, "x_fov": 170.0}),
    ] {
        let views = single(2, top.clone()).load().expect("loads").views;
        let camera = &views[0].camera;
        assert!(
            (camera.fx - 9.0).abs() < 1e-9 && (camera.fy - 9.0).abs() < 1e-9,
            "{top}: {camera:?}"
        );
    }
}

#[test]
fn what_can_not_be_followed_is_refused_with_file_key_and_place() {
    for (key, value) in [
        ("rolling_shutter", json!([0.0, 0.0, 0.5, 0.0])),
        ("fisheye_crop_radius", json!(3.0)),
        ("white_transparent", json!(true)),
        ("k6", json!(0.1)),
        ("camera_type", json!("equirectangular")),
        ("is_fisheye", json!(true)),
    ] {
        let with = || json!({key: value.clone()});
        capture(with(), json!({})).refuses(&["transforms.json", key]);
        capture(json!({}), with()).refuses(&["transforms.json", key, "images/0.png"]);
    }
    let scaled = json!({"applied_scale": 2.0, "ply_file_path": "points.ply"});
    capture(scaled, json!({})).refuses(&["applied_scale", "points.ply"]);
}

#[test]
fn what_was_applied_to_the_poses_changes_nothing() {
    let plain = seen(&capture(json!({}), json!({})));
    for top in [
        json!({"applied_transform": [[1, 0, 0, 5], [0, 0, 1, 0], [0, -1, 0, 0]]}),
        json!({"applied_scale": 0.1}),
        json!({"orientation_override": "up", "aabb_scale": 16, "scale": 0.5, "offset": [1, 2, 3]}),
        json!({"camera_model": "OPENCV", "n_frames": 1}),
        json!({"is_fisheye": false, "k1": 0.0, "rolling_shutter": [0, 0, 0, 0]}),
    ] {
        assert_eq!(seen(&capture(top.clone(), json!({}))), plain, "{top}");
    }
}

#[test]
fn points_of_a_model_follow_the_poses_that_were_made_from_it() {
    let applied = json!({"applied_transform": [[1, 0, 0, 5], [0, 0, 1, 0], [0, -1, 0, 0.5]]});
    let first = |fixture: &Fixture| {
        let points = fixture.load().expect("loads").points;
        points.map(|points| points.positions[0])
    };
    for folder in ["colmap/sparse/0", "sparse/0"] {
        let fixture = capture(applied.clone(), json!({}));
        let points = points_bin(&[[1.0, 2.0, 3.0]]);
        fixture.write(&format!("{folder}/points3D.bin"), points);
        assert_eq!(first(&fixture), Some([6.0, 3.0, -1.5]), "{folder}");
        // A file that is known by its name has it already.
        let ply = PointCloud {
            positions: vec![[7.0, 8.0, 9.0]],
            colors: vec![[1, 2, 3]],
        };
        write_points(&fixture.path("sparse_pc.ply"), &ply).expect("writes");
        assert_eq!(first(&fixture), Some([7.0, 8.0, 9.0]));
    }
    // Nothing tells where they are.
    let scaled = json!({"applied_transform": [[1, 0, 0, 5], [0, 0, 1, 0], [0, -1, 0, 0]], "applied_scale": 0.5});
    for top in [json!({"applied_transform": "turned"}), scaled] {
        let fixture = capture(top, json!({}));
        fixture.write("sparse/0/points3D.bin", points_bin(&[[1.0, 2.0, 3.0]]));
        assert_eq!(first(&fixture), None);
    }
}
