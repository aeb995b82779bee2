use dash_kernels::Camera;

use super::super::{Layout, LoadOptions, Partition};
use crate::dataset::poses::known as known_poses;
use crate::ply::{PointCloud, write_points};
use crate::test_kit::{
    Fixture, H, W, assert_cameras_equal, axis, camera, negated, npy, npy_f64, write_model,
};

/// Eleven numbers by the plain order of `cam0`, `cam1`, `cam10`, `cam2`, ..
pub(super) const IN_PLAIN_ORDER: [usize; 11] = [0, 1, 10, 2, 3, 4, 5, 6, 7, 8, 9];

/// The LLFF row of a camera: columns down, right, backwards, position, (height, width, focal).
pub(super) fn row(camera: &Camera) -> [f64; 17] {
    let columns = [
        axis(camera, 1),
        axis(camera, 0),
        negated(axis(camera, 2)),
        camera.position(),
        [camera.height as f64, camera.width as f64, camera.fx],
    ];
    let mut row = [0.5; 17];
    for (c, column) in columns.iter().enumerate() {
        for (r, value) in column.iter().enumerate() {
            row[5 * r + c] = *value;
        }
    }
    row
}

pub(super) fn rows(n: usize) -> Vec<[f64; 17]> {
    (0..n).map(|index| row(&camera(index))).collect()
}

/// Shade of a frame, so that mixed-up images are noticed.
fn shade(camera: usize, frame: usize) -> [u8; 3] {
    [10 + camera as u8, 100 + frame as u8, 7]
}

fn rig(n_cameras: usize, n_frames: usize) -> Fixture {
    let fixture = Fixture::new();
    fixture.write("poses_bounds.npy", npy_f64(&rows(n_cameras)));
    for camera in 0..n_cameras {
        for frame in 0..n_frames {
            fixture.image(
                &format!("cam{camera}/images/{frame:04}.png"),
                W,
                H,
                shade(camera, frame),
            );
        }
    }
    fixture
}

fn point() -> PointCloud {
    PointCloud {
        positions: vec![[1.0, 2.0, 3.0]],
        colors: vec![[4, 5, 6]],
    }
}

#[test]
fn cameras_times_and_images_are_exact() {
    let fixture = rig(11, 3);
    write_points(&fixture.path("points3D_downsample2.ply"), &point()).expect("writes");
    let dataset = fixture.load().expect("loads");
    assert_eq!(dataset.layout, Layout::N3dv);
    assert_eq!(
        (dataset.n_cameras, dataset.n_frames, dataset.views.len()),
        (11, 3, 33)
    );
    assert_eq!((dataset.background, dataset.points), (None, Some(point())));
    for (index, view) in dataset.views.iter().enumerate() {
        let (camera_index, frame) = (index / 3, index % 3);
        // Ten cameras or more: rows are in plain order, cam10 before cam2.
        let number = IN_PLAIN_ORDER[camera_index];
        assert_cameras_equal(&view.camera, &camera(camera_index));
        assert_eq!((view.camera_index, view.frame), (camera_index, frame));
        assert_eq!(view.time, [0.0, 0.5, 1.0][frame]);
        assert_eq!(view.camera_name, format!("cam{number}"));
        assert_eq!(view.name, format!("cam{number}/{frame:04}"));
        assert_eq!(
            view.partition,
            if camera_index == 0 {
                Partition::Test
            } else {
                Partition::Train
            }
        );
        let rgb = view.rgb([0.0; 3]).expect("in memory");
        assert_eq!(rgb.len(), W * H * 3);
        assert_eq!(rgb[..3], shade(number, frame).map(|v| f32::from(v) / 255.0));
    }
}

#[test]
fn frames_may_lie_in_the_camera_folder_itself_and_a_single_one_is_static() {
    let fixture = Fixture::new();
    fixture.write("poses_bounds.npy", npy_f64(&rows(2)));
    for camera in 0..2 {
        fixture.image(&format!("cam0{camera}/0007.jpg"), W, H, shade(camera, 0));
    }
    let dataset = fixture.load().expect("loads");
    assert_eq!(
        (
            dataset.n_frames,
            dataset.views.len(),
            dataset.points.is_none()
        ),
        (1, 2, true)
    );
    assert!(dataset.is_static() && dataset.views.iter().all(|view| view.time == 0.0));
}

