//! Bad input of every kind: exit code 1, one line that names the file, nothing left behind.

use crate::common::{Scratch, TINY, text};

/// `dash train` on `room`, which must fail before `run` is made; short, should it not.
const TRAIN: [&str; 6] = ["train", "room", "--out", "run", "--iterations", "1"];

/// A NumPy file of f64.
fn npy(shape: &str, values: &[f64]) -> Vec<u8> {
    let header = format!("{{'descr': '<f8', 'fortran_order': False, 'shape': {shape}, }}\n");
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend((header.len() as u16).to_le_bytes());
    bytes.extend(header.as_bytes());
    bytes.extend(values.iter().flat_map(|v| v.to_le_bytes()));
    bytes
}

#[test]
fn missing_files() {
    let scratch = Scratch::new();
    scratch.fails(&["train", "nowhere", "--out", "run"], "nowhere");
    scratch.fails(&["info", "nowhere"], "nowhere");
    scratch.fails(&["info", "nowhere.ply"], "nowhere.ply");
    scratch.fails(&["eval", "nowhere"], "nowhere");
    scratch.fails(&["render", "nowhere", "--out", "out"], "nowhere");
    scratch.fails(
        &[
            "render",
            "nowhere.ply",
            "--cameras",
            "c.json",
            "--out",
            "out",
        ],
        "nowhere.ply",
    );
    scratch.fails(
        &["export", "nowhere", "--time", "0", "--out", "a.ply"],
        "nowhere",
    );
    scratch.fails(&["train", "nowhere", "--out", "run", "--resume"], "run");
    scratch.fails(
        &["train", "nowhere", "--out", "run", "--config", "c.toml"],
        "c.toml",
    );
    scratch.write("empty/readme.txt", "nothing here");
    scratch.fails(&["train", "empty", "--out", "run"], "empty");
}

#[test]
fn damaged_poses_of_n3dv() {
    let scratch = Scratch::with_room("n3dv");
    let whole = scratch.read("room/poses_bounds.npy");
    for share in [0.0, 0.02, 0.3, 0.9] {
        scratch.truncate("room/poses_bounds.npy", share);
        scratch.fails(&TRAIN, "poses_bounds.npy");
        scratch.write("room/poses_bounds.npy", &whole);
    }
    let poses: Vec<f64> = whole[whole.len() - 4 * 17 * 8..]
        .chunks_exact(8)
        .map(|bytes| f64::from_le_bytes(bytes.try_into().expect("8 bytes")))
        .collect();
    scratch.write("room/poses_bounds.npy", npy("(4, 17)", &poses));
    scratch.ok(&["info", "room"]);
    for bad in [f64::NAN, f64::INFINITY] {
        let mut broken = poses.clone();
        broken[5] = bad;
        scratch.write("room/poses_bounds.npy", npy("(4, 17)", &broken));
        scratch.fails(&TRAIN, "poses_bounds.npy");
    }
    for (shape, n) in [
        ("(4, 16)", 64),
        ("(68,)", 68),
        ("(3, 17)", 51),
        ("(0, 17)", 0),
    ] {
        scratch.write("room/poses_bounds.npy", npy(shape, &poses[..n]));
        scratch.fails(&TRAIN, "room");
    }
    scratch.write("room/poses_bounds.npy", npy("(99999999999, 17)", &poses));
    scratch.fails(&TRAIN, "poses_bounds.npy");
}

#[test]
fn damaged_pictures_and_points() {
    let scratch = Scratch::with_room("n3dv");
    let picture = "room/cam01/images/0001.png";
    let whole = scratch.read(picture);
    scratch.truncate(picture, 0.5);
    scratch.fails(&TRAIN, "0001.png");
    scratch.write(picture, "not a picture");
    scratch.fails(&TRAIN, "0001.png");
    image::RgbImage::new(31, 24)
        .save(scratch.path(picture))
        .expect("saved");
    scratch.fails(&TRAIN, "0001.png");
    scratch.write(picture, whole);
    scratch.ok(&["info", "room"]);
    for share in [0.0, 0.01, 0.6] {
        let points = scratch.read("room/points3D_downsample2.ply");
        scratch.truncate("room/points3D_downsample2.ply", share);
        scratch.fails(&TRAIN, "points3D_downsample2.ply");
        scratch.fails(
            &["info", "room/points3D_downsample2.ply"],
            "points3D_downsample2.ply",
        );
        scratch.write("room/points3D_downsample2.ply", points);
    }
}

