use super::super::frames::FrameSize;
use super::super::sources::{Recording, find};
use super::super::{LensChoice, PrepareConfig};
use super::{Bench, H, W, assert_close, exists, known};
use crate::dataset::poses::known as known_poses;
use crate::dataset::{Layout, LoadOptions, Partition, load};
use crate::test_kit::{ffmpeg, grey_frames, run};

/// Random points with known poses: nothing that needs COLMAP.
fn config(bench: &Bench, n_cameras: usize) -> PrepareConfig {
    PrepareConfig {
        poses: Some(bench.poses(n_cameras)),
        random_points: Some(200),
        ..PrepareConfig::default()
    }
}

#[test]
fn image_folders_become_a_dataset_with_the_same_cameras() {
    let bench = Bench::new();
    bench.image_folders(3, 4);
    let config = config(&bench, 3);
    let summary = bench.prepare(&config).expect("prepares");
    assert_eq!(
        (summary.n_cameras, summary.n_frames, summary.n_points),
        (3, 4, 200)
    );
    assert_eq!(summary.held_out, ["cam0"]);
    let made = bench.path("out/made");
    assert_eq!(bench.shades("cam1"), [40, 41, 42, 43]);
    let dataset = load(&made, &LoadOptions::default()).expect("loads");
    assert_eq!(dataset.layout, Layout::Blender);
    assert_eq!((dataset.n_cameras, dataset.n_frames), (3, 4));
    let rate = dataset.frame_rate.expect("it states seconds");
    assert!((rate / summary.fps - 1.0).abs() < 1e-9, "{rate}");
    assert_eq!(
        dataset.points.as_ref().map(|points| points.len()),
        Some(200)
    );
    for view in &dataset.views {
        assert_eq!(
            view.camera_name,
            format!("cam{}", view.camera_index),
            "{}",
            view.name
        );
        assert_eq!(
            view.partition == Partition::Test,
            view.camera_name == "cam0"
        );
        assert_eq!(view.time, view.frame as f32 / 3.0);
    }
    let names: Vec<String> = (1..3).map(|index| format!("cam{index}")).collect();
    let sizes = [[W, H]; 2];
    let train =
        known_poses::read(&made.join("transforms_train.json"), &names, &sizes).expect("reads");
    for (index, got) in train.iter().enumerate() {
        assert_close(got, &known(index + 1));
    }
}

#[test]
fn smaller_frames_have_smaller_intrinsics_and_no_camera_need_be_held_out() {
    let bench = Bench::new();
    bench.image_folders(2, 1);
    let config = PrepareConfig {
        size: FrameSize::Height(H / 2),
        test_cameras: Vec::new(),
        ..config(&bench, 2)
    };
    bench.prepare(&config).expect("prepares");
    let made = bench.path("out/made");
    assert!(!exists(&made, "transforms_train.json"));
    let size = image::image_dimensions(made.join("cam1/images/0000.png")).expect("an image");
    assert_eq!(size, (W as u32 / 2, H as u32 / 2));
    let names = ["cam0".to_string(), "cam1".to_string()];
    let half = [[W / 2, H / 2]; 2];
    let cameras = known_poses::read(&made.join("transforms.json"), &names, &half).expect("reads");
    assert_close(&cameras[1], &known(1).resized(half[0]));
    for (size, expected) in [
        (FrameSize::Height(100), [W, H]),
        (FrameSize::Downscale(3.0), [5, 4]),
        (FrameSize::Downscale(1e9), [1, 1]),
    ] {
        assert_eq!(size.of([W, H]), expected, "{size:?}");
    }
}

#[test]
fn numbered_images_are_cut_to_the_frames_that_all_cameras_have() {
    let bench = Bench::new();
    bench.image_folders(2, 6);
    std::fs::remove_file(bench.path("input/cam1/0000.png")).expect("removed");
    std::fs::remove_file(bench.path("input/cam0/0005.png")).expect("removed");
    let summary = bench.prepare(&config(&bench, 2)).expect("prepares");
    assert_eq!(bench.shades("cam0"), [1, 2, 3, 4]);
    assert_eq!(bench.shades("cam1"), [41, 42, 43, 44]);
    assert!(
        summary.remarks[0].contains("cam0 1 at the start"),
        "{summary}"
    );
}

