//! `dash train --window` and `dash plan train`: a long clip in windows of time.

use crate::common::{Scratch, TINY};
use burn::tensor::Device;
use dash_model::DynamicScene;
use dash_train::splat_scene;
use dash_train::train::RunFolder;
use dash_train::windows::WindowedClip;

/// A clip of nine frames in three windows.
fn planned<'a>(more: &[&'a str]) -> Vec<&'a str> {
    let mut args = vec!["plan", "train", "room", "--out", "all", "--window", "5"];
    args.extend(["--overlap", "2", "--preset", "quick", "--iterations", "20"]);
    args.extend(TINY);
    args.extend(more);
    args
}

#[test]
fn windows_share_a_room_that_is_trained_first() {
    let scratch = clip();
    let told = scratch.ok(&planned(&["--room", "yes"]));
    assert!(
        told.contains("4 tasks") && told.contains("0  room"),
        "{told}"
    );
    // A window alone needs the room.
    scratch.ok(&["work", "all", "--task", "2"]);
    scratch.fails(&["join", "all"], "window-000, window-002");
    scratch.ok(&["work", "all"]);
    let told = scratch.ok(&["join", "all"]);
    assert!(told.contains("room        0, 2, .."), "{told}");
    let folder = scratch.path("all");
    let device = Device::flex();
    let clip = WindowedClip::open(&folder, &device).expect("planned");
    let of_run = |name: &str| {
        let run = RunFolder::open(&folder.join(name)).expect("a run");
        let own = DynamicScene::load(&run.scene_path(), &device).expect("trained");
        (own.counts(), run.scene(&device).expect("trained").counts())
    };
    let ((room, _), _) = of_run("room");
    for (number, name) in ["window-000", "window-001"].into_iter().enumerate() {
        let (own, whole) = of_run(name);
        assert!(
            whole.0 > own.0 && whole.0 <= own.0 + room,
            "{own:?} {whole:?}"
        );
        assert_eq!(clip.scene(number).expect("trained").counts(), whole);
        let results: serde_json::Value =
            serde_json::from_slice(&scratch.read(&format!("all/{name}/results.json")))
                .expect("JSON");
        assert_eq!(results["n_static"].as_u64(), Some(whole.0 as u64));
    }
    // What is kept of a room that is another one now is not known.
    let rooms = folder.join("room").join("scene");
    std::fs::remove_dir_all(&rooms).expect("removable");
    std::fs::rename(folder.join("window-002").join("scene"), &rooms).expect("movable");
    scratch.fails(
        &[
            "render",
            "all/window-000",
            "--cameras",
            "test",
            "--out",
            "no",
        ],
        "backdrop",
    );
}

fn clip() -> Scratch {
    let scratch = Scratch::new();
    let mut args = vec!["synth", "room", "--cameras", "4", "--frames", "9"];
    args.extend(["--size", "32x24"]);
    scratch.ok(&args);
    scratch
}