#[test]
fn frames_of_another_size_scale_the_intrinsics_but_not_another_shape() {
    let fixture = Fixture::new();
    let large: Vec<_> = (0..2)
        .map(|i| row(&camera(i).resized(4 * W, 4 * H)))
        .collect();
    fixture.write("poses_bounds.npy", npy_f64(&large));
    for index in 0..2 {
        fixture.image(&format!("cam{index}/0.png"), W, H, [0; 3]);
    }
    assert_cameras_equal(&fixture.load().expect("loads").views[1].camera, &camera(1));

    fixture.image("cam1/0.png", H, W, [0; 3]);
    fixture.refuses(&["cam1", "0.png", "32x24", "6x8"]);
}

#[test]
fn dropped_cameras_are_neither_trained_on_nor_tested_with() {
    let fixture = rig(4, 3);
    // A frame that only the dropped camera lacks is no fault.
    fixture.remove("cam2/images/0001.png");
    let dropping = |names: &[&str]| LoadOptions {
        drop_cameras: names.iter().map(ToString::to_string).collect(),
        ..LoadOptions::default()
    };
    let dataset = fixture.load_with(&dropping(&["cam2"])).expect("loads");
    assert_eq!((dataset.n_cameras, dataset.n_frames), (3, 3));
    let cameras: Vec<_> = (0..3).map(|i| &dataset.views[3 * i]).collect();
    let found: Vec<_> = cameras
        .iter()
        .map(|view| (view.camera_name.as_str(), view.camera_index))
        .collect();
    assert_eq!(found, [("cam0", 0), ("cam1", 1), ("cam3", 2)]);
    // Poses stay with their cameras.
    assert_cameras_equal(&cameras[2].camera, &camera(3));
    assert_eq!(cameras[0].partition, Partition::Test);
    for wrong in [&["cam7"][..], &["cam0", "cam1", "cam2", "cam3"]] {
        let error = fixture.load_with(&dropping(wrong)).expect_err("refused");
        let message = error.to_string();
        assert!(message.contains("--drop-cameras"), "{message}");
        assert!(message.contains("cam0, cam1, cam2, cam3"), "{message}");
    }
}

#[test]
fn options_choose_size_frames_and_test_cameras() {
    let fixture = rig(3, 7);
    let options = LoadOptions {
        downscale: 1.6,
        frame_stride: 2,
        max_frames: Some(3),
        test_cameras: Some(vec![2, 1]),
        threads: Some(1),
        ..LoadOptions::default()
    };
    let dataset = fixture.load_with(&options).expect("loads");
    assert_eq!((dataset.n_frames, dataset.views.len()), (3, 9));
    let names: Vec<_> = dataset.views[..3]
        .iter()
        .map(|v| (v.name.as_str(), v.frame, v.time))
        .collect();
    assert_eq!(
        names,
        [
            ("cam0/0000", 0, 0.0),
            ("cam0/0002", 1, 0.5),
            ("cam0/0004", 2, 1.0)
        ]
    );
    assert_eq!(dataset.views_of(Partition::Train).count(), 3);
    assert_cameras_equal(&dataset.views[3].camera, &camera(1).resized(5, 4));
    assert_eq!(
        dataset.views[3].rgb([0.0; 3]).expect("in memory").len(),
        5 * 4 * 3
    );
    assert_eq!(dataset.image_bytes(), 9 * 5 * 4 * 3);

    let out_of_range = LoadOptions {
        test_cameras: Some(vec![3]),
        ..LoadOptions::default()
    };
    let message = fixture
        .load_with(&out_of_range)
        .expect_err("no camera 3")
        .to_string();
    assert!(
        message.contains("--test-cameras") && message.contains("0 to 2"),
        "{message}"
    );
    let all = LoadOptions {
        test_cameras: Some(vec![0, 1, 2]),
        ..LoadOptions::default()
    };
    let message = fixture
        .load_with(&all)
        .expect_err("nothing to train on")
        .to_string();
    assert!(message.contains("train"), "{message}");
    let small = LoadOptions {
        memory: Some(1000),
        ..LoadOptions::default()
    };
    let message = fixture
        .load_with(&small)
        .expect_err("over budget")
        .to_string();
    assert!(
        message.contains("--memory") && message.contains("1000 bytes"),
        "{message}"
    );
}

