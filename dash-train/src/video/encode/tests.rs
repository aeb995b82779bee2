use std::path::Path;
use std::process::{Command, Stdio};

use super::super::{FFMPEG, FFMPEG_VARIABLE, ffmpeg_available, ffmpeg_program};
use super::*;

fn folder() -> tempfile::TempDir {
    tempfile::tempdir().expect("a scratch folder")
}

fn n_files(folder: &tempfile::TempDir) -> usize {
    std::fs::read_dir(folder.path()).expect("a folder").count()
}

/// All frames of a video as RGB.
fn decoded(path: &Path) -> Vec<u8> {
    let output = Command::new(ffmpeg_program())
        .args(["-nostdin", "-loglevel", "error", "-i"])
        .arg(path)
        .args(["-f", "rawvideo", "-pix_fmt", "rgb24", "pipe:1"])
        .output()
        .expect("ffmpeg runs");
    assert!(
        output.status.success(),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
    output.stdout
}

#[test]
fn colours_survive_and_odd_sizes_are_padded() {
    assert!(
        ffmpeg_available(),
        "these tests need ffmpeg: apt install ffmpeg"
    );
    let folder = folder();
    let path = folder.path().join("a: clip.mp4");
    let colours = [[200, 40, 60], [30, 180, 90], [50, 60, 220], [255, 255, 255]];
    for (width, height) in [(17, 13), (32, 32), (1, 1)] {
        let frames: Vec<Vec<u8>> = colours.map(|c| c.repeat(width * height)).into();
        write_mp4(&path, width, height, 25.0, &frames).expect("encodable");
        let (even_width, even_height) = (width.next_multiple_of(2), height.next_multiple_of(2));
        let pixels = decoded(&path);
        assert_eq!(pixels.len(), colours.len() * even_width * even_height * 3);
        for (frame, colour) in pixels
            .chunks_exact(even_width * even_height * 3)
            .zip(colours)
        {
            for (got, expected) in frame.iter().zip(colour.iter().cycle()) {
                assert!(
                    got.abs_diff(*expected) <= 6,
                    "{width} x {height}: {got} for {expected}"
                );
            }
        }
        assert_eq!(n_files(&folder), 1, "no scratch file is left");
    }
}

#[test]
fn a_missing_program_says_how_to_install_it() {
    let folder = folder();
    let path = folder.path().join("clip.mp4");
    let error = VideoWriter::create_with(
        "no-such-ffmpeg".as_ref(),
        &path,
        [4, 4],
        30.0,
        &FOR_WATCHING,
    )
    .err()
    .expect("there is no such program");
    assert!(matches!(error, Error::NoFfmpegToWrite { .. }), "{error}");
    let text = error.to_string();
    for part in ["clip.mp4", "`no-such-ffmpeg`", "apt install ffmpeg", "PNG"] {
        assert!(text.contains(part), "{text}");
    }
    assert_eq!(n_files(&folder), 0);
}

#[cfg(unix)]
#[test]
fn a_program_that_fails_is_quoted() {
    use std::os::unix::fs::PermissionsExt;
    let folder = folder();
    let program = folder.path().join("failing");
    let script = "#!/bin/sh\necho 'Unknown encoder libx264' >&2\nexit 3\n";
    std::fs::write(&program, script).expect("writable");
    std::fs::set_permissions(&program, PermissionsExt::from_mode(0o755)).expect("executable");
    let path = folder.path().join("clip.mp4");
    let mut writer =
        VideoWriter::create_with(program.as_ref(), &path, [256, 256], 30.0, &FOR_WATCHING)
            .expect("the program starts");
    let frame = vec![0; 256 * 256 * 3];
    let error = (0..100)
        .find_map(|_| writer.push(&frame).err())
        .or_else(|| writer.finish().err())
        .expect("the program failed")
        .to_string();
    assert!(
        error.contains("Unknown encoder") && error.contains("exit status: 3"),
        "{error}"
    );
    assert!(!path.exists());
    assert_eq!(n_files(&folder), 1, "only the script is left");
}

#[test]
fn bad_frames_and_settings_are_refused_and_leave_nothing() {
    let folder = folder();
    let path = folder.path().join("clip.mp4");
    for fps in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        assert!(VideoWriter::create(&path, 4, 4, fps).is_err(), "{fps}");
    }
    assert!(VideoWriter::create(&path, 0, 4, 30.0).is_err());
    let mut writer = VideoWriter::create(&path, 4, 4, 30.0).expect("valid");
    assert!(writer.push(&[0; 47]).is_err());
    let error = writer.finish().expect_err("no frames").to_string();
    assert!(error.contains("expected at least one frame"), "{error}");
    let mut dropped = VideoWriter::create(&path, 4, 4, 30.0).expect("valid");
    dropped.push(&[0; 48]).expect("a frame");
    drop(dropped);
    assert_eq!(n_files(&folder), 0);
}

/// Only this process's children can have another environment, so the test runs itself.
#[test]
fn the_environment_names_the_program() {
    const PROBE: &str = "DASH_TEST_EXPECT_FFMPEG";
    if let Some(expected) = std::env::var_os(PROBE) {
        assert_eq!(ffmpeg_available(), expected == "yes");
        return;
    }
    let available = |variable: &str, value: &str, expected: &str| {
        let status = Command::new(std::env::current_exe().expect("the test's program"))
            .args(["the_environment_names_the_program"])
            .env_remove(FFMPEG_VARIABLE)
            .env(variable, value)
            .env(PROBE, expected)
            .stdout(Stdio::null())
            .status()
            .expect("the test's program runs");
        assert!(status.success(), "{variable}={value:?}");
    };
    available(FFMPEG_VARIABLE, "/nowhere/ffmpeg", "no");
    available("PATH", "/nowhere", "no");
    available(FFMPEG_VARIABLE, "", "yes");
    available(FFMPEG_VARIABLE, FFMPEG, "yes");
}