#[test]
fn frames_that_a_camera_lost_are_left_out_and_told() {
    let bench = Bench::new();
    bench.image_folders(3, 6);
    for frame in 2..4 {
        let path = bench.path(&format!("input/cam1/{frame:04}.png"));
        std::fs::remove_file(path).expect("removed");
    }
    let summary = bench.prepare(&config(&bench, 3)).expect("prepares");
    let told = "left out: cam1 has none at 2 of 6 times";
    assert!(
        summary.remarks.iter().any(|remark| remark.contains(told)),
        "{summary}"
    );
    assert_eq!(bench.shades("cam0"), [0, 1, 2, 3, 4, 5]);
    assert_eq!(bench.shades("cam1"), [40, 41, 44, 45]);
    let dataset = load(&bench.path("out/made"), &LoadOptions::default()).expect("loads");
    let of_second = dataset
        .views
        .iter()
        .filter(|view| view.camera_name == "cam1");
    let frames: Vec<usize> = of_second.map(|view| view.frame).collect();
    assert_eq!(frames, [0, 1, 4, 5]);
    assert_eq!(dataset.n_frames, 6);
}

#[test]
fn images_whose_names_hide_their_order_are_refused() {
    for names in [
        ["-1", "0", "1"],
        ["t9.05", "t9.1", "t9.15"],
        ["feb", "jan", "mar"],
    ] {
        let bench = Bench::new();
        bench.image_folders(1, 3);
        for name in names {
            bench.image(&format!("input/cam1/{name}.png"), 40);
        }
        bench.refuses(
            &config(&bench, 2),
            &["cam1", "in the order of time", "rename"],
        );
    }
}

#[test]
fn offsets_shift_a_camera_and_unknown_names_are_told() {
    let bench = Bench::new();
    bench.image_folders(2, 6);
    let with = |bench: &Bench, text: &str| PrepareConfig {
        image_rate: 10.0,
        offsets: Some(bench.write("offsets.json", text)),
        ..config(bench, 2)
    };
    for (text, word) in [
        ("{\"cam7\": 0.1}", "cam7"),
        ("[0.1]", "offsets.json"),
        ("{\"cam1\": \"late\"}", "offsets.json"),
        ("{\"cam1\": 100}", "--offsets"),
    ] {
        bench.refuses(&with(&bench, text), &[word]);
    }
    bench
        .prepare(&with(&bench, "{\"cam1\": 0.2}"))
        .expect("prepares");
    assert_eq!(bench.shades("cam0"), [0, 1, 2, 3]);
    assert_eq!(bench.shades("cam1"), [42, 43, 44, 45]);
}

#[test]
fn cameras_are_found_as_videos_folders_or_single_images() {
    let names = |bench: &Bench| -> Vec<String> {
        find(&bench.path("input"))
            .expect("cameras")
            .into_iter()
            .map(|source| source.name)
            .collect()
    };
    let bench = Bench::new();
    bench.image_folders(11, 1);
    assert_eq!(
        names(&bench)[..3],
        ["cam0", "cam1", "cam2"],
        "in natural order"
    );
    assert_eq!(names(&bench)[10], "cam10");
    bench.write("input/b.MOV", "");
    bench.write("input/a.mp4", "");
    assert_eq!(names(&bench), ["a", "b"], "videos come first");
    bench.write("input/a.mkv", "");
    assert!(
        find(&bench.path("input"))
            .expect_err("twice")
            .to_string()
            .contains("`a`")
    );

    let bench = Bench::new();
    bench.write("input/notes.txt", "");
    find(&bench.path("input")).expect_err("no cameras");
    bench.image("input/images/x1.png", 1);
    let error = find(&bench.path("input"))
        .expect_err("one camera")
        .to_string();
    assert!(error.contains("x1"), "{error}");
    bench.image("input/images/x2.png", 1);
    let sources = find(&bench.path("input")).expect("cameras");
    assert_eq!(sources.len(), 2);
    assert!(matches!(&sources[0].recording, Recording::Images(images) if images.len() == 1));
}

/// Encodes frames whose shade is three times their index, at 20 frames a second.
fn video(bench: &Bench, name: &str, n_frames: usize, encoder: &[&str]) {
    let shades = (0..n_frames).map(|frame| 3 * frame);
    let frames = grey_frames(bench, &format!("{name}.frames"), [W, H], shades);
    let mut command = ffmpeg();
    command.args(["-framerate", "20", "-i"]).arg(frames);
    run(command
        .args(encoder)
        .arg(bench.path(&format!("input/{name}"))));
}

