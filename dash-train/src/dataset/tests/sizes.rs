use serde_json::json;

use dash_kernels::Camera;

use super::super::LoadOptions;
use super::blender::{frame, single, write_single};
use super::colmap;
use crate::test_kit::{H, W, assert_cameras_equal, camera};

#[test]
fn images_of_transforms_at_another_size_scale_the_intrinsics() {
    let fixture = single(3, json!({"fl_x": 18.0, "w": 2 * W, "h": 2 * H}));
    for view in &fixture.load().expect("loads").views {
        assert_cameras_equal(&view.camera, &camera(view.camera_index));
    }
    // A damaged image is left out where that is asked for, as before.
    fixture.write("images/1.png", "damaged");
    fixture.refuses(&["1.png"]);
    let skipping = LoadOptions {
        skip_broken: true,
        ..LoadOptions::default()
    };
    let dataset = fixture.load_with(&skipping).expect("two are left");
    assert_eq!(dataset.views.len(), 2);
}

#[test]
fn intrinsics_without_a_size_are_those_of_the_pictures_or_scaled_or_refused() {
    let angle = |half: f64| 2.0 * (half / 9.0).atan();
    for top in [
        json!({"fl_x": 9.0, "cx": 4.0, "cy": 3.0}),
        // Of pictures twice and half as large.
        json!({"fl_x": 18.0, "cx": 8.0, "cy": 6.0}),
        json!({"fl_x": 4.5, "fl_y": 4.5, "cx": 2.0, "cy": 1.5}),
        // Angles are of pictures of any size.
        json!({"camera_angle_x": angle(4.0), "cx": 8.0, "cy": 6.0}),
        json!({"camera_angle_y": angle(3.0)}),
    ] {
        let fixture = single(3, top);
        for view in &fixture.load().expect("loads").views {
            assert_cameras_equal(&view.camera, &camera(view.camera_index));
        }
    }
    // Somewhat off the middle is taken as it is.
    let top = json!({"fl_x": 9.0, "cx": 4.75, "cy": 2.75});
    let views = single(2, top).load().expect("loads").views;
    let expected = Camera {
        cx: 4.75,
        cy: 2.75,
        ..camera(1)
    };
    assert_cameras_equal(&views[1].camera, &expected);
    for (top, found) in [
        (json!({"fl_x": 9.0, "cx": 8.0, "cy": 3.0}), "8, 3 in frame"),
        (json!({"fl_x": 9.0, "cy": 0.5}), "4, 0.5 in frame"),
    ] {
        let fixture = single(2, top);
        fixture.refuses(&["transforms.json", "the 8x6 pictures", found, "`w` and `h`"]);
    }
}

#[test]
fn turned_photographs_are_named_as_such() {
    let fixture = single(2, json!({"fl_x": 9.0, "w": W, "h": H}));
    fixture.remove("images/1.png");
    fixture.image("images/1.jpg", H, W, [0; 3]);
    let whole = std::fs::read(fixture.path("images/1.jpg")).expect("fixture file");
    let mut frames = json!([frame("images/0", 0.0, 0), frame("images/1", 0.0, 1)]);
    let frames = frames.as_array_mut().expect("an array");
    write_single(&fixture, json!({"fl_x": 9.0, "w": W, "h": H}), frames);
    let message = fixture.refuses(&["1.jpg", "8x6", "6x8"]);
    assert!(!message.contains("EXIF"), "{message}");
    for (orientation, is_named) in [(1u8, false), (3, false), (6, true), (8, true)] {
        // A TIFF header and one entry: tag 0x0112, one 16-bit number.
        let mut exif =
            b"\xff\xe1\x00\x22Exif\0\0II*\0\x08\0\0\0\x01\0\x12\x01\x03\0\x01\0\0\0".to_vec();
        exif.extend([orientation, 0, 0, 0, 0, 0, 0, 0]);
        let bytes = [&whole[..2], &exif, &whole[2..]].concat();
        fixture.write("images/1.jpg", bytes);
        let message = fixture.refuses(&["1.jpg", "6x8"]);
        let words = format!("(EXIF orientation {orientation}: rotate the file)");
        assert_eq!(message.contains(&words), is_named, "{message}");
    }
}

#[test]
fn images_of_a_model_at_another_size_scale_its_intrinsics() {
    let fixture = colmap::capture("sparse/0");
    fixture.image("images/b.png", 4 * W, 4 * H, [0; 3]);
    let views = fixture.load().expect("loads").views;
    assert_cameras_equal(&views[0].camera, &colmap::expected_camera());
    assert_cameras_equal(
        &views[1].camera,
        &colmap::expected_camera().resized(4 * W, 4 * H),
    );
    // The lens is undone at each image's own size.
    let opencv = [9.0, 9.0, 4.0, 3.0, 1.0, 0.0, 0.0, 0.0];
    fixture.write("sparse/0/cameras.bin", colmap::cameras_bin(4, &opencv));
    let views = fixture.load().expect("loads").views;
    let [small, large] = [0, 1].map(|index| views[index].camera.fx);
    assert!((large / small - 4.0).abs() < 0.5, "{small} {large}");
    // Whatever is decoded later, a size that can't be told is refused at once.
    fixture.image("images/b.png", H, W, [0; 3]);
    let options = LoadOptions {
        on_demand: true,
        ..LoadOptions::default()
    };
    let error = fixture.load_with(&options).expect_err("turned").to_string();
    assert!(error.contains("b.png") && error.contains("6x8"), "{error}");
}
