//! Whole datasets, read back from disk.

use crate::Error;
use crate::synth::write::write_with;
use crate::synth::*;
use image::GenericImageView;
use serde::Deserialize;
use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

fn config(scene: SceneKind, layout: SynthLayout) -> SynthConfig {
    SynthConfig {
        scene,
        layout,
        cameras: 4,
        frames: 3,
        width: 40,
        height: 30,
        seed: 5,
        video: false,
    }
}

/// All files under `root` by relative path.
fn tree(root: &Path) -> BTreeMap<String, Vec<u8>> {
    let mut files = BTreeMap::new();
    let mut folders = vec![root.to_path_buf()];
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(folder).expect("a folder") {
            let path = entry.expect("an entry").path();
            if path.is_dir() {
                folders.push(path);
            } else {
                let name = path
                    .strip_prefix(root)
                    .expect("under root")
                    .display()
                    .to_string();
                files.insert(name, fs::read(path).expect("a file"));
            }
        }
    }
    files
}

fn assert_close(got: f64, expected: f64, what: &str) {
    assert!(
        (got - expected).abs() < 1e-12,
        "{what}: got {got}, expected {expected}"
    );
}

#[test]
fn n3dv_holds_the_exact_cameras_pictures_and_masks() {
    let folder = tempfile::tempdir().expect("a scratch folder");
    let out = folder.path().join("new/clip");
    let config = config(SceneKind::Bounce, SynthLayout::N3dv);
    let summary = write(&out, &config).expect("writes");
    assert_eq!(
        (summary.cameras, summary.frames, summary.points),
        (4, 3, 1000)
    );

    let bytes = fs::read(out.join("poses_bounds.npy")).expect("read");
    let npy = npyz::NpyFile::new(&bytes[..]).expect("a header");
    assert_eq!(npy.shape(), [4, 17]);
    let table: Vec<f64> = npy.into_vec().expect("f64 values");
    let cameras = rig(4, 40, 30);
    let scene = Scene::new(config.scene, config.seed, 40, 30);
    for (index, (camera, row)) in cameras.iter().zip(table.chunks(17)).enumerate() {
        let name = format!("camera {index}");
        let position = camera.position();
        for axis in 0..3 {
            let column = |c: usize| row[5 * axis + c];
            assert_close(column(0), camera.rotation[1][axis], &name);
            assert_close(column(1), camera.rotation[0][axis], &name);
            assert_close(column(2), -camera.rotation[2][axis], &name);
            assert_close(column(3), position[axis], &name);
        }
        assert_eq!([row[4], row[9], row[14]], [30.0, 40.0, camera.fx]);
        let view = render(&scene, camera, 0.5);
        let [near, far] = [row[15], row[16]];
        assert!(
            view.depth
                .iter()
                .all(|d| (near..far).contains(&f64::from(*d))),
            "{near} {far}"
        );
        let image = image::open(out.join(format!("cam{index:02}/images/0001.png"))).expect("a PNG");
        assert!(
            image.into_rgb8().into_raw() == view.rgb,
            "{name}: another picture"
        );
        let mask =
            image::open(out.join(format!("motion_masks/cam{index:02}/0001.png"))).expect("a PNG");
        assert_eq!(mask.color(), image::ColorType::L8);
        let moving: Vec<bool> = mask
            .into_luma8()
            .into_raw()
            .iter()
            .map(|m| *m == 255)
            .collect();
        assert!(moving == view.moving, "{name}: another mask");
    }
    let expected = 4 * 3 * 2 + "poses, points, truth".split(", ").count();
    assert_eq!(tree(&out).len(), expected);
    assert_eq!(
        fs::read_dir(folder.path().join("new"))
            .expect("a folder")
            .count(),
        1
    );
}

