//! What people and other programs write in place of what is meant.

use std::path::Path;

use serde_json::json;

use super::blender::{matrix, single, write_single};
use crate::dataset::pixels::decode_mask;
use crate::dataset::poses::transforms::parse;
use crate::test_kit::{Fixture, H, W, camera};

#[test]
fn angles_in_the_other_unit_are_refused() {
    // In degrees; the tangent of half of it is positive.
    single(4, json!({"camera_angle_x": 45.0})).refuses(&["radians", "45"]);
    single(4, json!({"camera_angle_x": 0.9, "camera_angle_y": 39.6})).refuses(&["radians", "39.6"]);
    single(4, json!({"x_fov": 190})).refuses(&["degrees", "190"]);
    single(4, json!({"camera_angle_x": 45.0, "fl_x": 9.0}))
        .load()
        .expect("an angle that is not used");
    let wide = single(4, json!({"x_fov": 95})).load().expect("a lens");
    let expected = W as f64 / 2.0 / 47.5f64.to_radians().tan();
    assert!((wide.views[0].camera.fx - expected).abs() < 1e-9);
}

#[test]
fn matrices_with_another_last_row_are_refused() {
    let written = |change: &dyn Fn(&mut Vec<Vec<f64>>)| {
        let fixture = single(4, json!({"fl_x": 9.0}));
        let frames = [0, 1, 2, 3].map(|index| {
            let rows = serde_json::from_value(matrix(&camera(index)));
            let mut rows: Vec<Vec<f64>> = rows.expect("a matrix");
            change(&mut rows);
            json!({"file_path": format!("images/{index}.png"), "transform_matrix": rows})
        });
        write_single(&fixture, json!({"fl_x": 9.0}), &frames);
        fixture
    };
    let transposed = written(&|rows| {
        let before = rows.clone();
        for (r, row) in rows.iter_mut().enumerate() {
            *row = before.iter().map(|other| other[r]).collect();
        }
    });
    transposed.refuses(&["rows and columns are exchanged", "images/0.png"]);
    written(&|rows| rows[3] = vec![0.0, 0.0, 0.0, 2.0]).refuses(&["last row"]);
    written(&|rows| rows.truncate(3))
        .load()
        .expect("three rows");
}

#[test]
fn masks_that_are_neither_black_nor_white_are_refused() {
    let with = |name: &str, values: [u8; 4]| {
        let fixture = single(4, json!({"fl_x": 9.0}));
        image::GrayImage::from_fn(W as u32, H as u32, |x, _| {
            image::Luma([values[x as usize % 4]])
        })
        .save(fixture.path(name))
        .expect("writes");
        fixture
    };
    with("masks/images/0.png", [0, 1, 2, 200]).refuses(&["labels: the grey values 0, 1, 2, 200"]);
    with("masks/images/0.png", [0, 3, 0, 90]).refuses(&["up to 90", "count as black"]);
    // What a soft border leaves of something that has nearly left the picture.
    let path = Path::new("sliver.png");
    let folder = tempfile::tempdir().expect("temporary folder");
    let mut sliver = image::GrayImage::new(64, 48);
    (0..20).for_each(|y| sliver.put_pixel(0, y, image::Luma([2 * y as u8 + 3])));
    sliver.save(folder.path().join(path)).expect("writes");
    decode_mask(&folder.path().join(path), (64, 48)).expect("a soft border");
    for values in [
        [0, 255, 0, 255],
        [0, 200, 0, 200],
        [0, 40, 200, 255],
        [0; 4],
    ] {
        let fixture = with("masks/images/0.png", values);
        fixture
            .load()
            .expect("a mask with a soft border, or one that is black");
    }
}

#[test]
fn pictures_that_could_be_transparent_and_are_not_have_no_background() {
    let with = |alpha: u8| {
        let fixture = single(4, json!({"fl_x": 9.0}));
        for index in 0..4 {
            image::RgbaImage::from_pixel(W as u32, H as u32, image::Rgba([9, 8, 7, 255]))
                .save(fixture.path(&format!("images/{index}.png")))
                .expect("writes");
        }
        let mut last =
            image::RgbaImage::from_pixel(W as u32, H as u32, image::Rgba([9, 8, 7, 255]));
        last.put_pixel(1, 1, image::Rgba([9, 8, 7, alpha]));
        last.save(fixture.path("images/3.png")).expect("writes");
        fixture.load().expect("loads")
    };
    let opaque = with(255);
    assert_eq!(opaque.background, None);
    assert!(
        opaque
            .views
            .iter()
            .all(|view| !view.has_alpha() && view.alpha().is_ok_and(|alpha| alpha.is_none()))
    );
    assert_eq!(
        opaque.views[0].rgb([0.0; 3]).expect("reads")[..3],
        [9.0 / 255.0, 8.0 / 255.0, 7.0 / 255.0]
    );
    assert_eq!(with(254).background, Some([1.0; 3]));
}

#[test]
fn a_single_frame_may_be_numbered_by_its_camera() {
    let fixture = Fixture::new();
    let names = ["cam00", "cam01", "cam02"];
    let frames: Vec<_> = names
        .iter()
        .enumerate()
        .map(|(index, name)| {
            fixture.image(&format!("images/{name}/0000_{name}.png"), W, H, [index as u8; 3]);
            json!({"file_path": format!("images\\{name}\\0000_{name}.png"), "fl_x": 9.0, "transform_matrix": matrix(&camera(index))})
        })
        .collect();
    write_single(&fixture, json!({}), &frames);
    let dataset = fixture.load().expect("loads");
    assert_eq!((dataset.n_cameras, dataset.n_frames), (3, 1));
}

#[test]
fn a_key_that_may_be_the_time_is_told() {
    let key = |key: &str, values: [f64; 3], time: Option<f64>| {
        let fixture = Fixture::new();
        let frames = values.map(|value| {
            let mut frame =
                json!({"file_path": "a.png", "transform_matrix": matrix(&camera(0)), key: value});
            if let Some(time) = time {
                frame["time"] = json!(time);
            }
            frame
        });
        write_single(&fixture, json!({"fl_x": 9.0}), &frames);
        let transforms = parse(&fixture.path("transforms.json")).expect("valid");
        transforms.key_like_time()
    };
    assert_eq!(key("timestamp", [0.0, 0.5, 1.0], None), Some("timestamp"));
    assert_eq!(key("frame", [0.0, 0.0, 1.0], None), Some("frame"));
    assert_eq!(key("timestamp", [7.0; 3], None), None);
    assert_eq!(key("timestamp", [0.0, 0.5, 1.0], Some(0.5)), None);
    assert_eq!(key("sharpness", [0.0, 0.5, 1.0], None), None);
}
