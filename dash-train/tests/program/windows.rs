//! `dash plan train`: a long clip in windows of time.

use crate::common::{Scratch, TINY};
use burn::tensor::Device;
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
    for line in [
        "window-000     0 to 4",
        "window-002     4 to 8",
        "mean over",
    ] {
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
    // A window's frame at rest has its Gaussians, one of an overlap those of both.
    let folder = scratch.path("all");
    let clip = WindowedClip::open(&folder, &Device::flex()).expect("planned");
    let of_frame = |frame: usize| clip.frame(frame).expect("trained").counts().0;
    let of_window = |name: &str| {
        let run = RunFolder::open(&folder.join(name)).expect("a run");
        let (n_static, n_dynamic) = run.scene(&Device::flex()).expect("trained").counts();
        n_static + n_dynamic
    };
    let [first, second] = ["window-000", "window-001"].map(of_window);
    assert_eq!(
        (of_frame(1), of_frame(3), of_frame(4)),
        (first, first + second, second)
    );
    // Done windows stay; others are not taken for them.
    scratch.ok(&planned(&[]));
    scratch.fails(&planned(&["--seed", "1"]), "windows.toml differs");
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
    let no_views = planned(&["--test-cameras", "none"]);
    scratch.fails(&no_views, "--test-cameras");
}