#[test]
fn windows_are_trained_by_themselves_and_shown_as_one_clip() {
    let scratch = clip();
    let told = scratch.ok(&planned(&[]));
    assert!(
        told.contains("3 tasks") && told.contains("2  window-002"),
        "{told}"
    );
    scratch.fails(&["render", "all", "--cameras", "test"], "window-000");
    scratch.ok(&["work", "all"]);
    let told = scratch.ok(&["join", "all"]);
    for line in ["window-000  0 to 4 ", "window-002  4 to 8 ", "mean over"] {
        assert!(told.contains(line), "{line}:\n{told}");
    }
    // Each window is a run of five frames, the clip has nine.
    scratch.ok(&[
        "render",
        "all/window-001",
        "--cameras",
        "test",
        "--out",
        "one",
    ]);
    scratch.ok(&[
        "render",
        "all",
        "--cameras",
        "test",
        "--layers",
        "full,dynamic",
    ]);
    let pictures = |folder: &str| {
        let entries = std::fs::read_dir(scratch.path(folder)).expect("listed");
        entries.count()
    };
    assert_eq!((pictures("one/full"), pictures("all/renders/full")), (5, 9));
    // Frame 3 is the middle of the first overlap, frames 2 to 4: half of one picture and half of the other. Frame 1 is the first
    // window's alone.
    scratch.ok(&[
        "render",
        "all/window-000",
        "--cameras",
        "test",
        "--out",
        "first",
    ]);
    let picture = |path: &str| {
        let image = image::load_from_memory(&scratch.read(path)).expect("a picture");
        image.to_rgb8().into_raw()
    };
    let [clip, first, second] = [
        "all/renders/full/0003_cam00.png",
        "first/full/0003_cam00.png",
        "one/full/0001_cam00.png",
    ]
    .map(picture);
    let both = first.iter().zip(&second);
    let mean = both.map(|(a, b)| (f64::from(*a) + f64::from(*b)) / 2.0);
    let off = mean
        .zip(&clip)
        .map(|(mean, v)| (mean - f64::from(*v)).abs());
    assert!(
        off.fold(0.0, f64::max) <= 1.0,
        "not the mean of both windows"
    );
    assert_ne!(first, second);
    let alone = [
        "all/renders/full/0001_cam00.png",
        "first/full/0001_cam00.png",
    ]
    .map(picture);
    assert_eq!(alone[0], alone[1]);
    // An instant of a window has its Gaussians, one of an overlap those of both.
    let of_frame = |frame: usize| {
        let time = format!("{}", frame as f32 / 8.0);
        scratch.ok(&["export", "all", "--time", &time, "--out", "instant.ply"]);
        let scene = splat_scene(&scratch.path("instant.ply"), &Device::flex());
        scene.expect("a file of Gaussians").counts().0
    };
    let of_window = |name: &str| {
        let run = RunFolder::open(&scratch.path("all").join(name)).expect("a run");
        let (n_static, n_dynamic) = run.scene(&Device::flex()).expect("trained").counts();
        n_static + n_dynamic
    };
    let [first, second] = ["window-000", "window-001"].map(of_window);
    assert_eq!(
        [of_frame(1), of_frame(3), of_frame(4)],
        [first, first + second, second]
    );
    // One file of all windows.
    let told = scratch.ok(&["export", "all", "--out", "all.4dgs"]);
    assert!(told.contains("9 frames") && told.contains(" dB"), "{told}");
    let cameras = ["--cameras", "all/renders/cameras.json", "--out", "of_file"];
    scratch.ok(&[&["render", "all.4dgs"], &cameras[..]].concat());
    assert_eq!(pictures("of_file/full"), 9);
    // Scores of the clip are those of what is drawn; where windows fade, neither window's.
    let report = ["report", "all", "all/window-000", "--out", "page"];
    scratch.fails(&report, "all: expected a clip that is scored");
    let told = scratch.ok(&["eval", "all"]);
    assert!(told.contains("all/results.json"), "{told}");
    scratch.ok(&report);
    let page = String::from_utf8(scratch.read("page/report.html")).expect("text");
    assert!(page.contains("window-000") && page.contains(">all<"));
    let results = |name: &str| -> serde_json::Value {
        serde_json::from_slice(&scratch.read(&format!("{name}/results.json"))).expect("JSON")
    };
    let (clip, first) = (results("all"), results("all/window-000"));
    let of_frame = |results: &serde_json::Value, frame: usize| {
        let views = results["per_view"].as_array().expect("views").clone();
        let frame = views.into_iter().filter(|view| view["frame"] == frame);
        frame.map(|view| view["psnr"].as_f64()).collect::<Vec<_>>()
    };
    assert_eq!(clip["per_view"].as_array().map(Vec::len), Some(9));
    assert_eq!(of_frame(&clip, 1), of_frame(&first, 1));
    assert_ne!(of_frame(&clip, 3), of_frame(&first, 3));
    let sum = |key: &str| {
        let windows = (0..3).map(|k| results(&format!("all/window-00{k}")));
        windows
            .map(|of| of[key].as_u64().expect("a number"))
            .sum::<u64>()
    };
    for key in ["iterations", "storage_bytes", "n_static", "n_dynamic"] {
        assert_eq!(clip[key].as_u64(), Some(sum(key)), "{key}");
    }
    // Done windows stay; others are not taken for them.
    scratch.ok(&planned(&[]));
    scratch.fails(&planned(&["--seed", "1"]), "windows.toml differs");
    // One command plans, works and joins, and goes on with what there is.
    let at_once = planned(&[]);
    std::fs::remove_dir_all(scratch.path("all/window-001")).expect("removable");
    let told = scratch.ok(&at_once[1..]);
    let tally = told.contains("1 done, 2 done before");
    assert!(tally && told.contains("window-002  4 to 8 "), "{told}");
}

