use dash_kernels::Camera;
use serde_json::{Value, json};

use super::super::{Layout, LoadOptions, Partition};
use super::blender::matrix;
use super::videos::write_video;
use crate::test_kit::{Fixture, H, W, assert_cameras_equal, camera, write_model};

const NAMES: [&str; 3] = ["left", "middle", "right"];

/// Folders of frames; the second camera has images of another size than the others.
fn folders() -> Fixture {
    let fixture = Fixture::new();
    for (index, name) in NAMES.iter().enumerate() {
        for frame in 0..2 {
            let (width, height) = size(index);
            let shade = [index as u8, frame as u8, 9];
            fixture.image(
                &format!("images/{name}/{frame:03}.png"),
                width,
                height,
                shade,
            );
        }
    }
    fixture
}

fn size(index: usize) -> (usize, usize) {
    if index == 1 { (2 * W, H) } else { (W, H) }
}

fn expected(index: usize) -> Camera {
    let (width, height) = size(index);
    Camera {
        width,
        height,
        cx: 4.25,
        ..camera(index)
    }
}

/// `transforms.json` that names the cameras by `path`.
fn transforms(path: impl Fn(&str) -> String, names: &[(usize, &str)]) -> Value {
    let frames: Vec<Value> = names
        .iter()
        .map(|(index, name)| {
            let camera = expected(*index);
            json!({
                "file_path": path(name), "transform_matrix": matrix(&camera), "fl_x": camera.fx,
                "fl_y": camera.fy, "cx": camera.cx, "cy": camera.cy, "w": camera.width, "h": camera.height
            })
        })
        .collect();
    json!({"frames": frames})
}

fn all() -> Vec<(usize, &'static str)> {
    // Not in the cameras' order.
    vec![(2, NAMES[2]), (0, NAMES[0]), (1, NAMES[1])]
}

#[track_caller]
fn check(fixture: &Fixture) {
    let dataset = fixture.load().expect("loads");
    assert_eq!(dataset.layout, Layout::Rig);
    assert_eq!(
        (dataset.n_cameras, dataset.n_frames, dataset.views.len()),
        (3, 2, 6)
    );
    for (at, view) in dataset.views.iter().enumerate() {
        let (index, frame) = (at / 2, at % 2);
        assert_eq!(view.name, format!("{}/{frame:03}", NAMES[index]));
        assert_eq!(view.time, frame as f32);
        assert_eq!(view.partition == Partition::Test, index == 0);
        assert_cameras_equal(&view.camera, &expected(index));
        let shade = [index as f32 / 255.0, frame as f32 / 255.0];
        assert_eq!(view.rgb([0.0; 3]).expect("reads")[..2], shade);
    }
}

#[test]
fn transforms_name_the_cameras_in_any_of_the_usual_ways() {
    let fixture = folders();
    for path in [
        |name: &str| format!("videos/{name}.mp4"),
        |name: &str| format!("./images/{name}.jpg"),
        |name: &str| name.to_string(),
        |name: &str| format!("images/{name}/000.png"),
        |name: &str| format!("images\\{name}\\000.png"),
        |name: &str| format!("videos\\{name}.mp4"),
    ] {
        fixture.write("transforms.json", transforms(path, &all()).to_string());
        check(&fixture);
    }
}

#[test]
fn colmap_models_name_the_cameras_too() {
    for folder in ["sparse/0", "colmap/sparse/0"] {
        for path in [
            |name: &str| format!("{name}.png"),
            |name: &str| name.to_string(),
            |name: &str| format!("{name}/000.png"),
        ] {
            let fixture = folders();
            let names: Vec<String> = NAMES.iter().map(|name| path(name)).collect();
            let images: Vec<(&str, Camera)> = [2, 0, 1]
                .map(|index| (names[index].as_str(), expected(index)))
                .into();
            write_model(&fixture, folder, &images);
            check(&fixture);
            assert!(fixture.load().expect("loads").points.is_some());
        }
    }
}

