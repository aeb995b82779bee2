use super::super::{Layout, LoadOptions, Partition};
use super::n3dv::{IN_PLAIN_ORDER, row, rows};
use crate::test_kit::{Fixture, H, W, assert_cameras_equal, camera, npy_f64};

pub(super) fn capture(n: usize) -> Fixture {
    let fixture = Fixture::new();
    fixture.write("poses_bounds.npy", npy_f64(&rows(n)));
    for index in 0..n {
        fixture.image(&format!("images/IMG_{index}.png"), W, H, [index as u8; 3]);
    }
    fixture
}

#[test]
fn one_image_per_row_is_a_static_capture_with_every_eighth_held_out() {
    let dataset = capture(11).load().expect("loads");
    assert_eq!(dataset.layout, Layout::N3dv);
    assert_eq!((dataset.n_cameras, dataset.n_frames), (11, 1));
    for (index, view) in dataset.views.iter().enumerate() {
        // As LLFF's tools sort them: IMG_10 before IMG_2.
        let number = IN_PLAIN_ORDER[index];
        assert_eq!(view.name, format!("IMG_{number}"));
        assert_cameras_equal(&view.camera, &camera(index));
        assert_eq!(view.rgb([0.0; 3]).expect("reads")[0], number as f32 / 255.0);
        assert_eq!(view.partition == Partition::Test, index % 8 == 0);
    }
}

#[test]
fn images_of_another_size_scale_the_intrinsics() {
    let fixture = capture(2);
    let large: Vec<_> = (0..2)
        .map(|i| row(&camera(i).resized(4 * W, 4 * H)))
        .collect();
    fixture.write("poses_bounds.npy", npy_f64(&large));
    assert_cameras_equal(&fixture.load().expect("loads").views[1].camera, &camera(1));
    fixture.image("images/IMG_1.png", H, W, [0; 3]);
    fixture.refuses(&["IMG_1.png", "32x24", "6x8"]);
}

#[test]
fn counts_that_differ_name_both_and_broken_images_are_named_or_left_out() {
    let fixture = capture(3);
    fixture.remove("images/IMG_1.png");
    fixture.refuses(&["images", "3 of them", "2 (IMG_0, IMG_2)"]);
    fixture.write("images/IMG_1.png", "");
    fixture.refuses(&["IMG_1.png"]);
    let skipping = LoadOptions {
        skip_broken: true,
        ..LoadOptions::default()
    };
    let views = fixture.load_with(&skipping).expect("two are left").views;
    let names: Vec<&str> = views.iter().map(|view| view.name.as_str()).collect();
    assert_eq!(names, ["IMG_0", "IMG_2"]);
    assert_cameras_equal(&views[1].camera, &camera(2));
}

#[test]
fn truncated_files_are_errors() {
    let fixture = capture(2);
    fixture.survives_truncation("poses_bounds.npy", 7);
    fixture.survives_truncation("images/IMG_1.png", 1);
}