#[test]
fn a_single_camera_is_trained_on_unless_it_is_to_be_held_out() {
    let fixture = rig(1, 2);
    let dataset = fixture.load().expect("loads");
    assert_eq!(dataset.views_of(Partition::Train).count(), 2);
    let held_out = LoadOptions {
        test_cameras: Some(vec![0]),
        ..LoadOptions::default()
    };
    let message = fixture.load_with(&held_out).expect_err("none").to_string();
    for word in ["train", "1 camera", "--test-cameras"] {
        assert!(message.contains(word), "{message}");
    }
}

#[test]
fn inconsistent_rigs_name_the_camera_and_both_counts() {
    let fixture = rig(3, 4);
    fixture.write("poses_bounds.npy", npy_f64(&rows(4)));
    fixture.refuses(&["poses_bounds.npy, 4", "found 3 (cam0, cam1, cam2)"]);
    fixture.write("poses_bounds.npy", npy_f64(&rows(3)));

    fixture.remove("cam1/images/0002.png");
    fixture.refuses(&["cam1", "4 frames", "found 3", "cam0"]);
    fixture.image("cam1/images/0009.png", W, H, [0; 3]);
    fixture.refuses(&["cam1", "0002", "0003"]);
    fixture.remove("cam1/images/0009.png");
    fixture.image("cam1/images/0003.jpg", W, H, [0; 3]);
    fixture.refuses(&["cam1", "0003", "duplicate"]);
    fixture.remove("cam1/images/0003.jpg");
    fixture.image("cam1/images/0002.png", W, H + 1, [0; 3]);
    fixture.refuses(&["cam1", "0002.png", "8x6", "8x7"]);
    fixture.image("cam1/images/0002.png", W, H, [0; 3]);
    fixture.load().expect("mended");
}

#[test]
fn camera_folders_without_images_are_an_error() {
    let fixture = Fixture::new();
    fixture.write("poses_bounds.npy", npy_f64(&rows(1)));
    fixture.refuses(&["cam00.mp4", "none of these"]);
    fixture.write("cam00/images/readme.txt", "no image");
    fixture.refuses(&["1 camera folders without images"]);
    fixture.write("cam00/images/0000.tif", "");
    fixture.refuses(&["0000.tif", "only PNG and JPEG"]);
    fixture.write("poses_bounds.npy", npy_f64(&rows(2)));
    fixture.image("cam01/images/0000.png", W, H, [0; 3]);
    fixture.refuses(&["cam00", "0000.tif", "only PNG and JPEG"]);
}

#[test]
fn broken_poses_name_the_file_and_the_row() {
    let fixture = rig(3, 1);
    for (column, value, word) in [
        (0, f64::NAN, "NaN"),
        (8, f64::INFINITY, "infinity"),
        (16, f64::NAN, "NaN"),
        (4, 0.0, "height 0"),
        (9, -8.0, "width -8"),
        (14, 0.0, "focal length 0"),
        (9, 1e12, "width"),
    ] {
        let mut broken = rows(3);
        broken[1][column] = value;
        fixture.write("poses_bounds.npy", npy_f64(&broken));
        fixture.refuses(&["poses_bounds.npy", "row 1", word]);
    }
    let mut zero = rows(3);
    zero[2][..15].iter_mut().step_by(5).for_each(|v| *v = 0.0);
    fixture.write("poses_bounds.npy", npy_f64(&zero));
    fixture.refuses(&["row 2", "zeros"]);
    fixture.write(
        "poses_bounds.npy",
        npy(
            "{'descr': '<f8', 'fortran_order': False, 'shape': (1, 16), }",
            &[0; 128],
        ),
    );
    fixture.refuses(&["poses_bounds.npy", "[1, 16]", "17"]);
}