#[test]
fn videos_give_the_frames_nearest_to_each_time() {
    let bench = Bench::new();
    // Frames that are stored in another order than they are shown in, and ones with rounded times.
    let h264 = [
        "-c:v", "libx264", "-qp", "0", "-pix_fmt", "yuv444p", "-bf", "2",
    ];
    let ffv1 = ["-c:v", "ffv1", "-pix_fmt", "yuv444p"];
    video(&bench, "cam0.mp4", 80, &h264);
    video(&bench, "cam1.mkv", 74, &ffv1);
    let base = config(&bench, 2);
    let shades = |config: &PrepareConfig| {
        let summary = bench.prepare(config).expect("prepares");
        let shades = [bench.shades("cam0"), bench.shades("cam1")];
        std::fs::remove_dir_all(bench.path("out/made")).expect("removed");
        (shades, summary)
    };
    // Colour conversion may be off by a shade; frames are three apart.
    let assert_frames = |got: &[u8], expected: &[usize]| {
        let frames: Vec<usize> = got
            .iter()
            .map(|shade| usize::from((shade + 1) / 3))
            .collect();
        assert_eq!(frames, expected);
    };

    let ([first, second], summary) = shades(&base);
    let all: Vec<usize> = (0..74).collect();
    assert_frames(&first, &all);
    assert_frames(&second, &all);
    assert!(
        summary.remarks[0].contains("cam0 0 at the start and 6 at the end"),
        "{summary}"
    );

    // Far enough into the video that decoding begins later than its start.
    let part = PrepareConfig {
        fps: Some(5.0),
        start: Some(3.0),
        end: Some(3.6),
        size: FrameSize::Downscale(2.0),
        offsets: Some(bench.write("offsets.json", "{\"cam0\": 0.26}")),
        ..base
    };
    let ([first, second], _) = shades(&part);
    // Frame 60 is shown at 3 s; 0.26 s are 5.2 frames.
    assert_frames(&first, &[65, 69, 73, 77]);
    assert_frames(&second, &[60, 64, 68, 72]);
}

#[test]
fn a_broken_video_and_options_that_do_not_fit() {
    let bench = Bench::new();
    bench.write("input/cam0.mp4", "not a video");
    bench.write("input/cam1.mp4", "neither");
    bench.refuses(&config(&bench, 2), &["cam", "ffmpeg"]);
    std::fs::remove_dir_all(bench.path("input")).expect("removed");
    bench.image_folders(2, 2);
    let base = config(&bench, 2);
    for (change, word) in [
        (
            PrepareConfig {
                fps: Some(0.0),
                ..base.clone()
            },
            "--fps",
        ),
        (
            PrepareConfig {
                image_rate: f64::NAN,
                ..base.clone()
            },
            "--image-fps",
        ),
        (
            PrepareConfig {
                start: Some(2.0),
                end: Some(1.0),
                ..base.clone()
            },
            "--end",
        ),
        (
            PrepareConfig {
                start: Some(f64::INFINITY),
                ..base.clone()
            },
            "--start",
        ),
        (
            PrepareConfig {
                size: FrameSize::Height(0),
                ..base.clone()
            },
            "--height",
        ),
        (
            PrepareConfig {
                size: FrameSize::Downscale(0.5),
                ..base.clone()
            },
            "--downscale",
        ),
        (
            PrepareConfig {
                random_points: Some(0),
                ..base.clone()
            },
            "--random-points",
        ),
        (
            PrepareConfig {
                max_points: 0,
                ..base.clone()
            },
            "--max-points",
        ),
        (
            PrepareConfig {
                poses: None,
                lens: LensChoice::Own,
                ..base.clone()
            },
            "--poses",
        ),
        (
            PrepareConfig {
                test_cameras: vec![2],
                ..base.clone()
            },
            "--test-cameras",
        ),
        (
            PrepareConfig {
                test_cameras: vec![0, 1],
                ..base.clone()
            },
            "--test-cameras",
        ),
        (
            PrepareConfig {
                poses: Some("none.npy".into()),
                ..base.clone()
            },
            "none.npy",
        ),
    ] {
        bench.refuses(&change, &[word]);
    }
    let mut folding = known(0);
    folding.distortion.k[0] = -30.0;
    let frames = [super::frame(0, &folding), super::frame(1, &known(1))];
    let poses = bench.write(
        "folding.json",
        serde_json::json!({ "frames": frames }).to_string(),
    );
    let folding = PrepareConfig {
        poses: Some(poses),
        ..base.clone()
    };
    bench.refuses(&folding, &["input", "-30", "cam0", "undistort"]);
    bench.write("out/made/precious.txt", "mine");
    let error = bench.prepare(&base).expect_err("not empty").to_string();
    assert!(
        error.contains("made") && error.contains("files in it"),
        "{error}"
    );
    assert!(exists(&bench.path("out/made"), "precious.txt"));
}