#[test]
fn one_pose_per_image_is_another_layout() {
    let fixture = folders();
    let each = |frame: usize| move |name: &str| format!("images/{name}/{frame:03}.png");
    let mut both = transforms(each(0), &all());
    let second = transforms(each(1), &all());
    if let (Some(frames), Some(more)) = (both["frames"].as_array_mut(), second["frames"].as_array())
    {
        frames.extend(more.iter().cloned());
    }
    fixture.write("transforms.json", both.to_string());
    let dataset = fixture.load().expect("loads");
    assert_eq!((dataset.layout, dataset.n_frames), (Layout::Blender, 1));
    let forced = LoadOptions {
        layout: Some(Layout::Rig),
        ..LoadOptions::default()
    };
    let error = fixture
        .load_with(&forced)
        .expect_err("two poses")
        .to_string();
    assert!(
        error.contains("one pose for camera left") && error.contains("000.png"),
        "{error}"
    );
}

#[test]
fn poses_with_times_are_those_of_pictures() {
    let fixture = folders();
    let mut file = transforms(|name| format!("images/{name}/000.png"), &all());
    fixture.write("transforms.json", file.to_string());
    assert_eq!(fixture.load().expect("loads").layout, Layout::Rig);
    for (k, frame) in file["frames"]
        .as_array_mut()
        .expect("frames")
        .iter_mut()
        .enumerate()
    {
        frame["time"] = json!(0.5 * k as f64);
    }
    fixture.write("transforms.json", file.to_string());
    let dataset = fixture.load().expect("loads");
    assert_eq!((dataset.layout, dataset.n_frames), (Layout::Blender, 3));
}

#[test]
fn images_of_other_formats_are_named() {
    let fixture = Fixture::new();
    fixture.write("images/left/000.webp", "");
    let forced = LoadOptions {
        layout: Some(Layout::Rig),
        ..LoadOptions::default()
    };
    let error = fixture.load_with(&forced).expect_err("none").to_string();
    assert!(
        error.contains("000.webp") && error.contains("only PNG and JPEG"),
        "{error}"
    );
}

#[test]
fn cameras_without_a_pose_are_named_and_poses_without_a_camera_are_not_needed() {
    let fixture = folders();
    let path = |name: &str| format!("{name}.png");
    fixture.write(
        "transforms.json",
        transforms(path, &[(1, "middle")]).to_string(),
    );
    fixture.refuses(&["transforms.json", "left, right", "middle.png"]);
    let mut more = all();
    more.push((0, "above"));
    fixture.write("transforms.json", transforms(path, &more).to_string());
    check(&fixture);
    let images = [("left.png", expected(0)), ("right.png", expected(2))];
    let fixture = folders();
    write_model(&fixture, "sparse/0", &images);
    fixture.refuses(&["images.txt", "middle"]);
}

#[test]
fn lenses_are_undone_and_images_may_be_smaller_than_the_poses_say() {
    let fixture = folders();
    let mut top = transforms(|name| format!("{name}.png"), &all());
    for frame in top["frames"].as_array_mut().expect("frames") {
        for key in ["fl_x", "fl_y", "cx", "cy", "w", "h"] {
            frame[key] = json!(2.0 * frame[key].as_f64().expect("a number"));
        }
    }
    fixture.write("transforms.json", top.to_string());
    check(&fixture);
    top["k1"] = json!(1.0);
    fixture.write("transforms.json", top.to_string());
    let zoomed = fixture.load().expect("loads").views[0].camera.fx;
    assert!(zoomed > 9.0 && zoomed < 18.0, "{zoomed}");
}

