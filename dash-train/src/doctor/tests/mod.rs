//! A clean scene, and the same with one thing damaged, which must be found and named.

mod masks;
mod pictures;
mod poses;

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use image::RgbImage;
use tempfile::TempDir;

use super::{Diagnosis, Finding, Severity, examine};
use crate::dataset::LoadOptions;
use crate::ply::{PointCloud, read_points, write_points};
use crate::synth::{SceneKind, SynthConfig, SynthLayout, write};

const CAMERAS: usize = 8;
const FRAMES: usize = 24;
/// Bytes that decoded pictures may take: what is free of this machine's changes between two examinations.
const MEMORY: u64 = 1 << 30;
const POINTS: &str = "points3D_downsample2.ply";
/// Values in a row of `poses_bounds.npy`.
const ROW: usize = 17;

/// A folder with a scene, removed at the end of the test.
struct Scene(TempDir);

impl Scene {
    fn new(scene: SceneKind, layout: SynthLayout) -> Self {
        let folder = tempfile::tempdir().expect("temporary folder");
        let config = SynthConfig {
            scene,
            layout,
            cameras: CAMERAS,
            frames: FRAMES,
            width: 80,
            height: 60,
            ..SynthConfig::default()
        };
        write(&folder.path().join("scene"), &config).expect("writes");
        Self(folder)
    }

    /// A copy of a clean scene in which things bounce.
    fn bounce() -> Self {
        static CLEAN: OnceLock<Scene> = OnceLock::new();
        let clean = CLEAN.get_or_init(|| Self::new(SceneKind::Bounce, SynthLayout::N3dv));
        let copy = Self(tempfile::tempdir().expect("temporary folder"));
        copy_folder(&clean.root(), &copy.root());
        copy
    }

    fn root(&self) -> PathBuf {
        self.0.path().join("scene")
    }

    fn frame(&self, camera: usize, frame: usize) -> PathBuf {
        self.root()
            .join(format!("cam{camera:02}/images/{frame:04}.png"))
    }

    fn examine(&self) -> Diagnosis {
        examine(&self.root(), &LoadOptions::default(), Some(MEMORY))
    }

    /// Replaces pictures of a camera by what `edit` makes of them.
    fn edit_frames(&self, camera: usize, frames: std::ops::Range<usize>, edit: impl Fn(u8) -> u8) {
        for frame in frames {
            let path = self.frame(camera, frame);
            let mut image: RgbImage = image::open(&path).expect("a picture").to_rgb8();
            image.iter_mut().for_each(|v| *v = edit(*v));
            image.save(&path).expect("writes");
        }
    }

    fn edit_points(&self, edit: impl Fn(&mut PointCloud)) {
        let path = self.root().join(POINTS);
        let mut points = read_points(&path).expect("points");
        edit(&mut points);
        write_points(&path, &points).expect("writes");
    }

    /// Changes the rows of `poses_bounds.npy`.
    fn edit_poses(&self, edit: impl Fn(&mut Vec<[f64; ROW]>)) {
        let path = self.root().join("poses_bounds.npy");
        let bytes = fs::read(&path).expect("poses");
        let (header, values) = bytes.split_at(bytes.len() - CAMERAS * ROW * 8);
        let mut values = values
            .chunks_exact(8)
            .map(|b| f64::from_le_bytes(b.try_into().expect("eight")));
        let mut rows: Vec<[f64; ROW]> = (0..CAMERAS)
            .map(|_| std::array::from_fn(|_| values.next().expect("a value")))
            .collect();
        edit(&mut rows);
        let mut written = header.to_vec();
        written.extend(rows.iter().flatten().flat_map(|v| v.to_le_bytes()));
        fs::write(&path, written).expect("writes");
    }
}

fn copy_folder(from: &Path, to: &Path) {
    fs::create_dir_all(to).expect("made");
    for entry in fs::read_dir(from).expect("listed") {
        let path = entry.expect("listed").path();
        let target = to.join(path.file_name().expect("a name"));
        if path.is_dir() {
            copy_folder(&path, &target);
        } else {
            fs::copy(&path, &target).expect("copied");
        }
    }
}

/// Negates two of the pose's columns: y and z of the camera.
fn flip(row: &mut [f64; ROW]) {
    for axis in 0..3 {
        row[5 * axis] *= -1.0;
        row[5 * axis + 2] *= -1.0;
    }
}

