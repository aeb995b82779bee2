use serde_json::json;

use super::*;

/// A file with these further keys at the top level and in its frame.
fn with(top: Value, frame: Value) -> Transforms {
    let mut file = json!({"fl_x": 9.0});
    let mut one = json!({"file_path": "a.png", "transform_matrix": []});
    for (into, from) in [(&mut file, top), (&mut one, frame)] {
        for (key, value) in from.as_object().expect("an object") {
            into[key] = value.clone();
        }
    }
    file["frames"] = json!([one.clone(), one]);
    serde_json::from_value(file).expect("parses")
}

#[test]
fn keys_are_listed_once() {
    let mut names: Vec<&str> = KEYS.iter().map(|(key, _)| *key).collect();
    names.sort_unstable();
    names.dedup();
    assert_eq!(names.len(), KEYS.len());
}

#[test]
fn keys_that_change_pixels_or_poses_are_refused_by_name() {
    for (key, value) in [
        ("rolling_shutter", json!([0, 0, 1e-3, 0])),
        ("rolling_shutter_time", json!(0.02)),
        ("transform_matrix_end", json!([[1, 0, 0, 1]])),
        ("ftheta_p0", json!(0.1)),
        ("latlong", json!(true)),
        ("equirectangular", json!(1)),
        ("fisheye_crop_radius", json!(700.5)),
        ("k5", json!(-1e-3)),
        ("skew", json!(0.5)),
        ("white_transparent", json!(true)),
        ("black_transparent", json!(true)),
        ("from_na", json!(true)),
        ("normal_mts_args", json!(["-k", 3])),
        ("camera_type", json!("spherical")),
        ("distortion_model", json!("equidistant")),
    ] {
        for [top, frame] in [
            [json!({key: value}), json!({})],
            [json!({}), json!({key: value})],
        ] {
            let error = with(top, frame).check_keys(Path::new("transforms.json"));
            let message = error.expect_err(key).to_string();
            assert!(message.contains(&format!("`{key}`")), "{message}");
        }
    }
}

#[test]
fn keys_that_change_nothing_pass_without_a_word() {
    let harmless = json!({
        "applied_transform": [[1, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0]], "applied_scale": 2.5,
        "orientation_override": "none", "aabb_scale": 16, "scale": 0.33, "offset": [0.5, 0.5, 0.5],
        "depth_file_path": "depth/a.png", "colmap_im_id": 3, "rotation": 0.0314,
        "rolling_shutter": [0, 0, 0, 0], "k5": 0.0, "white_transparent": false, "latlong": null,
        "camera_type": "PERSP", "distortion_model": "radtan", "notes": "taken in the rain", "take": 3,
        "focal_length_unit": "px", "shift_x": 0
    });
    for [top, frame] in [[harmless.clone(), json!({})], [json!({}), harmless]] {
        let file = with(top, frame);
        file.check_keys(Path::new("transforms.json"))
            .expect("harmless");
        assert_eq!(file.passed_over(), [""; 0]);
    }
}

#[test]
fn what_is_passed_over_is_told_once() {
    for (key, value) in [
        ("fx", json!(500.0)),
        ("K", json!([[500, 0, 320], [0, 500, 240], [0, 0, 1]])),
        ("focal_length", json!(35)),
        ("x_shift_px", json!(0.25)),
        ("distortion", json!([0.1, 0.0])),
        ("k7", json!(1e-4)),
        ("pixel_aspect_ratio", json!(1.1)),
        ("intrinsics", json!({"fx": 3, "fy": 4})),
        ("world_transform", json!([[1, 0, 0, 0]])),
        ("sharpen", json!(0.5)),
        ("envmap", json!("sky.exr")),
    ] {
        let told = with(json!({key: value}), json!({})).passed_over();
        assert_eq!(told.len(), 1, "{key}: {told:?}");
        assert!(
            told[0].starts_with(&format!("`{key}` is passed")),
            "{told:?}"
        );
        let told = with(json!({}), json!({key: value})).passed_over();
        assert_eq!(told.len(), 1, "{key}: {told:?}");
        assert!(
            told[0].starts_with(&format!("`{key}` of 2 frames")),
            "{told:?}"
        );
    }
}

#[test]
fn a_scale_beside_points_is_refused() {
    let points = |scale: f64| {
        with(
            json!({"applied_scale": scale, "ply_file_path": "p.ply"}),
            json!({}),
        )
    };
    let path = Path::new("transforms.json");
    points(1.0).check_keys(path).expect("no scale");
    let message = points(0.5)
        .check_keys(path)
        .expect_err("a scale")
        .to_string();
    assert!(
        message.contains("applied_scale` 0.5") && message.contains("p.ply"),
        "{message}"
    );
}
