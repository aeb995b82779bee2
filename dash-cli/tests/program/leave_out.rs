//! What a scene does not need is left out, and a run says so.

use crate::common::{Scratch, TINY};

/// Trains on 4 cameras and 6 frames of a scene.
fn trained(scene: &str, more: &[&str]) -> Scratch {
    let scratch = Scratch::new();
    let size = ["--cameras", "4", "--frames", "6", "--size", "48x36"];
    scratch.ok(&[&["synth", "clip", "--scene", scene][..], &size].concat());
    let train = [
        "train",
        "clip",
        "--out",
        "run",
        "--iterations",
        "40",
        "--preset",
        "quick",
    ];
    scratch.ok(&[&train[..], &TINY, more].concat());
    scratch
}

fn holds(scratch: &Scratch, path: &str, text: &str) -> bool {
    let bytes = scratch.read(path);
    bytes
        .windows(text.len())
        .any(|part| part == text.as_bytes())
}

#[test]
fn where_nothing_moves_there_is_no_byte_of_a_4d_field() {
    let scratch = trained("static", &[]);
    assert!(!holds(&scratch, "run/scene/scene.safetensors", "dynamic."));
    // Nor while training: nothing that the motion stages or Adam would keep.
    let checkpoint = "run/checkpoints/000040";
    assert!(
        !scratch
            .path(&format!("{checkpoint}/motion.safetensors"))
            .exists()
    );
    for part in ["motion.", "dynamic."] {
        let path = format!("{checkpoint}/optimizer.safetensors");
        assert!(!holds(&scratch, &path, part), "moments of {part}");
    }
    let told = scratch.ok(&["info", "run", "-v"]);
    let line = told.lines().find(|line| line.contains("4D field"));
    let line = line.unwrap_or_else(|| panic!("no line on the field:\n{told}"));
    assert!(line.starts_with("left out"), "{line}");
    // What another run does is its own decision.
    scratch.ok(&[
        "train",
        "clip",
        "--out",
        "again",
        "--config",
        "run/config.toml",
    ]);
    let scene = "scene/scene.safetensors";
    assert_eq!(
        scratch.read(&format!("again/{scene}")),
        scratch.read(&format!("run/{scene}"))
    );
}

#[test]
fn what_moves_keeps_its_field_and_the_run_says_why() {
    // Levels that all have more entries than so few Gaussians read.
    let tables = "method.field.log2_hashmap_size=14";
    let levels = "method.field.resolution=[16,16]";
    let scratch = trained("bounce", &["--set", tables, "--set", levels]);
    assert!(holds(&scratch, "run/scene/scene.safetensors", "dynamic."));
    let told = scratch.ok(&["info", "run", "-v"]);
    let line = told.lines().find(|line| line.contains("4D field"));
    let line = line.unwrap_or_else(|| panic!("no line on the field:\n{told}"));
    assert!(line.starts_with("kept"), "{line}");
    assert!(
        told.contains("Gaussians that the pictures hardly show"),
        "{told}"
    );
    // Without them nothing changes: where there are many, they go.
    let unread = "entries of the field's tables that no Gaussian reads";
    let line = told.lines().find(|line| line.contains(unread));
    let line = line.unwrap_or_else(|| panic!("no line on entries:\n{told}"));
    assert!(line.starts_with("left out"), "{line}");
    let marks = "dynamic.field.encoder.table.marks";
    assert!(holds(&scratch, "run/scene/scene.safetensors", marks));
    assert!(!holds(
        &scratch,
        "run/checkpoints/000040/scene/scene.safetensors",
        marks
    ));
}

#[test]
fn with_keep_all_nothing_is_decided() {
    let scratch = trained("static", &["--keep", "all"]);
    assert!(!holds(&scratch, "run/config.toml", "decisions"));
    assert!(!scratch.ok(&["info", "run", "-v"]).contains("left out"));
}
