//! `dash doctor` from outside: what it prints, writes and exits with.

use crate::common::{Scratch, text};
use serde_json::Value;

#[test]
fn a_clean_dataset_is_one_line_per_finding_and_exit_0() {
    let scratch = Scratch::with_room("n3dv");
    let lines = scratch.ok(&["doctor", "room"]);
    for line in lines.lines() {
        let severity = line.split_whitespace().next();
        assert!(severity == Some("ok") || severity == Some("note"), "{line}");
    }
    assert!(lines.contains("4 cameras x 3 frames"), "{lines}");
    for part in ["--preset quick", "--preset default", "timed steps"] {
        assert!(lines.contains(part), "{part} in {lines}");
    }
    assert!(!scratch.path("doctor.png").exists(), "only when asked");

    let untimed = scratch.ok(&["doctor", "room", "--picture", "--no-timing"]);
    assert!(!untimed.contains("--preset"), "{untimed}");
    assert_eq!(
        image::image_dimensions(scratch.path("doctor.png")).expect("a picture"),
        (1600, 880)
    );
    scratch.ok(&["doctor", "room", "--picture", "room.png"]);
    assert_eq!(scratch.read("doctor.png"), scratch.read("room.png"));
}

#[test]
fn an_error_among_the_findings_is_exit_1_with_the_findings_on_stdout() {
    let scratch = Scratch::with_room("n3dv");
    scratch.truncate("room/cam01/images/0001.png", 0.5);
    let output = scratch
        .command(&["doctor", "room", "--json"])
        .output()
        .expect("starts");
    assert_eq!(output.status.code(), Some(1));
    let stderr = text(&output.stderr);
    assert_eq!(
        stderr.trim_end(),
        "error: room: 1 error in the dataset, named above"
    );
    let found: Value = serde_json::from_slice(&output.stdout).expect("JSON");
    assert_eq!(found["worst"], "error");
    let findings = found["findings"].as_array().expect("a list");
    let errors: Vec<&Value> = findings
        .iter()
        .filter(|f| f["severity"] == "error")
        .collect();
    assert_eq!(errors.len(), 1, "{found}");
    let named = errors[0]["text"].as_str().expect("text");
    assert!(named.contains("cam01/images/0001.png"), "{named}");
    assert!(errors[0]["mend"].is_string(), "{found}");
}

#[test]
fn options_are_those_of_training() {
    let scratch = Scratch::with_room("n3dv");
    let lines = scratch.ok(&[
        "doctor",
        "room",
        "--downscale",
        "2",
        "--test-cameras",
        "2",
        "--memory",
        "1kB",
    ]);
    for part in [
        "16x12",
        "3 to test (cam02)",
        "note     memory",
        "--downscale",
    ] {
        assert!(lines.contains(part), "{part} in {lines}");
    }
    scratch.is_wrong_usage(&["doctor"]);
    scratch.is_wrong_usage(&["doctor", "room", "--downscale", "0"]);
    let output = scratch
        .command(&["doctor", "room", "--layout", "colmap"])
        .output()
        .expect("starts");
    assert_eq!(output.status.code(), Some(1));
    assert!(text(&output.stdout).contains("as --layout says"));
}

/// The dataset `room` in blender's layout with its cameras changed, by their index.
fn with_cameras(change: impl Fn(usize, &mut Value)) -> Scratch {
    let scratch = Scratch::with_room("blender");
    let mut poses: Value =
        serde_json::from_slice(&scratch.read("room/transforms_train.json")).expect("JSON");
    let frames = poses["frames"].as_array_mut().expect("a list");
    for (index, frame) in frames.iter_mut().enumerate() {
        change(index, &mut frame["transform_matrix"]);
    }
    std::fs::remove_file(scratch.path("room/points3d.ply")).expect("there is one");
    scratch.write("room/transforms_train.json", poses.to_string());
    scratch
}

#[test]
fn training_says_before_it_begins_what_the_doctor_says() {
    let turn = |index: usize, pose: &mut Value| {
        let (s, c) = (0.03 * index as f64).sin_cos();
        *pose = serde_json::json!([[c, 0, s, 2.5], [0, 1, 0, 0.5], [-s, 0, c, 3], [0, 0, 0, 1]]);
    };
    let stand = |_: usize, pose: &mut Value| turn(0, pose);
    for (scratch, part) in [
        (with_cameras(turn), "a camera that only turns"),
        (with_cameras(stand), "a fixed camera"),
    ] {
        let found = scratch.ok(&["doctor", "room", "--no-timing"]);
        let line = found.lines().find(|line| line.contains("no parallax"));
        let line = line.unwrap_or_else(|| panic!("nothing of parallax in {found}"));
        assert!(line.starts_with("warning") && line.contains(part), "{line}");
        let said = line
            .split("no parallax")
            .nth(1)
            .and_then(|rest| rest.split(" -> ").next());
        let train = [
            "train",
            "room",
            "--out",
            "run",
            "--preset",
            "quick",
            "--iterations",
            "20",
        ];
        let output = scratch.command(&train).output().expect("starts");
        let stderr = text(&output.stderr);
        assert!(output.status.success(), "{stderr}");
        assert!(stderr.contains(said.expect("the rest")), "{line}: {stderr}");
    }
    let scratch = Scratch::new();
    scratch.ok(&[
        "synth",
        "one",
        "--layout",
        "colmap",
        "--cameras",
        "2",
        "--frames",
        "1",
        "--size",
        "32x24",
    ]);
    std::fs::remove_file(scratch.path("one/sparse/0/points3D.bin")).expect("there is one");
    let output = scratch
        .command(&["doctor", "one"])
        .output()
        .expect("starts");
    assert_eq!(output.status.code(), Some(1));
    let said = "one view to train on (1 held out) and no points";
    assert!(
        text(&output.stdout).contains(said),
        "{}",
        text(&output.stdout)
    );
    scratch.fails(&["train", "one", "--out", "run"], said);
}
