use dash_kernels::Camera;

use super::super::{Layout, LoadOptions, Partition};
use crate::test_kit::{Fixture, H, W, assert_cameras_equal, camera, quaternion, write_model};

/// Off-centre and with pixels that are not square.
fn off_centre(index: usize) -> Camera {
    Camera {
        fy: 9.9,
        cx: 4.5 + 0.01 * index as f64,
        cy: 2.25,
        ..camera(index)
    }
}

fn line(camera: &Camera) -> String {
    let aspect = camera.fy / camera.fx;
    let intrinsics = [camera.fx, camera.cx, camera.cy, aspect, 0.0];
    let numbers = intrinsics
        .into_iter()
        .chain(quaternion(camera))
        .chain(camera.translation);
    let fields: Vec<String> = numbers.map(|v| v.to_string()).collect();
    fields.join(" ") + " \n"
}

fn parameters(n: usize) -> String {
    let lines = (0..n).map(|index| line(&off_centre(index)));
    std::iter::once("f cu cv ar sk qw qx qy qz tx ty tz\n".to_string())
        .chain(lines)
        .collect()
}

pub(super) fn raw(
    scene: &str,
    n_cameras: usize,
    frames: impl Iterator<Item = usize> + Clone,
) -> Fixture {
    let fixture = Fixture::new();
    fixture.write("cameras_parameters.txt", parameters(n_cameras));
    for camera in 0..n_cameras {
        for frame in frames.clone() {
            let name = format!("{scene}_undist_{frame:05}_{camera:02}.png");
            fixture.image(&name, W, H, [camera as u8, frame as u8, 7]);
        }
    }
    fixture
}

#[test]
fn the_published_files_give_exact_cameras_times_and_the_test_camera() {
    let dataset = raw("Rugby", 16, 3..6).load().expect("loads");
    assert_eq!(dataset.layout, Layout::Technicolor);
    assert_eq!(
        (dataset.n_cameras, dataset.n_frames, dataset.views.len()),
        (16, 3, 48)
    );
    for (index, view) in dataset.views.iter().enumerate() {
        let (camera, frame) = (index / 3, index % 3);
        assert_eq!(view.name, format!("cam{camera:02}/{:05}", frame + 3));
        assert_eq!((view.camera_index, view.frame), (camera, frame));
        assert_eq!(view.time, [0.0, 0.5, 1.0][frame]);
        assert_eq!(view.partition == Partition::Test, camera == 10);
        assert_cameras_equal(&view.camera, &off_centre(camera));
        let expected = [camera as f32 / 255.0, (frame + 3) as f32 / 255.0];
        assert_eq!(view.rgb([0.0; 3]).expect("reads")[..2], expected);
    }
    let few = raw("Rugby", 3, 1..3).load().expect("loads");
    assert!(
        few.views_of(Partition::Test)
            .all(|view| view.camera_index == 0)
    );
    // One model per frame, as some tools leave them, the first of the clip counts.
    let fixture = raw("Rugby", 2, 0..2);
    for (frame, x) in [(12, 9), (3, 1)] {
        let folder = format!("colmap_{frame}/sparse/0");
        write_model(&fixture, &folder, &[("cam00.png", camera(0))]);
        fixture.write(
            &format!("{folder}/points3D.txt"),
            format!("1 {x} 2 3 4 5 6 0.5\n"),
        );
    }
    let points = fixture.load().expect("loads").points.expect("points");
    assert_eq!(points.positions, [[1.0, 2.0, 3.0]]);
    // Beside each other or in `images/`, as some tools want them.
    let fixture = raw("Rugby", 2, 0..0);
    for camera in 0..2 {
        fixture.image(
            &format!("images/Rugby_undist_00007_0{camera}.png"),
            W,
            H,
            [0; 3],
        );
    }
    assert_eq!(fixture.load().expect("loads").views[1].name, "cam01/00007");
}

#[test]
fn only_the_published_frames_of_known_scenes_are_used() {
    let first_and_last_of = |fixture: &Fixture, frames: Option<&str>| {
        let options = LoadOptions {
            frames: frames.map(|text| text.parse().expect("a range")),
            ..LoadOptions::default()
        };
        let views = fixture.load_with(&options).expect("loads").views;
        let times: Vec<f32> = views.iter().map(|view| view.time).collect();
        assert_eq!((times[0], times[times.len() - 1]), (0.0, 1.0));
        let of_camera = views.iter().filter(|view| view.camera_index == 1);
        let names: Vec<String> = of_camera.map(|view| view.name.clone()).collect();
        (
            names[0].clone(),
            names[names.len() - 1].clone(),
            names.len(),
        )
    };
    let first_and_last = |fixture: &Fixture| first_and_last_of(fixture, None);
    let fabien = raw("Fabien", 2, 50..103);
    let found = first_and_last_of(&fabien, Some("all"));
    assert_eq!(found, ("cam01/00050".into(), "cam01/00102".into(), 53));
    let found = first_and_last_of(&fabien, Some("49-51"));
    assert_eq!(found, ("cam01/00050".into(), "cam01/00051".into(), 2));
    let found = first_and_last(&fabien);
    assert_eq!(found, ("cam01/00051".into(), "cam01/00100".into(), 50));
    let found = first_and_last(&raw("Painter", 2, 99..151));
    assert_eq!(found, ("cam01/00100".into(), "cam01/00149".into(), 50));
    // A part of the published frames, or another scene: all there are.
    let found = first_and_last(&raw("Fabien", 2, 98..103));
    assert_eq!(found, ("cam01/00098".into(), "cam01/00102".into(), 5));
    assert_eq!(first_and_last(&raw("Rugby", 2, 50..103)).2, 53);
}

