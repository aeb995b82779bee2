//! Frames of a video at evenly spaced times, as PNG files.

use std::ffi::OsString;
use std::path::Path;
use std::process::Command;

use super::error::reading;
use super::ffmpeg::{ffmpeg, ffmpeg_program, file_argument, output};
use crate::Error;

/// Decoding begins this much before the first wanted frame, in seconds.
const SEEK_MARGIN_SECS: f64 = 2.0;
/// Averages over the area that a pixel covers, so that fine detail doesn't alias.
const SCALING: &str = "flags=area+accurate_rnd+full_chroma_int";

/// Which frames of a video are wanted, and how large.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Selection {
    /// The first frame's time in the video, in seconds.
    pub(crate) start: f64,
    /// Frames a second.
    pub(crate) fps: f64,
    /// Number of frames.
    pub(crate) n_frames: usize,
    /// Typical seconds from frame to frame of the video.
    pub(crate) period: f64,
    /// Width and height to scale to; the video's own when `None`.
    pub(crate) size: Option<[usize; 2]>,
}

/// The times at which a video's frames are shown, in seconds, ascending, at least one. Only the
/// container is read; nothing is decoded.
pub(crate) fn frame_times(video: &Path) -> Result<Vec<f64>, Error> {
    let mut command = reader(video, 0.0);
    command.args(["-map", "0:v:0", "-c", "copy", "-f", "framecrc", "pipe:1"]);
    let listing = output(&mut command).map_err(reading(video))?;
    let times = parse_framecrc(&listing);
    if times.is_empty() {
        return Err(Error::video_decode(video, "it has no frames with times"));
    }
    Ok(times)
}

/// The presentation times in a listing of ffmpeg's `framecrc`: `#tb 0: 1/15360`, then lines of
/// stream, decoding time, presentation time, duration, ..
fn parse_framecrc(listing: &str) -> Vec<f64> {
    let mut unit = None;
    let mut times: Vec<f64> = Vec::new();
    for line in listing.lines() {
        if let Some(text) = line.strip_prefix("#tb 0:") {
            let number = |text: &str| text.trim().parse::<f64>().ok();
            unit = text
                .split_once('/')
                .and_then(|(n, d)| Some(number(n)? / number(d)?))
                .filter(|unit| unit.is_finite() && *unit > 0.0);
        } else if !line.starts_with('#') {
            let fields: Vec<&str> = line.split(',').map(str::trim).collect();
            // Some containers state no presentation times; then frames are shown as they are decoded.
            let ticks = [2, 1]
                .iter()
                .find_map(|&column| fields.get(column)?.parse::<i64>().ok());
            if let (Some(ticks), Some(unit)) = (ticks, unit) {
                times.push(ticks as f64 * unit);
            }
        }
    }
    // Earlier frames are only there for the decoder.
    times.retain(|time| *time >= 0.0);
    times.sort_by(f64::total_cmp);
    times
}

/// Writes the selected frames to `folder` as `0000.png`, `0001.png` and so on; fewer where the video ends early.
pub(crate) fn write_frames(
    video: &Path,
    folder: &Path,
    selection: &Selection,
) -> Result<(), Error> {
    let seek = (selection.start - SEEK_MARGIN_SECS).max(0.0);
    let mut command = reader(video, seek);
    command
        .args(["-map", "0:v:0", "-vf", &filters(selection, seek)])
        .args(["-frames:v", &selection.n_frames.to_string()])
        .args(["-pix_fmt", "rgb24", "-c:v", "png", "-start_number", "0"])
        .args(["-f", "image2", "-y"])
        .arg(pattern(folder));
    output(&mut command).map(|_| ()).map_err(reading(video))
}

/// The filters that pick, for every wanted time, the frame that is nearest to it, and scale it.
fn filters(selection: &Selection, seek: f64) -> String {
    // `fps` with `round=up` picks the last frame that is not later. With half a frame interval subtracted, that
    // is the nearest one.
    let shift = selection.start - seek + 0.5 * selection.period;
    let mut filters = format!(
        "setpts=PTS-({shift:.9})/TB,fps=fps={:.9}:round=up:start_time=0",
        selection.fps
    );
    if let Some([width, height]) = selection.size {
        filters += &format!(",scale={width}:{height}:{SCALING}");
    }
    filters
}

/// `folder/%04d.png`, in which a per cent sign of the folder's own stands for itself.
fn pattern(folder: &Path) -> OsString {
    let mut pattern = OsString::from("file:");
    match folder.to_str() {
        Some(text) if text.contains('%') => pattern.push(text.replace('%', "%%")),
        _ => pattern.push(folder),
    }
    pattern.push("/%04d.png");
    pattern
}

/// `ffmpeg` that reads a video from `seek` seconds on.
fn reader(video: &Path, seek: f64) -> Command {
    let mut command = ffmpeg(&ffmpeg_program());
    if seek > 0.0 {
        command.args(["-ss", &format!("{seek:.6}")]);
    }
    command
        .args(["-protocol_whitelist", "file", "-threads", "2", "-i"])
        .arg(file_argument(video));
    command
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn listed_times_are_sorted_and_begin_at_zero() {
        let listing = "#extradata 0: 46, 0x359a0ec2\n#tb 0: 1/1000\n#dimensions 0: 320x240\n\
            0, -33, -10, 33, 99, 0x1\n0, 0, 0, 33, 99, 0x1\n0, 33, 100, 33, 9, 0x2, F=0x0\n\
            0, 67, 67, 33, 9, 0x2\n0, 70, NOPTS, 33, 9, 0x2\n";
        assert_eq!(parse_framecrc(listing), [0.0, 0.067, 0.07, 0.1]);
        for hostile in [
            "",
            "#tb 0: 1/0\n0, 1, 2",
            "#tb 0: -1/3\n0, 1, 2",
            "#tb 0: x\n0,0,0",
            "0,0,0\n,,,\n",
        ] {
            assert!(parse_framecrc(hostile).is_empty(), "{hostile}");
        }
    }

    #[test]
    fn folders_with_a_per_cent_sign_stay_themselves() {
        assert_eq!(pattern(Path::new("/a/100%d")), "file:/a/100%%d/%04d.png");
    }

    #[test]
    fn the_nearest_frame_is_picked_and_the_seek_taken_into_account() {
        let selection = Selection {
            start: 5.0,
            fps: 10.0,
            n_frames: 3,
            period: 0.04,
            size: Some([64, 48]),
        };
        assert_eq!(
            filters(&selection, 3.0),
            "setpts=PTS-(2.020000000)/TB,fps=fps=10.000000000:round=up:start_time=0,\
             scale=64:48:flags=area+accurate_rnd+full_chroma_int"
        );
    }
}