#[test]
fn windows_share_a_budget() {
    let scratch = clip();
    let mut args = vec!["train", "room", "--out", "all", "--preset", "quick"];
    args.extend(["--window", "5", "--overlap", "2", "--budget", "1s"]);
    args.extend(TINY);
    scratch.ok(&args);
    let steps = |scratch: &Scratch| {
        let text = String::from_utf8(scratch.read("all/windows.toml")).expect("text");
        let windows: toml::Table = text.parse().expect("TOML");
        windows["train"]["iterations"].as_integer()
    };
    let found = steps(&scratch);
    assert!(found >= Some(1), "{found:?}");
    // The steps that were found once stay.
    std::fs::remove_dir_all(scratch.path("all/window-001")).expect("removable");
    let told = scratch.ok(&args);
    assert!(told.contains("1 done, 2 done before"), "{told}");
    assert_eq!(steps(&scratch), found);
}

#[test]
fn a_long_clip_of_a_rig_is_cut_without_being_asked() {
    let scratch = Scratch::new();
    let synth = [
        "synth",
        "long",
        "--cameras",
        "5",
        "--frames",
        "301",
        "--size",
        "16x16",
    ];
    scratch.ok(&synth);
    let train = |more: &[&'static str]| {
        let mut args = vec!["train", "long", "--preset", "quick", "--iterations", "6"];
        args.extend(TINY);
        args.extend(more);
        args
    };
    let told = scratch.ok(&train(&["--out", "all"]));
    assert!(told.contains("window-005  241 to 300 "), "{told}");
    let refused = scratch.is_wrong_usage(&train(&["--out", "all", "--resume"]));
    assert!(refused.contains("without --resume"), "{refused}");
    scratch.ok(&train(&["--out", "one", "--window", "none"]));
    assert!(RunFolder::open(&scratch.path("one")).is_ok());
    let refused = scratch.is_wrong_usage(&train(&["--out", "no", "--window", "some"]));
    assert!(
        refused.contains("expected a number of frames or none"),
        "{refused}"
    );
}

#[test]
fn what_needs_no_windows_is_refused() {
    let scratch = clip();
    let with = |window: &'static str, overlap: &'static str, more: &[&'static str]| {
        let mut args = vec!["plan", "train", "room", "--out", "all", "--preset", "quick"];
        args.extend(["--window", window, "--overlap", overlap]);
        args.extend(more);
        scratch.is_wrong_usage(&args)
    };
    assert!(with("9", "2", &[]).contains("--window"));
    assert!(with("6", "3", &[]).contains("--overlap"));
    assert!(with("5", "2", &["--frames", "0-5"]).contains("--frames"));
    let watched = planned(&["--tensorboard", "curves"]);
    assert!(
        scratch
            .is_wrong_usage(&watched[1..])
            .contains("--tensorboard")
    );
    let resumed = planned(&["--resume"]);
    assert!(scratch.is_wrong_usage(&resumed[1..]).contains("--resume"));
    let no_views = planned(&["--test-cameras", "none"]);
    scratch.fails(&no_views, "--test-cameras");
}