#[test]
fn prepared_scenes_take_poses_and_points_of_the_model() {
    for (n, test) in [(12, 10), (5, 0), (17, 0)] {
        let fixture = Fixture::new();
        let cameras: Vec<(String, Camera)> = (0..n)
            .map(|index| (format!("cam{index:02}.png"), off_centre(index)))
            .collect();
        let mut images: Vec<(&str, Camera)> = cameras
            .iter()
            .map(|(name, c)| (name.as_str(), c.clone()))
            .collect();
        images.reverse();
        write_model(&fixture, "colmap/dense/workspace/sparse", &images);
        for camera in 0..n {
            for frame in 0..2 {
                let name = format!("images/cam{camera:02}/{frame:04}.png");
                fixture.image(&name, W, H, [camera as u8; 3]);
            }
        }
        // Beside poses of another tool, whose world the points may not share.
        fixture.write("poses_bounds.npy", "not read");
        let dataset = fixture.load().expect("loads");
        assert_eq!(dataset.layout, Layout::Technicolor);
        assert_eq!((dataset.n_cameras, dataset.n_frames), (n, 2));
        assert_eq!(dataset.points.as_ref().map(|points| points.len()), Some(1));
        for view in &dataset.views {
            assert_cameras_equal(&view.camera, &off_centre(view.camera_index));
            assert_eq!(
                view.name,
                format!("cam{:02}/{:04}", view.camera_index, view.frame)
            );
            // A rig with more cameras is not Technicolor's, and its cam10 is no test camera.
            assert_eq!(
                view.partition == Partition::Test,
                view.camera_index == test,
                "{n}: {}",
                view.name
            );
        }
        fixture.image(&format!("images/cam{n:02}/0000.png"), W, H, [0; 3]);
        fixture.refuses(&["images.txt", &format!("cam{n:02}")]);
    }
}

#[test]
fn malformed_parameters_name_the_file_and_the_line() {
    let fixture = raw("Rugby", 2, 0..1);
    let good = parameters(2);
    let second = line(&off_centre(1));
    let fields: Vec<&str> = second.split_whitespace().collect();
    let with = |column: usize, value: &str| {
        let mut fields = fields.clone();
        fields[column] = value;
        good.replace(&second, &(fields.join(" ") + "\n"))
    };
    for (text, word) in [
        (with(4, "0.5"), "skew 0.5"),
        (with(4, "NaN"), "skew NaN"),
        (with(0, "0"), "focal lengths 0, 0"),
        (with(3, "-1"), "aspect -1"),
        (with(1, "inf"), "principal point inf"),
        (with(1, "8"), "near the middle of the 8x6"),
        (with(5, "x"), "other words"),
        (with(9, "nan"), "finite pose"),
        // Of the distorted images: two more columns.
        (
            good.replace(&second, &format!("0.1 0.2 {second}")),
            "found 14",
        ),
    ] {
        fixture.write("cameras_parameters.txt", text);
        fixture.refuses(&["cameras_parameters.txt", word, "line 3"]);
    }
    let without_header: String = good
        .lines()
        .skip(1)
        .map(|line| format!("{line}\n"))
        .collect();
    fixture.write("cameras_parameters.txt", without_header);
    fixture.refuses(&["cameras_parameters.txt", "header", "first line"]);
    fixture.write("cameras_parameters.txt", good.replace(&second, ""));
    fixture.refuses(&["cameras_parameters.txt", "cam01", "1 lines"]);
    fixture.write("cameras_parameters.txt", good);
    fixture.image("Train_undist_00000_00.png", W, H, [0; 3]);
    fixture.refuses(&["Train_undist_00000_00.png", "Rugby"]);
    fixture.remove("Train_undist_00000_00.png");
    fixture.remove("Rugby_undist_00000_00.png");
    fixture.remove("Rugby_undist_00000_01.png");
    fixture.refuses(&["_undist_00000_00.png"]);
}

#[test]
fn broken_images_are_named_or_left_out() {
    let fixture = raw("Birthday", 3, 0..3);
    // The published Birthday has one of these.
    fixture.write("Birthday_undist_00001_02.png", "damaged");
    fixture.refuses(&["Birthday_undist_00001_02.png"]);
    let skipping = LoadOptions {
        skip_broken: true,
        ..LoadOptions::default()
    };
    let dataset = fixture.load_with(&skipping).expect("eight are left");
    assert_eq!((dataset.views.len(), dataset.n_frames), (8, 3));
    assert!(dataset.views.iter().all(|view| view.name != "cam02/00001"));
    assert_eq!(dataset.views[7].time, 1.0);
}

#[test]
fn truncated_files_are_errors() {
    let fixture = raw("Rugby", 2, 0..1);
    fixture.survives_truncation("cameras_parameters.txt", 1);
    fixture.survives_truncation("Rugby_undist_00000_01.png", 1);
}