#[test]
fn blender_holds_the_exact_cameras_and_splits_off_camera_0() {
    let folder = tempfile::tempdir().expect("a scratch folder");
    let out = folder.path().join("clip");
    write(&out, &config(SceneKind::Bounce, SynthLayout::Blender)).expect("writes");
    let cameras = rig(4, 40, 30);
    for (split, members) in [("test", 0..1), ("train", 1..4)] {
        let path = out.join(format!("transforms_{split}.json"));
        let text = fs::read_to_string(path).expect("read");
        let json: serde_json::Value = serde_json::from_str(&text).expect("JSON");
        let number = |key: &str| json[key].as_f64().expect("a number");
        assert_close(number("fl_x"), cameras[0].fx, "fl_x");
        assert_close(
            (number("camera_angle_x") / 2.0).tan(),
            20.0 / cameras[0].fx,
            "angle",
        );
        assert_eq!(
            [number("cx"), number("cy"), number("w"), number("h")],
            [20.0, 15.0, 40.0, 30.0]
        );
        let frames = json["frames"].as_array().expect("frames");
        assert_eq!(frames.len(), 3 * members.len());
        for (index, frame) in frames.iter().enumerate() {
            let camera = &cameras[members.start + index / 3];
            let position = camera.position();
            assert_eq!(frame["time"].as_f64(), Some([0.0, 0.5, 1.0][index % 3]));
            for axis in 0..3 {
                let column = |c: usize| frame["transform_matrix"][axis][c].as_f64().expect("f64");
                assert_close(column(0), camera.rotation[0][axis], "right");
                assert_close(column(1), -camera.rotation[1][axis], "up");
                assert_close(column(2), -camera.rotation[2][axis], "backwards");
                assert_close(column(3), position[axis], "position");
            }
            let stem = frame["file_path"].as_str().expect("a path");
            assert_eq!(stem, format!("./{split}/r_{index:04}"));
            let image = image::open(out.join(format!("{stem}.png"))).expect("a PNG");
            assert_eq!(image.dimensions(), (40, 30));
            assert!(
                out.join("motion_masks")
                    .join(format!("{stem}.png"))
                    .is_file()
            );
        }
    }
}

#[test]
fn the_cloud_and_the_truth_read_back() {
    #[derive(Deserialize)]
    struct Ply {
        vertex: Vec<CloudPoint>,
    }
    let folder = tempfile::tempdir().expect("a scratch folder");
    let out = folder.path().join("clip");
    let config = config(SceneKind::Bounce, SynthLayout::N3dv);
    write(&out, &config).expect("writes");
    let bytes = fs::read(out.join("points3D_downsample2.ply")).expect("read");
    assert!(bytes.starts_with(b"ply\nformat binary_little_endian 1.0\nelement vertex 1000\n"));
    let ply: Ply = serde_ply::from_bytes(&bytes).expect("PLY");
    let scene = Scene::new(config.scene, config.seed, 40, 30);
    let cameras = rig(4, 40, 30);
    assert_eq!(ply.vertex, cloud(&scene, &cameras, 1000, config.seed));

    let truth = fs::read_to_string(out.join("truth.json")).expect("read");
    let truth: Truth = serde_json::from_str(&truth).expect("JSON");
    assert_eq!(truth.times, [0.0, 0.5, 1.0]);
    for (camera, exact) in truth.cameras.iter().zip(&cameras) {
        for row in 0..3 {
            for column in 0..3 {
                let got = camera.camera_from_world[row][column];
                assert_close(got, exact.rotation[row][column], &camera.name);
            }
            assert_close(
                camera.camera_from_world[row][3],
                exact.translation[row],
                &camera.name,
            );
        }
        let mut moving = 0;
        for mask in &camera.masks {
            let mask = image::open(out.join(mask)).expect("a PNG").into_luma8();
            moving += mask.into_raw().iter().filter(|m| **m == 255).count();
        }
        assert_close(
            camera.moving_share,
            moving as f64 / (3.0 * 40.0 * 30.0),
            &camera.name,
        );
    }
    let ball = truth
        .objects
        .iter()
        .find(|o| o.name == "ball")
        .expect("a ball");
    assert!(ball.moving && ball.world_from_object.len() == 3);
    let floor = truth
        .objects
        .iter()
        .find(|o| o.name == "floor")
        .expect("a floor");
    assert!(!floor.moving && floor.world_from_object.is_empty());
}

#[test]
fn the_same_configuration_gives_the_same_bytes_on_any_number_of_threads() {
    let folder = tempfile::tempdir().expect("a scratch folder");
    for layout in [
        SynthLayout::N3dv,
        SynthLayout::Blender,
        SynthLayout::Colmap,
        SynthLayout::Nerfies,
        SynthLayout::Panoptic,
        SynthLayout::Technicolor,
    ] {
        let mut trees = Vec::new();
        for (threads, seed) in [(1, 5), (3, 5), (2, 6)] {
            let out = folder.path().join(format!("{layout}{threads}"));
            let config = SynthConfig {
                seed,
                ..config(SceneKind::Flow, layout)
            };
            let pool = rayon::ThreadPoolBuilder::new()
                .num_threads(threads)
                .build()
                .expect("a pool");
            pool.install(|| write(&out, &config)).expect("writes");
            trees.push(tree(&out));
        }
        assert!(
            trees[0] == trees[1],
            "{layout}: the number of threads changes the bytes"
        );
        assert!(trees[0] != trees[2], "{layout}: the seed has no effect");
    }
}