#[test]
fn truncated_files_are_errors() {
    let fixture = rig(2, 1);
    write_points(&fixture.path("points3D_downsample2.ply"), &point()).expect("writes");
    fixture.survives_truncation("poses_bounds.npy", 7);
    fixture.survives_truncation("points3D_downsample2.ply", 1);
    fixture.survives_truncation("cam1/images/0000.png", 1);
}

#[test]
fn masks_come_with_test_views_only() {
    let fixture = rig(2, 2);
    for camera in 0..2 {
        let mask = image::GrayImage::from_fn(W as u32, H as u32, |x, _| {
            image::Luma([if x < 4 { 255 } else { 0 }])
        });
        mask.save(fixture.path(&format!("motion_masks/cam{camera}/0001.png")))
            .expect("writes");
    }
    let views = fixture.load().expect("loads").views;
    let has_mask: Vec<bool> = views
        .iter()
        .map(|view| view.motion_mask().expect("reads").is_some())
        .collect();
    assert_eq!(has_mask, [false, true, false, false]);
    assert_eq!(
        views[1].motion_mask().expect("reads").expect("a mask")[2..6],
        [255, 255, 0, 0]
    );
}

#[test]
fn the_kth_camera_in_order_belongs_to_row_k_whatever_its_number() {
    let fixture = Fixture::new();
    fixture.write("poses_bounds.npy", npy_f64(&rows(3)));
    // Numbers with gaps, one of two digits.
    for name in ["cam1", "cam4", "cam12"] {
        fixture.image(&format!("{name}/images/0000.png"), W, H, [0; 3]);
    }
    let views = fixture.load().expect("loads").views;
    for (index, (view, name)) in views.iter().zip(["cam1", "cam12", "cam4"]).enumerate() {
        assert_eq!(
            (view.camera_index, view.camera_name.as_str()),
            (index, name)
        );
        assert_cameras_equal(&view.camera, &camera(index));
    }
}

#[test]
fn rows_of_known_poses_are_in_plain_order_too() {
    let fixture = Fixture::new();
    fixture.write("poses_bounds.npy", npy_f64(&rows(11)));
    let names: Vec<String> = (0..11).map(|number| format!("cam{number}")).collect();
    let path = fixture.path("poses_bounds.npy");
    let known = known_poses::read(&path, &names, &[[W, H]; 11]).expect("reads");
    for (row, number) in IN_PLAIN_ORDER.into_iter().enumerate() {
        assert_cameras_equal(&known[number].camera, &camera(row));
    }
}

#[test]
fn frames_of_some_cameras_beside_videos_of_others_are_refused() {
    let fixture = rig(1, 2);
    fixture.write("poses_bounds.npy", npy_f64(&rows(3)));
    for name in ["cam0.mp4", "cam1.mp4", "cam2.mp4"] {
        fixture.write(name, "a video");
    }
    fixture.refuses(&[
        "all 3 cameras as images, or a video of each",
        "images of cam0,",
        "passed over: cam1.mp4, cam2.mp4",
        "extract the frames of all videos",
    ]);
    for (camera, frame) in [(1, 0), (1, 1), (2, 0), (2, 1)] {
        let name = format!("cam{camera}/images/{frame:04}.png");
        fixture.image(&name, W, H, shade(camera, frame));
    }
    fixture.load().expect("videos of no use");
    for frame in 0..2 {
        fixture.remove(&format!("cam1/images/{frame:04}.png"));
    }
    fixture.refuses(&["images of cam0, cam2,", "passed over: cam1.mp4"]);
}

#[test]
fn camera_folders_may_lie_in_images() {
    let fixture = Fixture::new();
    fixture.write("poses_bounds.npy", npy_f64(&rows(2)));
    for camera in 0..2 {
        fixture.image(
            &format!("images/cam0{camera}/0007.png"),
            W,
            H,
            shade(camera, 0),
        );
    }
    let dataset = fixture.load().expect("loads");
    assert_eq!((dataset.layout, dataset.n_cameras), (Layout::N3dv, 2));
    assert_eq!(dataset.views[1].name, "cam01/0007");
}

