//! Scores along the way of a run: what they hold, that they change nothing, and what resuming keeps.

use std::fs;

use crate::common::{Scratch, text};
use serde_json::Value;

fn curve(scratch: &Scratch, run: &str) -> Vec<Value> {
    let lines = text(&scratch.read(&format!("{run}/curve.jsonl")));
    let parse = |line: &str| serde_json::from_str(line).expect("JSON");
    lines.lines().map(parse).collect()
}

fn steps(lines: &[Value]) -> Vec<u64> {
    let step = |line: &Value| line["step"].as_u64().expect("a number");
    lines.iter().map(step).collect()
}

#[test]
fn measuring_changes_no_bit_and_ends_with_the_final_scores() {
    let scratch = Scratch::with_room("n3dv");
    scratch.train_with("without", &[]);
    scratch.train_with("with", &["--curve", "4"]);
    assert!(!scratch.path("without/curve.jsonl").exists());
    for file in [
        "scene/scene.safetensors",
        "scene/scene.json",
        "checkpoints/000030/state.json",
    ] {
        let of = |run: &str| scratch.read(&format!("{run}/{file}"));
        if file.ends_with("state.json") {
            let state = |run: &str| -> Value {
                let mut state: Value = serde_json::from_slice(&of(run)).expect("JSON");
                // The clock differs between any two runs.
                state["train_seconds"] = Value::Null;
                state
            };
            assert_eq!(state("with"), state("without"));
        } else {
            assert!(of("with") == of("without"), "{file} differs");
        }
    }
    let lines = curve(&scratch, "with");
    assert_eq!(steps(&lines), [7, 15, 22, 30]);
    let last = lines.last().expect("four lines");
    let results: Value = serde_json::from_slice(&scratch.read("with/results.json")).expect("JSON");
    for key in [
        "psnr",
        "psnr_dynamic",
        "ssim",
        "ms_ssim",
        "lpips_vgg",
        "lpips_alex",
        "n_static",
        "n_dynamic",
        "storage_bytes",
    ] {
        assert_eq!(last[key], results[key], "{key}");
    }
    assert_eq!(last["n_views"], 3);
    assert_eq!(last["seconds"], results["train_seconds"]);
    for key in ["render_fps", "peak_memory_bytes", "threads"] {
        assert!(last[key].as_f64().is_some_and(|v| v > 0.0), "{key}");
    }
    let listed: Vec<String> = fs::read_dir(scratch.path("with"))
        .expect("listed")
        .map(|entry| entry.expect("listed").file_name().to_string_lossy().into())
        .collect();
    assert!(
        !listed.iter().any(|name| name.starts_with("curve-")),
        "scratch left behind: {listed:?}"
    );
}

#[test]
fn resuming_drops_later_lines_and_takes_them_again() {
    let scratch = Scratch::with_room("n3dv");
    scratch.train_with("run", &["--curve", "6"]);
    let whole = curve(&scratch, "run");
    assert_eq!(steps(&whole), [5, 10, 15, 20, 25, 30]);
    // As if the run had ended after its second checkpoint, in the middle of a line.
    fs::remove_dir_all(scratch.path("run/checkpoints/000030")).expect("removed");
    fs::remove_dir_all(scratch.path("run/scene")).expect("removed");
    scratch.truncate("run/curve.jsonl", 0.95);
    scratch.ok(&["train", "room", "--out", "run", "--resume", "--curve", "6"]);
    let again = curve(&scratch, "run");
    assert_eq!(steps(&again), steps(&whole));
    for (again, whole) in again.iter().zip(&whole) {
        assert_eq!(again["psnr"], whole["psnr"]);
    }
    assert_eq!(again[3], whole[3], "a line that was kept is kept as it was");
    // Without --curve nothing later than the checkpoint stays.
    fs::remove_dir_all(scratch.path("run/checkpoints/000030")).expect("removed");
    scratch.ok(&["train", "room", "--out", "run", "--resume"]);
    assert_eq!(steps(&curve(&scratch, "run")), [5, 10, 15, 20]);
}

#[test]
fn without_test_views_there_is_one_error_and_no_run() {
    let scratch = Scratch::with_room("n3dv");
    scratch.fails(
        &[
            "train",
            "room",
            "--out",
            "run",
            "--test-cameras",
            "none",
            "--curve",
            "3",
        ],
        "leave --curve out",
    );
}