#[test]
fn an_output_that_is_not_free_is_refused_and_left_alone() {
    let folder = tempfile::tempdir().expect("a scratch folder");
    let config = config(SceneKind::Static, SynthLayout::N3dv);
    let full = folder.path().join("full");
    fs::create_dir(&full).expect("a folder");
    fs::write(full.join("keep.txt"), "kept").expect("a file");
    let message = write(&full, &config).expect_err("refused").to_string();
    assert!(
        message.contains("full") && message.contains("a folder with files in it"),
        "{message}"
    );
    assert_eq!(tree(&full).len(), 1);

    let file = full.join("keep.txt");
    let error = write(&file, &config).expect_err("refused");
    assert!(
        matches!(
            error,
            Error::OutputExists {
                found: "a file",
                ..
            }
        ),
        "{error}"
    );
    let error = write(&file.join("below"), &config).expect_err("a file is no parent");
    assert!(matches!(error, Error::Access { .. }), "{error}");
    let error = write(Path::new("/"), &config).expect_err("no name");
    assert!(matches!(error, Error::Setting { .. }), "{error}");

    let empty = folder.path().join("empty");
    fs::create_dir(&empty).expect("a folder");
    write(&empty, &config).expect("an empty folder is free");
    assert!(empty.join("truth.json").is_file());
}

#[test]
fn settings_out_of_range_name_the_setting() {
    let good = config(SceneKind::Bounce, SynthLayout::Blender);
    type Spoil = fn(&mut SynthConfig);
    let cases: [(&str, Spoil); 5] = [
        ("--cameras", |c| c.cameras = 1),
        ("--frames", |c| c.frames = 0),
        ("--size", |c| c.height = 15),
        ("--size", |c| c.width = 100_000),
        ("--video", |c| c.video = true),
    ];
    for (setting, spoil) in cases {
        let mut config = good.clone();
        spoil(&mut config);
        let message = config.validate().expect_err("refused").to_string();
        assert!(message.contains(setting), "{message}");
    }
    let one = SynthConfig { frames: 1, ..good };
    one.validate().expect("one frame is a clip");
    assert_eq!(one.time(0), 0.0);
    assert!("llff".parse::<SynthLayout>().is_err());
    assert_eq!(
        "flow".parse::<SceneKind>().expect("a scene"),
        SceneKind::Flow
    );
    assert_eq!(SceneKind::Tiny.to_string(), "tiny");
}

#[test]
fn videos_need_ffmpeg_and_a_failure_leaves_nothing() {
    let folder = tempfile::tempdir().expect("a scratch folder");
    let config = SynthConfig {
        video: true,
        ..config(SceneKind::Bounce, SynthLayout::N3dv)
    };
    let out = folder.path().join("clip");
    let left = || fs::read_dir(folder.path()).expect("a folder").count();
    let error = write_with(&out, &config, "no-such-ffmpeg").expect_err("missing");
    assert!(error.to_string().contains("install ffmpeg"), "{error}");
    assert_eq!(left(), 0);
    // `false` starts like any program, and then fails on every video.
    let error = write_with(&out, &config, "false").expect_err("fails");
    assert!(
        matches!(&error, Error::SynthVideo(cause) if matches!(**cause, Error::VideoEncode { .. })),
        "{error}"
    );
    assert_eq!(left(), 0, "half a dataset stays");

    match write(&out, &config) {
        Ok(_) => {
            let files = tree(&out);
            assert!(files.contains_key("cam03.mp4"));
            let frames = files.keys().filter(|f| f.ends_with(".png"));
            assert!(frames.into_iter().all(|f| f.starts_with("motion_masks/")));
        }
        Err(error) => assert!(matches!(error, Error::FfmpegNotStarted { .. }), "{error}"),
    }
}

#[test]
fn videos_can_be_entered_every_15_frames() {
    let folder = tempfile::tempdir().expect("a scratch folder");
    let out = folder.path().join("clip");
    let config = SynthConfig {
        video: true,
        cameras: 2,
        frames: 32,
        width: 17,
        height: 19,
        ..config(SceneKind::Tiny, SynthLayout::N3dv)
    };
    write(&out, &config).expect("this test needs ffmpeg: apt install ffmpeg");
    let output = std::process::Command::new("ffprobe")
        .args(["-v", "error", "-show_entries", "packet=flags", "-of", "csv"])
        .arg(out.join("cam01.mp4"))
        .output()
        .expect("ffprobe comes with ffmpeg");
    let packets = String::from_utf8_lossy(&output.stdout);
    let keys: Vec<bool> = packets.lines().map(|line| line.contains('K')).collect();
    assert_eq!(keys.len(), 32, "{packets}");
    assert!(keys.chunks(15).all(|group| group[0]), "{packets}");
}