#[test]
fn points_of_a_colmap_folder_serve_where_there_is_no_file() {
    for folder in [
        "sparse/0",
        "colmap/sparse/0",
        "colmap/dense/workspace/sparse",
        "colmap_0/sparse/0",
    ] {
        let fixture = rig(2, 1);
        write_model(&fixture, folder, &[("cam0.png", camera(0))]);
        let dataset = fixture.load().expect("loads");
        assert_eq!(dataset.layout, Layout::N3dv);
        assert_eq!(dataset.points.expect(folder).positions, [[1.0, 2.0, 3.0]]);
        write_points(&fixture.path("points3D_downsample2.ply"), &point()).expect("writes");
        assert_eq!(fixture.load().expect("loads").points, Some(point()));
    }
}

#[test]
fn broken_frames_are_named_or_left_out() {
    let fixture = rig(2, 3);
    fixture.write("cam0/images/0000.png", "not an image");
    fixture.write("cam1/images/0001.png", "");
    fixture.refuses(&["cam0", "0000.png"]);
    let skipping = LoadOptions {
        skip_broken: true,
        ..LoadOptions::default()
    };
    let dataset = fixture.load_with(&skipping).expect("four frames are left");
    let names: Vec<_> = dataset
        .views
        .iter()
        .map(|v| (v.name.as_str(), v.frame, v.time))
        .collect();
    let expected = [
        ("cam0/0001", 1, 0.5),
        ("cam0/0002", 2, 1.0),
        ("cam1/0000", 0, 0.0),
        ("cam1/0002", 2, 1.0),
    ];
    assert_eq!((names.as_slice(), dataset.n_frames), (&expected[..], 3));
    for camera in 0..2 {
        for frame in 0..3 {
            fixture.write(&format!("cam{camera}/images/000{frame}.png"), "");
        }
    }
    let error = fixture.load_with(&skipping).expect_err("nothing is left");
    assert!(error.to_string().contains("0000.png"), "{error}");
}

#[test]
fn masks_say_which_pixels_count() {
    let fixture = rig(2, 2);
    let mask = image::GrayImage::from_fn(W as u32, H as u32, |x, _| {
        image::Luma([if x < 4 { 255 } else { 0 }])
    });
    mask.save(fixture.path("masks/cam1/0001.png"))
        .expect("writes");
    for (invert_masks, first) in [(false, 1.0), (true, 0.0)] {
        for on_demand in [false, true] {
            let options = LoadOptions {
                invert_masks,
                on_demand,
                ..LoadOptions::default()
            };
            let dataset = fixture.load_with(&options).expect("loads");
            for view in &dataset.views {
                let (_, counted) = view.rgb_and_counted([0.0; 3]).expect("reads");
                if view.name != "cam1/0001" {
                    assert_eq!(counted, None, "{}", view.name);
                    continue;
                }
                let counted = counted.expect("a mask");
                assert_eq!(counted.len(), W * H);
                assert_eq!(counted[3..5], [first, 1.0 - first]);
            }
        }
    }
    image::GrayImage::new(2 * W as u32, H as u32)
        .save(fixture.path("masks/cam1/0001.png"))
        .expect("writes");
    fixture.refuses(&["masks", "0001.png", "8x6", "16x6"]);
}

#[test]
fn frames_are_chosen_by_the_numbers_of_their_files() {
    let fixture = rig(2, 6);
    // The capture begins at 0002 in both cameras.
    for (camera, frame) in [(0, 0), (0, 1), (1, 0), (1, 1)] {
        let path = fixture.path(&format!("cam{camera}/images/{frame:04}.png"));
        std::fs::remove_file(path).expect("written above");
    }
    let with = |range: &str| {
        fixture.load_with(&LoadOptions {
            frames: Some(range.parse().expect("a range")),
            ..LoadOptions::default()
        })
    };
    let dataset = with("3-4").expect("loads");
    let names: Vec<&str> = dataset.views.iter().map(|v| v.name.as_str()).collect();
    assert_eq!(names, ["cam0/0003", "cam0/0004", "cam1/0003", "cam1/0004"]);
    assert_eq!(dataset.n_frames, 2);
    assert_eq!(with("all").expect("loads").n_frames, 4);
    let message = with("7-8").expect_err("none of these").to_string();
    for part in ["--frames", "2 to 5", "7-8"] {
        assert!(message.contains(part), "{message}");
    }
}
