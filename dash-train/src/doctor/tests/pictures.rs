//! Pictures that differ between cameras or along time.

use std::fs;

use super::super::Severity::Warning;
use super::{FRAMES, Scene, else_clean, finds};

#[test]
fn a_bright_camera_is_named_with_its_factor() {
    let scene = Scene::bounce();
    scene.edit_frames(5, 0..FRAMES, |v| (f32::from(v) * 0.6) as u8);
    let diagnosis = scene.examine();
    finds(&diagnosis, "brightness", Warning, &["cam05 x0.6"]);
    else_clean(&diagnosis, &["brightness"]);
}

#[test]
fn a_jump_and_a_flicker_are_named() {
    let scene = Scene::bounce();
    scene.edit_frames(5, 10..FRAMES, |v| (f32::from(v) * 0.85) as u8);
    let diagnosis = scene.examine();
    finds(
        &diagnosis,
        "exposure",
        Warning,
        &["cam05 x0.85 at frame 10"],
    );
    else_clean(&diagnosis, &["exposure"]);
    for frame in (0..FRAMES).step_by(2) {
        scene.edit_frames(3, frame..frame + 1, |v| (f32::from(v) * 0.96) as u8);
    }
    finds(
        &scene.examine(),
        "exposure",
        Warning,
        &["flickers", "cam03 4", "cam05 x0.85"],
    );
}

#[test]
fn a_late_camera_is_named_with_its_frames() {
    let scene = Scene::bounce();
    // Every camera keeps 22 frames; camera 4 the first, the others the last.
    for camera in (0..super::CAMERAS).filter(|&camera| camera != 4) {
        for frame in 0..FRAMES - 2 {
            fs::rename(scene.frame(camera, frame + 2), scene.frame(camera, frame))
                .expect("renamed");
        }
    }
    for frame in FRAMES - 2..FRAMES {
        fs::remove_file(scene.frame(4, frame)).expect("removed");
    }
    let diagnosis = scene.examine();
    finds(&diagnosis, "sync", Warning, &["cam04 is 2 frames late"]);
    let sync = diagnosis.findings.iter().filter(|f| f.check == "sync");
    for finding in sync {
        assert_eq!(
            finding.text.matches("cam").count() - finding.text.matches("camera").count(),
            1,
            "{finding}"
        );
    }
}

#[test]
fn frozen_repeated_and_black_pictures_are_named() {
    let scene = Scene::bounce();
    fs::copy(scene.frame(6, 9), scene.frame(6, 10)).expect("copied");
    let diagnosis = scene.examine();
    finds(&diagnosis, "frames", Warning, &["cam06 frame 10"]);
    else_clean(&diagnosis, &["frames"]);
    for frame in 1..FRAMES {
        fs::copy(scene.frame(6, 0), scene.frame(6, frame)).expect("copied");
    }
    finds(
        &scene.examine(),
        "frames",
        Warning,
        &["cam06 never changes"],
    );
    scene.edit_frames(2, 4..5, |_| 0);
    finds(
        &scene.examine(),
        "frames",
        Warning,
        &["black pictures: cam02 frame 4"],
    );
}