/// The one finding of a check that is at least a warning, which must have every word.
#[track_caller]
fn finds(diagnosis: &Diagnosis, check: &str, severity: Severity, words: &[&str]) {
    let lines: Vec<String> = diagnosis.findings.iter().map(ToString::to_string).collect();
    let found: Vec<&Finding> = diagnosis
        .findings
        .iter()
        .filter(|finding| finding.check == check && finding.severity == severity)
        .collect();
    let right = |finding: &&&Finding| words.iter().all(|word| finding.text.contains(word));
    let Some(finding) = found.iter().find(right) else {
        panic!(
            "no {severity} of `{check}` with {words:?} in\n{}",
            lines.join("\n")
        );
    };
    assert_eq!(
        finding.mend.is_some(),
        severity >= Severity::Warning,
        "{finding}"
    );
}

/// Nothing but `allowed` is worse than a note.
#[track_caller]
fn else_clean(diagnosis: &Diagnosis, allowed: &[&str]) {
    for finding in &diagnosis.findings {
        let fine = finding.severity < Severity::Warning || allowed.contains(&finding.check);
        assert!(fine, "{finding}");
        assert!(!finding.text.contains('\n'), "{finding}");
    }
}

#[test]
fn clean_scenes_have_no_warnings() {
    let bounce = Scene::bounce();
    let diagnosis = bounce.examine();
    else_clean(&diagnosis, &[]);
    for (check, words) in [
        ("layout", &["n3dv", "poses_bounds.npy"][..]),
        ("counts", &["8 cameras x 24 frames", "24 to test (cam00)"]),
        ("pictures", &["80x60", "without alpha"]),
        ("poses", &["in front of 8 of 8 cameras"]),
        ("colours", &["of their own colour", "interchanged"]),
        ("brightness", &["exposures from"]),
        ("exposure", &["no jumps"]),
        ("motion", &["of a picture moves"]),
        (
            "memory",
            &["192 pictures take 2.6 MiB of the 1.0 GiB that they may"],
        ),
    ] {
        finds(&diagnosis, check, Severity::Ok, words);
    }
    assert_eq!(
        bounce.examine().findings,
        diagnosis.findings,
        "deterministic"
    );
    let picture = diagnosis.picture().expect("cameras");
    assert_eq!(picture.dimensions(), (1600, 880));
    let nothing = examine(Path::new("/nowhere"), &LoadOptions::default(), None);
    assert_eq!(nothing.picture(), None);
    else_clean(
        &Scene::new(SceneKind::Flow, SynthLayout::Blender).examine(),
        &[],
    );
}

#[test]
fn a_scene_at_rest_is_told() {
    let diagnosis = Scene::new(SceneKind::Static, SynthLayout::N3dv).examine();
    else_clean(&diagnosis, &[]);
    finds(
        &diagnosis,
        "motion",
        Severity::Note,
        &["hardly anything moves"],
    );
}

#[test]
fn what_cannot_be_loaded_is_a_finding_and_poses_are_checked_all_the_same() {
    let scene = Scene::bounce();
    fs::remove_dir_all(scene.root().join("cam03")).expect("removed");
    let diagnosis = scene.examine();
    finds(
        &diagnosis,
        "load",
        Severity::Error,
        &["8 of them", "found 7"],
    );
    finds(&diagnosis, "poses", Severity::Ok, &["8 of 8"]);
    assert_eq!(diagnosis.worst, Severity::Error);

    let blender = Scene::new(SceneKind::Bounce, SynthLayout::Blender);
    fs::remove_file(blender.root().join("train/r_0003.png")).expect("removed");
    let diagnosis = blender.examine();
    finds(&diagnosis, "frames", Severity::Error, &["r_0003"]);
    finds(&diagnosis, "poses", Severity::Ok, &["axes meet"]);

    let nowhere = examine(&scene.root().join("nowhere"), &LoadOptions::default(), None);
    finds(&nowhere, "layout", Severity::Error, &["nowhere"]);
}