#[test]
fn zero_frames_and_one_camera() {
    let scratch = Scratch::with_room("n3dv");
    for camera in 0..4 {
        for frame in 0..3 {
            let path = scratch.path(&format!("room/cam{camera:02}/images/{frame:04}.png"));
            std::fs::remove_file(path).expect("removed");
        }
    }
    scratch.fails(&TRAIN, "cam00");

    let scratch = Scratch::with_room("n3dv");
    for camera in 1..4 {
        std::fs::remove_dir_all(scratch.path(&format!("room/cam{camera:02}"))).expect("removed");
    }
    scratch.fails(&TRAIN, "room");
    let whole = scratch.read("room/poses_bounds.npy");
    let first: Vec<f64> = whole[whole.len() - 4 * 17 * 8..][..17 * 8]
        .chunks_exact(8)
        .map(|bytes| f64::from_le_bytes(bytes.try_into().expect("8 bytes")))
        .collect();
    scratch.write("room/poses_bounds.npy", npy("(1, 17)", &first));
    scratch.fails(&[&TRAIN[..], &["--test-cameras", "0"]].concat(), "camera");
}

#[test]
fn damaged_transforms() {
    let scratch = Scratch::with_room("blender");
    let path = "room/transforms_train.json";
    let whole = text(&scratch.read(path));
    for share in [0.0, 0.5, 0.99] {
        scratch.truncate(path, share);
        scratch.fails(&TRAIN, "transforms_train.json");
        scratch.write(path, &whole);
    }
    for (from, to) in [
        ("transform_matrix", "matrix"),
        ("\"frames\"", "\"pictures\""),
        ("\"fl_x\": ", "\"fl_x\": -"),
        ("r_0001", "r_9999"),
    ] {
        assert!(whole.contains(from), "{from} in {whole}");
        scratch.write(path, whole.replace(from, to));
        scratch.fails(&TRAIN, "room");
    }
    scratch.write(path, r#"{"camera_angle_x": 0.8, "frames": []}"#);
    scratch.fails(&TRAIN, "transforms_train.json");
}

#[test]
fn damaged_colmap_models() {
    let scratch = Scratch::new();
    let files = colmap_model();
    for image in 0..3 {
        let path = scratch.path(&format!("room/images/{image}.png"));
        std::fs::create_dir_all(path.parent().expect("a parent")).expect("made");
        image::RgbImage::from_fn(16, 12, |x, y| image::Rgb([x as u8 * 9, y as u8 * 9, 50]))
            .save(path)
            .expect("saved");
    }
    let restore = || {
        for (name, bytes) in &files {
            scratch.write(&format!("room/sparse/0/{name}"), bytes);
        }
    };
    restore();
    scratch.ok(&["info", "room"]);
    for (name, _) in &files {
        for share in [0.0, 0.2, 0.7, 0.97] {
            scratch.truncate(&format!("room/sparse/0/{name}"), share);
            scratch.fails(&TRAIN, name);
            restore();
        }
    }
    // A count that promises more than any file holds.
    for (name, bytes) in &files {
        let mut huge = bytes.clone();
        huge[..8].copy_from_slice(&(u64::MAX / 2).to_le_bytes());
        scratch.write(&format!("room/sparse/0/{name}"), huge);
        scratch.fails(&TRAIN, name);
        restore();
    }
    let mut broken = files[1].1.clone();
    broken[12..20].copy_from_slice(&f64::NAN.to_le_bytes());
    scratch.write("room/sparse/0/images.bin", broken);
    scratch.fails(&TRAIN, "images.bin");
}

/// Three images of one pinhole camera, and two points.
fn colmap_model() -> [(&'static str, Vec<u8>); 3] {
    let mut cameras = 1_u64.to_le_bytes().to_vec();
    cameras.extend(1_u32.to_le_bytes());
    // Model 1: PINHOLE.
    cameras.extend(1_i32.to_le_bytes());
    for side in [16_u64, 12] {
        cameras.extend(side.to_le_bytes());
    }
    for parameter in [20.0_f64, 20.0, 8.0, 6.0] {
        cameras.extend(parameter.to_le_bytes());
    }
    let mut images = 3_u64.to_le_bytes().to_vec();
    for image in 0..3_u32 {
        images.extend((image + 1).to_le_bytes());
        for value in [1.0, 0.0, 0.0, 0.0, f64::from(image), 0.0, 0.0] {
            images.extend(value.to_le_bytes());
        }
        images.extend(1_u32.to_le_bytes());
        images.extend(format!("{image}.png\0").as_bytes());
        images.extend(0_u64.to_le_bytes());
    }
    let mut points = 2_u64.to_le_bytes().to_vec();
    for point in 0..2_u64 {
        points.extend(point.to_le_bytes());
        for value in [0.0, point as f64, 4.0] {
            points.extend(value.to_le_bytes());
        }
        points.extend([200, 100, 50]);
        points.extend(0.5_f64.to_le_bytes());
        points.extend(0_u64.to_le_bytes());
    }
    [
        ("cameras.bin", cameras),
        ("images.bin", images),
        ("points3D.bin", points),
    ]
}

#[test]
fn folders_that_cannot_be_written() {
    let scratch = Scratch::with_room("n3dv");
    scratch.train("done");
    scratch.write("file", "not a folder");
    for (folder, place) in [("file", "file/run"), ("/proc", "/proc/run")] {
        scratch.fails(&["synth", place], folder);
        scratch.fails(&["train", "room", "--out", place], place);
        scratch.fails(&["render", "done", "--out", place], place);
        scratch.fails(
            &[
                "render",
                "done",
                "--frames",
                "2",
                "--out",
                &format!("{place}.mp4"),
            ],
            place,
        );
        scratch.fails(
            &[
                "export",
                "done",
                "--time",
                "0",
                "--out",
                &format!("{place}.ply"),
            ],
            place,
        );
    }
    scratch.fails(&["train", "room", "--out", "done"], "done");
    scratch.fails(&["train", "room", "--out", "file"], "file");
    scratch.write("out/full/mine.txt", "kept");
    scratch.fails(&["render", "done", "--out", "out"], "out/full");
    scratch.write("mine/cameras.json", "kept");
    scratch.fails(
        &["render", "done", "--out", "mine"],
        "mine/cameras.json: expected no such file",
    );
}

#[test]
fn datasets_that_change_under_a_run() {
    let scratch = Scratch::with_room("n3dv");
    scratch.train("run");
    let frame = |camera: usize, frame: usize| {
        scratch.path(&format!("room/cam{camera:02}/images/{frame:04}.png"))
    };
    let resume = ["train", "room", "--out", "run", "--resume"];
    for camera in 0..4 {
        for place in (0..3).rev() {
            std::fs::rename(frame(camera, place), frame(camera, place + 1)).expect("renamed");
        }
    }
    scratch.fails(&resume, "found 12 of which some have another name");
    for camera in 0..4 {
        std::fs::remove_file(frame(camera, 3)).expect("removed");
    }
    scratch.fails(
        &resume,
        "room: expected the 12 views that the run was begun with, found 8; the dataset was changed",
    );
}

#[test]
fn damaged_runs() {
    let scratch = Scratch::with_room("n3dv");
    scratch.train("run");
    let commands: [&[&str]; 4] = [
        &["eval", "run"],
        &["render", "run", "--out", "out"],
        &["export", "run", "--time", "0", "--out", "a.ply"],
        &["info", "run"],
    ];
    for (file, shares) in [
        ("scene/scene.json", [0.0, 0.7]),
        ("scene/scene.safetensors", [0.01, 0.9]),
    ] {
        let path = format!("run/{file}");
        let whole = scratch.read(&path);
        for share in shares {
            scratch.truncate(&path, share);
            for command in commands {
                scratch.fails(command, file);
            }
        }
        scratch.write(&path, whole);
    }
    let whole = scratch.read("run/config.toml");
    scratch.truncate("run/config.toml", 0.5);
    scratch.fails(&["eval", "run"], "config.toml");
    scratch.fails(
        &["train", "room", "--out", "run", "--resume"],
        "config.toml",
    );
    // Wherever it is cut off: a part of a number is a number, too.
    for k in 0..24 {
        let end = whole.len() * k / 24;
        let last_line = whole[..end].iter().rposition(|&byte| byte == b'\n');
        for end in [Some(end), last_line.map(|at| at + 1)]
            .into_iter()
            .flatten()
        {
            scratch.write("run/config.toml", &whole[..end]);
            scratch.fails(&["info", "run"], "config.toml");
        }
    }
    for gone in 1..4 {
        scratch.write("run/config.toml", &whole[..whole.len() - gone]);
        scratch.fails(&["info", "run"], "config.toml");
    }
    scratch.write("run/config.toml", whole);

    let resume = ["train", "room", "--out", "run", "--resume"];
    scratch.truncate("run/checkpoints/000030/optimizer.safetensors", 0.5);
    for part in [
        "run/checkpoints/000030: expected a complete checkpoint, found optimizer.safetensors: ",
        "; remove its folder to go back to the one before",
    ] {
        scratch.fails(&resume, part);
    }
    std::fs::remove_file(scratch.path("run/checkpoints/000030/scene/scene.json")).expect("removed");
    scratch.fails(
        &resume,
        "000030: expected a complete checkpoint, found scene/scene.json: no such file",
    );
    std::fs::remove_dir_all(scratch.path("run/checkpoints/000030")).expect("removed");
    let path = "run/checkpoints/000020/state.json";
    let whole = scratch.read(path);
    for (list, claim, complaint) in [
        ("\"left\":[", "4000000000", "view 4000000000"),
        ("\"held_still\":[", "true", "marks of static Gaussians"),
    ] {
        let state = text(&whole);
        let start = state.find(list).expect("a list") + list.len();
        let end = start + state[start..].find(']').expect("its end");
        scratch.write(path, format!("{}{claim}{}", &state[..start], &state[end..]));
        scratch.fails(&["train", "room", "--out", "run", "--resume"], complaint);
    }
    scratch.write(path, whole);
    scratch.truncate("run/checkpoints/000020/optimizer.safetensors", 0.5);
    scratch.fails(&resume, "optimizer.safetensors");
    scratch.fails(&resume, "remove its folder to begin the run again");
    scratch.truncate("run/checkpoints/000020/state.json", 0.5);
    scratch.fails(&["train", "room", "--out", "run", "--resume"], "state.json");

    std::fs::remove_file(scratch.path("run/scene/scene.json")).expect("removed");
    scratch.fails(&["eval", "run"], "run");
    std::fs::remove_dir_all(scratch.path("room")).expect("removed");
    scratch.fails(&["train", "room", "--out", "run", "--resume"], "room");
}

#[test]
fn damaged_camera_files_and_exported_scenes() {
    let scratch = Scratch::with_room("n3dv");
    scratch.train("run");
    scratch.ok(&["export", "run", "--time", "0", "--out", "a.ply"]);
    let good = r#"[{"id": 0, "img_name": "a", "width": 16, "height": 12, "position": [0, 1, 4],
        "rotation": [[1, 0, 0], [0, -1, 0], [0, 0, -1]], "fx": 20, "fy": 20}]"#;
    scratch.write("c.json", good);
    let render = ["render", "a.ply", "--cameras", "c.json", "--out", "out"];
    for (from, to) in [
        ("20}]", "20"),
        ("[{", "{"),
        ("\"fx\": 20", "\"fx\": 0"),
        ("\"fx\": 20", "\"fy\": 20"),
        ("[0, 1, 4]", "[0, 1]"),
        ("[1, 0, 0]", "[1, 0, 1e999]"),
        ("[1, 0, 0]", "[0, 0, 0]"),
        ("\"width\": 16", "\"width\": 0"),
        (good, "[]"),
        (good, r#"{"cameras": []}"#),
        (good, r#"{"frames": []}"#),
    ] {
        let bad = good.replace(from, to);
        assert_ne!(bad, good, "{from}");
        scratch.write("c.json", bad);
        scratch.fails(&render, "c.json");
    }
    scratch.write("c.json", good);
    let whole = scratch.read("a.ply");
    for share in [0.0, 0.01, 0.5, 0.999] {
        scratch.truncate("a.ply", share);
        scratch.fails(&render, "a.ply");
        scratch.fails(&["info", "a.ply"], "a.ply");
        scratch.write("a.ply", &whole);
    }
    scratch.ok(&render);
}

#[test]
fn ffmpeg_is_missing() {
    let scratch = Scratch::with_room("n3dv");
    scratch.train("run");
    let without = |args: &[&str]| {
        let mut command = scratch.command(args);
        command.env("PATH", "");
        command
    };
    scratch.fails_as(without(&["synth", "clip", "--video"]), "ffmpeg");
    scratch.fails_as(
        without(&["render", "run", "--frames", "2", "--out", "clip.mp4"]),
        "ffmpeg",
    );
    for camera in 0..4 {
        std::fs::remove_dir_all(scratch.path(&format!("room/cam{camera:02}"))).expect("removed");
        scratch.write(&format!("room/cam{camera:02}.mp4"), "no video either");
    }
    scratch.fails_as(without(&["train", "room", "--out", "again"]), "ffmpeg");
}

#[test]
fn options_that_do_not_fit_the_data() {
    let scratch = Scratch::with_room("n3dv");
    scratch.fails(
        &[&TRAIN[..], &["--test-cameras", "9"]].concat(),
        "--test-cameras",
    );
    scratch.fails(
        &[&TRAIN[..], &["--test-cameras", "0,1,2,3"]].concat(),
        "room",
    );
    scratch.fails(&[&TRAIN[..], &["--memory", "1kB"]].concat(), "--memory");
    scratch.fails(&[&TRAIN[..], &["--frames", "7-9"]].concat(), "--frames");
    scratch.fails(&[&TRAIN[..], &["--layout", "colmap"]].concat(), "room");
    scratch.fails(&[&TRAIN[..], &["--device", "cuda:99"]].concat(), "cuda:99");
    scratch.write("c.toml", "[loss]\ndsim = 1\n");
    scratch.fails(&[&TRAIN[..], &["--config", "c.toml"]].concat(), "c.toml");
    scratch.write("c.toml", "[loss\n");
    scratch.fails(&[&TRAIN[..], &["--config", "c.toml"]].concat(), "c.toml");
    let args = [
        "train",
        "room",
        "--out",
        "run",
        "--test-cameras",
        "none",
        "--iterations",
        "5",
    ];
    scratch.ok(&[&args[..], &TINY[..]].concat());
    scratch.fails(&["eval", "run"], "test");
    scratch.fails(&["render", "run", "--out", "out"], "test views");
}

#[test]
fn broken_images_are_left_out_where_asked() {
    let scratch = Scratch::with_room("technicolor");
    let name = "Synth_undist_00001_02.png";
    scratch.write(&format!("room/{name}"), "damaged");
    scratch.fails(&TRAIN, name);
    scratch.ok(&[&TRAIN[..], &TINY, &["--skip-broken"]].concat());
    let config = String::from_utf8_lossy(&scratch.read("run/config.toml")).into_owned();
    assert!(config.contains("skip_broken = true"), "{config}");
}