#[test]
fn videos_are_read_frame_by_frame_with_sizes_of_their_own() {
    let fixture = Fixture::new();
    std::fs::create_dir(fixture.root().join("videos")).expect("a folder");
    for (index, name) in NAMES.iter().enumerate() {
        write_video(&fixture, &format!("videos/{name}.mp4"), 3, 20 + 10 * index);
    }
    // Without a size in the file: the videos' 64x48.
    let frames: Vec<Value> = (0..3)
        .map(|index| {
            let path = format!("videos/{}.mp4", NAMES[index]);
            json!({"file_path": path, "transform_matrix": matrix(&camera(index)), "fl_x": 72.0})
        })
        .collect();
    fixture.write("transforms.json", json!({"frames": frames}).to_string());
    let dataset = fixture.load().expect("loads");
    assert_eq!(
        (dataset.layout, dataset.n_cameras, dataset.n_frames),
        (Layout::Rig, 3, 3)
    );
    for view in &dataset.views {
        assert_cameras_equal(&view.camera, &camera(view.camera_index).resized(64, 48));
        let expected = (20 + 10 * view.camera_index + 30 * view.frame) as f32 / 255.0;
        let got = view.rgb([0.0; 3]).expect("reads")[0];
        assert!(
            (got - expected).abs() < 6.0 / 255.0,
            "{}: {got} {expected}",
            view.name
        );
    }
    // Or a model made of one image per camera, which may lie beside the videos.
    fixture.remove("transforms.json");
    let names = NAMES.map(|name| format!("{name}.png"));
    let images: Vec<(&str, Camera)> = (0..3)
        .map(|index| (names[index].as_str(), camera(index).resized(64, 48)))
        .collect();
    write_model(&fixture, "sparse/0", &images);
    for name in &names {
        fixture.image(&format!("images/{name}"), 64, 48, [0; 3]);
    }
    let dataset = fixture.load().expect("loads");
    assert_eq!((dataset.layout, dataset.views.len()), (Layout::Rig, 9));
    assert_cameras_equal(&dataset.views[8].camera, &images[2].1);
    fixture.write("videos/right.mp4", "not a video");
    fixture.refuses(&["right.mp4"]);
}

pub(super) fn with_model() -> Fixture {
    let fixture = folders();
    let images = [0, 1, 2].map(|index| (NAMES[index], expected(index)));
    write_model(&fixture, "sparse/0", &images);
    fixture
}

pub(super) fn with_transforms() -> Fixture {
    let fixture = folders();
    let file = transforms(|name| format!("{name}.png"), &all());
    fixture.write("transforms.json", file.to_string());
    fixture
}

#[test]
fn truncated_files_are_errors() {
    let fixture = with_model();
    fixture.survives_truncation("sparse/0/images.txt", 3);
    fixture.survives_truncation("sparse/0/cameras.txt", 3);
    fixture.survives_truncation("images/left/001.png", 1);
    with_transforms().survives_truncation("transforms.json", 7);
}

#[test]
fn pictures_that_cameras_were_posed_by_may_stand_beside_videos() {
    let fixture = Fixture::new();
    for name in NAMES {
        write_video(&fixture, &format!("videos/{name}.mp4"), 3, 40);
    }
    let folder = |fixture: &Fixture, name: &str, frames: usize| {
        for frame in 0..frames {
            fixture.image(&format!("images/{name}/{frame:03}.png"), 64, 48, [9; 3]);
        }
    };
    let cameras = NAMES.iter().enumerate().map(|(index, name)| {
        json!({"file_path": format!("images/{name}/000.png"), "fl_x": 60.0, "w": 64, "h": 48,
            "transform_matrix": matrix(&camera(index))})
    });
    let cameras: Vec<Value> = cameras.collect();
    fixture.write("transforms.json", json!({"frames": cameras}).to_string());
    for (frames, expected) in [([0, 0, 0], 3), ([1, 1, 1], 3), ([2, 2, 2], 2)] {
        for (name, frames) in NAMES.iter().zip(frames) {
            folder(&fixture, name, frames);
        }
        let dataset = fixture.load().expect("loads");
        assert_eq!((dataset.layout, dataset.n_frames), (Layout::Rig, expected));
    }
    std::fs::remove_dir_all(fixture.path("images/middle")).expect("removes");
    // A video without frames is told, and the folders are read as before.
    let dataset = fixture.load().expect("loads");
    assert_eq!((dataset.layout, dataset.n_cameras), (Layout::Rig, 2));
}