#[test]
fn undecodable_pictures_are_all_named_and_the_rest_is_examined() {
    let scene = Scene::bounce();
    for (camera, frame) in [(2, 5), (5, 7)] {
        let path = scene.frame(camera, frame);
        let bytes = fs::read(&path).expect("a picture");
        fs::write(&path, &bytes[..bytes.len() / 2]).expect("writes");
    }
    let diagnosis = scene.examine();
    for name in ["cam02/images/0005.png", "cam05/images/0007.png"] {
        finds(&diagnosis, "frames", Severity::Error, &[name]);
    }
    else_clean(&diagnosis, &["frames"]);
    finds(&diagnosis, "colours", Severity::Ok, &[]);
}

#[test]
fn pictures_of_one_camera_without_times_are_told() {
    let scene = Scene::new(SceneKind::Bounce, SynthLayout::Blender);
    for name in ["transforms_train.json", "transforms_test.json"] {
        let path = scene.root().join(name);
        let text = fs::read_to_string(&path).expect("transforms");
        fs::write(&path, text.replace("\"time\"", "\"hour\"")).expect("writes");
    }
    let words = ["taken as static, although", "has several pictures"];
    finds(&scene.examine(), "times", Severity::Warning, &words);
}

#[test]
fn times_that_are_stretched_are_told_as_stated() {
    let scene = Scene::new(SceneKind::Bounce, SynthLayout::Blender);
    for name in ["transforms_train.json", "transforms_test.json"] {
        let path = scene.root().join(name);
        let text = fs::read(&path).expect("transforms");
        let mut json: serde_json::Value = serde_json::from_slice(&text).expect("JSON");
        for frame in json["frames"].as_array_mut().expect("frames") {
            let time = frame["time"].as_f64().expect("a time");
            frame["time"] = (0.5 * time).into();
        }
        fs::write(&path, json.to_string()).expect("writes");
    }
    let words = ["24 times from 0.000 to 1.000", "stated from 0 to 0.5"];
    finds(&scene.examine(), "times", Severity::Ok, &words);
}

#[test]
fn missing_frames_are_noticed_by_their_numbers_and_by_their_times() {
    let scene = Scene::bounce();
    for camera in 0..CAMERAS {
        for frame in 8..13 {
            fs::remove_file(scene.frame(camera, frame)).expect("removed");
        }
    }
    let diagnosis = scene.examine();
    finds(
        &diagnosis,
        "times",
        Severity::Warning,
        &["leave out 5", "after 7 comes 13"],
    );
    else_clean(&diagnosis, &["times"]);

    let blender = Scene::new(SceneKind::Bounce, SynthLayout::Blender);
    let edit = |name: &str, keep: &dyn Fn(f64, &str) -> bool| {
        let path = blender.root().join(name);
        let text = fs::read(&path).expect("transforms");
        let mut json: serde_json::Value = serde_json::from_slice(&text).expect("JSON");
        let frames = json["frames"].as_array_mut().expect("frames");
        frames.retain(|f| {
            keep(
                f["time"].as_f64().expect("a time"),
                f["file_path"].as_str().expect("a name"),
            )
        });
        fs::write(&path, json.to_string()).expect("writes");
    };
    // Camera 1 has pictures 0 to 23.
    let late = |_: f64, name: &str| (12..24).all(|frame| !name.contains(&format!("r_{frame:04}")));
    edit("transforms_train.json", &late);
    finds(
        &blender.examine(),
        "frames",
        Severity::Warning,
        &["lacks 12"],
    );
    let gap = |time: f64, _: &str| !(0.4..0.7).contains(&time);
    edit("transforms_train.json", &gap);
    edit("transforms_test.json", &gap);
    finds(
        &blender.examine(),
        "times",
        Severity::Warning,
        &["none between 0.391 and 0.739"],
    );
}

#[test]
fn memory_is_compared_with_the_budget() {
    let scene = Scene::bounce();
    let diagnosis = examine(&scene.root(), &LoadOptions::default(), Some(1 << 20));
    let found = diagnosis.findings.last().expect("memory comes last");
    assert_eq!((found.check, found.severity), ("memory", Severity::Note));
    assert!(
        found.text.contains("2.6 MiB of the 1.0 MiB") && found.text.contains("when it needs them"),
        "{}",
        found.text
    );
    let mend = diagnosis.findings.last().and_then(|f| f.mend.clone());
    assert_eq!(
        mend.as_deref(),
        Some("a larger --memory, or --downscale 1.7, holds them all")
    );
}
