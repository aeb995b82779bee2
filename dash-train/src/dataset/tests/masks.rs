use serde_json::json;

use super::super::{Dataset, LoadOptions, Partition};
use super::blender::{file, frame, matrix, single, write_single};
use super::nerfies;
use crate::test_kit::{Fixture, H, W, camera, write_model};

/// A mask whose left half counts, or its right half.
fn half(fixture: &Fixture, name: &str, left: bool) {
    let shade = |x| if (x < W as u32 / 2) == left { 255 } else { 0 };
    image::GrayImage::from_fn(W as u32, H as u32, |x, _| image::Luma([shade(x)]))
        .save(fixture.path(name))
        .expect("writes");
}

/// For each view the weights of its first and last pixel, where it has a mask.
fn counted(dataset: &Dataset) -> Vec<Option<[f32; 2]>> {
    let of = |view: &super::super::View| {
        let counted = view.rgb_and_counted([0.0; 3]).expect("reads").1?;
        Some([counted[0], counted[W * H - 1]])
    };
    dataset.views.iter().map(of).collect()
}

#[test]
fn masks_that_frames_name_are_read_before_those_in_the_folder() {
    let fixture = single(4, json!({"fl_x": 9.0}));
    let entry = |index: usize, mask: serde_json::Value| {
        json!({
            "file_path": format!("images/{index}.png"),
            "transform_matrix": matrix(&camera(index)),
            "mask_path": mask,
        })
    };
    let frames = [
        entry(0, json!("masks/0.png")),
        entry(1, json!("elsewhere\\1.png")),
        // Not there, outside, no name: as if none were named.
        entry(2, json!("masks/2.png")),
        entry(3, json!(7)),
    ];
    write_single(&fixture, json!({"fl_x": 9.0}), &frames);
    half(&fixture, "masks/0.png", true);
    half(&fixture, "masks/images/0.png", false);
    half(&fixture, "elsewhere/1.png", true);
    half(&fixture, "masks/images/3.png", false);
    let (left, right) = (Some([1.0, 0.0]), Some([0.0, 1.0]));
    let dataset = fixture.load().expect("loads");
    assert_eq!(counted(&dataset), [left, left, None, right]);
    let inverted = LoadOptions {
        invert_masks: true,
        ..LoadOptions::default()
    };
    let dataset = fixture.load_with(&inverted).expect("loads");
    assert_eq!(counted(&dataset), [right, right, None, left]);
}

#[test]
fn masks_may_be_called_as_colmap_calls_them() {
    let fixture = Fixture::new();
    write_model(
        &fixture,
        "sparse/0",
        &[
            ("cam00.png", camera(0)),
            ("cam01.jpg", camera(1)),
            ("cam02.png", camera(2)),
        ],
    );
    for name in ["cam00.png", "cam01.jpg", "cam02.png"] {
        fixture.image(&format!("images/{name}"), W, H, [9; 3]);
    }
    half(&fixture, "masks/cam00.png.png", true);
    half(&fixture, "masks/cam01.jpg.png", true);
    half(&fixture, "masks/cam02.png", false);
    half(&fixture, "masks/cam02.png.png", true);
    let dataset = fixture.load().expect("loads");
    let names: Vec<&str> = dataset.views.iter().map(|v| v.name.as_str()).collect();
    assert_eq!(names, ["cam00", "cam01", "cam02"]);
    let (left, right) = (Some([1.0, 0.0]), Some([0.0, 1.0]));
    assert_eq!(counted(&dataset), [left, left, right]);
}

#[test]
fn masks_of_zeros_and_ones_are_refused_by_name() {
    let fixture = Fixture::new();
    let frames = [frame("a.png", 0.0, 0), frame("b.png", 1.0, 1)];
    fixture.write("transforms_train.json", file(&frames).to_string());
    for name in ["a.png", "b.png"] {
        fixture.image(name, W, H, [9; 3]);
    }
    fixture.image("masks/b.png", W, H, [0; 3]);
    fixture.load().expect("black is a mask");
    fixture.image("masks/b.png", W, H, [1; 3]);
    fixture.refuses(&["masks/b.png", "(0 and 255)", "up to 1", "multiply by 255"]);
    // Also before anything is trained on images that are made on demand.
    let on_demand = LoadOptions {
        on_demand: true,
        ..LoadOptions::default()
    };
    let error = fixture.load_with(&on_demand).expect_err("labels");
    assert!(error.to_string().contains("masks/b.png"), "{error}");
}

#[test]
fn masks_of_what_moves_are_undistorted_as_their_pictures_are() {
    let fixture = single(2, json!({"fl_x": 72.0, "w": 64, "h": 48, "k1": 1.0}));
    let stripes = image::RgbImage::from_fn(64, 48, |x, _| {
        image::Rgb([if x / 4 % 2 == 0 { 255 } else { 0 }; 3])
    });
    for name in ["images/0.png", "images/1.png", "motion_masks/images/0.png"] {
        stripes.save(fixture.path(name)).expect("writes");
    }
    for on_demand in [false, true] {
        let options = LoadOptions {
            on_demand,
            ..LoadOptions::default()
        };
        let dataset = fixture.load_with(&options).expect("loads");
        let view = dataset
            .views_of(Partition::Test)
            .next()
            .expect("one of two");
        let rgb = view.rgb([0.0; 3]).expect("reads");
        let white: Vec<bool> = rgb.iter().step_by(3).map(|&v| v > 0.5).collect();
        let mask = view.motion_mask().expect("reads").expect("a mask");
        let moves: Vec<bool> = mask.iter().map(|&v| v == 255).collect();
        assert_eq!(moves, white);
        let captured: Vec<bool> = stripes.pixels().map(|p| p.0[0] == 255).collect();
        assert_ne!(moves, captured, "the lens has moved pixels");
    }
}

#[test]
fn masks_may_be_of_another_size_than_their_pictures() {
    // Pictures are half as large as the cameras say, masks are not.
    let fixture = nerfies::capture();
    let (width, height) = (2 * W as u32, 2 * H as u32);
    let left_half = image::GrayImage::from_fn(width, height, |x, _| {
        image::Luma([if x < W as u32 { 255 } else { 0 }])
    });
    for name in ["masks/000000.png", "motion_masks/000010.png"] {
        left_half.save(fixture.path(name)).expect("writes");
    }
    let dataset = fixture.load().expect("loads");
    assert_eq!(counted(&dataset)[..2], [Some([1.0, 0.0]), None]);
    let view = dataset.views_of(Partition::Test).next().expect("held out");
    assert_eq!(view.name, "000010");
    let mask = view.motion_mask().expect("reads").expect("a mask");
    assert_eq!(mask[..W], [255, 255, 255, 255, 0, 0, 0, 0]);
    fixture.image("masks/000000.png", W, 2 * H, [255; 3]);
    fixture.refuses(&["masks/000000.png", "8x6", "8x12"]);
}
