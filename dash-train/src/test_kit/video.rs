//! Videos of grey frames, written by `ffmpeg`.

use std::path::PathBuf;
use std::process::{Command, Output, Stdio};

use super::fixture::Fixture;
use crate::video::ffmpeg_program;

/// `ffmpeg` that overwrites files and prints errors only.
pub(crate) fn ffmpeg() -> Command {
    let mut command = Command::new(ffmpeg_program());
    command
        .args(["-nostdin", "-loglevel", "error", "-y"])
        .stdin(Stdio::null());
    command
}

/// How a command ended.
///
/// # Panics
/// When `ffmpeg` is missing.
pub(crate) fn output(command: &mut Command) -> Output {
    let output = command.output();
    output.expect("these tests need ffmpeg: apt install ffmpeg")
}

/// Runs a command, which must succeed.
#[track_caller]
pub(crate) fn run(command: &mut Command) {
    let output = output(command);
    let complaint = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{complaint}");
}

/// Writes a PNG of every shade; what `ffmpeg` is told to read them all.
pub(crate) fn grey_frames(
    fixture: &Fixture,
    folder: &str,
    [width, height]: [usize; 2],
    shades: impl Iterator<Item = usize>,
) -> PathBuf {
    // Where the video is written again, there may be more of them from before.
    drop(std::fs::remove_dir_all(fixture.root().join(folder)));
    for (frame, shade) in shades.enumerate() {
        let name = format!("{folder}/{frame:04}.png");
        fixture.image(&name, width, height, [shade as u8; 3]);
    }
    fixture.path(&format!("{folder}/%04d.png"))
}
