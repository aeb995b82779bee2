//! Frames of a video, decoded by the program `ffmpeg`; `index.rs` knows where they are, `sound.rs`
//! which of a damaged video's can be had, `stamps.rs` what time stamps tell.

mod index;
mod sound;
pub(super) mod stamps;

use std::ffi::OsString;
use std::io::{self, BufRead, BufReader, Read};
use std::ops::Range;
use std::path::Path;
use std::process::{Child, ChildStdout, Command, Stdio};
use std::thread;

use super::DatasetError;
use super::decode::MAX_IMAGE_SIDE;
use super::first_bytes::refuse_pointer_file;
use super::image::ImageData;
use crate::video::ffmpeg_program;

pub(super) use index::VideoIndex;

/// As much of what `ffmpeg` complains is kept for the error message.
const MAX_COMPLAINT_BYTES: u64 = 4096;
/// The option that forbids duplicating and dropping frames, and its name before ffmpeg 5.1.
const PASSTHROUGH: [&str; 2] = ["-fps_mode", "-vsync"];

/// Calls `on_frame` with the frames of a range, in order.
///
/// # Errors
/// When `ffmpeg` is missing, cannot decode the file or gives fewer frames, or `on_frame` fails.
pub(super) fn decode_frames(
    video: &VideoIndex,
    range: Range<usize>,
    mut on_frame: impl FnMut(usize, ImageData) -> Result<(), DatasetError>,
) -> Result<(), DatasetError> {
    let program = ffmpeg_program();
    let program = program.to_string_lossy();
    let part = video.part(range.clone());
    let mut next = range.start;
    let found = decode_frames_with(&program, video.path(), &part, |_, image| {
        on_frame(next, image)?;
        next += 1;
        Ok(())
    })?;
    if found == range.len() {
        return Ok(());
    }
    Err(failed(
        video.path(),
        format!(
            "expected {} frames from number {} on, found {found}",
            range.len(),
            range.start
        ),
    ))
}

/// Width and height of the video's frames, as they are shown; also of one whose first pictures are
/// damaged, where that is to be skipped.
pub(super) fn frame_size(path: &Path, skip_broken: bool) -> Result<(usize, usize), DatasetError> {
    if !skip_broken {
        refuse_pointer_file(path, "a video")?;
    }
    let program = ffmpeg_program();
    let mut size = None;
    let first = Part {
        max_frames: Some(1),
        lenient: skip_broken,
        ..Part::default()
    };
    decode_frames_with(&program.to_string_lossy(), path, &first, |_, image| {
        size = Some((image.width, image.height));
        Ok(())
    })?;
    size.ok_or_else(|| failed(path, "it has no frames".into()))
}

/// A part of a video.
#[derive(Debug, Clone, Default, PartialEq)]
struct Part {
    /// Seconds into the file from which decoding starts: a moment after a key frame's.
    seek: Option<f64>,
    /// The first and last presentation time, on the file's clock.
    times: Option<[f64; 2]>,
    max_frames: Option<usize>,
    /// Nothing behind so many coded pictures is read.
    max_packets: Option<usize>,
    /// Whether pictures may be damaged.
    lenient: bool,
}

fn decode_frames_with(
    program: &str,
    path: &Path,
    part: &Part,
    mut on_frame: impl FnMut(usize, ImageData) -> Result<(), DatasetError>,
) -> Result<usize, DatasetError> {
    for option in PASSTHROUGH {
        let (n_frames, complaint) = run(program, path, option, part, &mut on_frame)?;
        match complaint {
            Some(complaint) if n_frames == 0 && complaint.contains(&option[1..]) => {}
            Some(_) if n_frames > 0 && part.lenient => return Ok(n_frames),
            Some(reason) => return Err(failed(path, reason)),
            None if n_frames == 0 => return Err(failed(path, "it has no frames".into())),
            None => return Ok(n_frames),
        }
    }
    Err(failed(
        path,
        "this ffmpeg knows neither -fps_mode nor -vsync; install a newer one".into(),
    ))
}

fn failed(path: &Path, reason: String) -> DatasetError {
    DatasetError::Video {
        path: path.to_path_buf(),
        reason,
    }
}

/// One run of `ffmpeg`: the number of frames and, when it failed, what it said.
fn run(
    program: &str,
    path: &Path,
    passthrough: &str,
    part: &Part,
    on_frame: &mut impl FnMut(usize, ImageData) -> Result<(), DatasetError>,
) -> Result<(usize, Option<String>), DatasetError> {
    let mut copier = part
        .max_packets
        .map(|n| copy_packets(program, path, part.seek, n))
        .transpose()?;
    let copied = copier.as_mut().and_then(|process| process.0.stdout.take());
    let mut command = Command::new(program);
    command.args(["-nostdin", "-hide_banner", "-loglevel", "error"]);
    if !part.lenient {
        command.arg("-xerror");
    }
    // With more threads, ffmpeg 5 conceals damage without a word.
    command.args(["-threads", "1"]);
    let stdin = if let Some(copied) = copied {
        // Times stay those of the file, so that frames can be told by them.
        command.args(["-protocol_whitelist", "pipe", "-copyts", "-i", "pipe:0"]);
        Stdio::from(copied)
    } else {
        command.args(["-protocol_whitelist", "file"]);
        seek(&mut command, part.seek);
        command.args(["-copyts", "-i"]).arg(input(path));
        Stdio::null()
    };
    command.args(["-map", "0:v:0", passthrough, "passthrough"]);
    if let Some([from, to]) = part.times {
        command.args(["-vf", &format!("select=between(t\\,{from:.6}\\,{to:.6})")]);
    }
    if let Some(max) = part.max_frames {
        command.args(["-frames:v", &max.to_string()]);
    }
    // PPM is raw rgb24 behind a header with the size, so that no second program has to be asked.
    command
        .args([
            "-f",
            "image2pipe",
            "-c:v",
            "ppm",
            "-pix_fmt",
            "rgb24",
            "pipe:1",
        ])
        .stdin(stdin)
        .stdout(Stdio::piped())
        .stderr(Stdio::piped());
    let mut process = start(&mut command, path)?;
    // It holds the copier's output open as long as it lives.
    drop(command);
    let (Some(stdout), Some(mut stderr)) = (process.0.stdout.take(), process.0.stderr.take())
    else {
        return Err(failed(path, "its output could not be opened".into()));
    };
    let complaints = thread::spawn(move || {
        let mut kept = Vec::new();
        let _ = stderr
            .by_ref()
            .take(MAX_COMPLAINT_BYTES)
            .read_to_end(&mut kept);
        // Drained, so that a talkative ffmpeg never waits for a reader.
        let _ = io::copy(&mut stderr, &mut io::sink());
        without_addresses(String::from_utf8_lossy(&kept).trim())
    });
    let mut n_frames = 0;
    let mut output = BufReader::with_capacity(1 << 20, stdout);
    let outcome = loop {
        match read_ppm(&mut output) {
            Ok(Some(frame)) => {
                on_frame(n_frames, frame)?;
                n_frames += 1;
            }
            Ok(None) => break None,
            Err(e) => break Some(format!("its output broke off: {e}")),
        }
    };
    drop(output);
    let status = process.0.wait().map_err(|e| failed(path, e.to_string()))?;
    let complaint = complaints.join().unwrap_or_default();
    if status.success() && outcome.is_none() {
        return Ok((n_frames, None));
    }
    let reason = match (complaint.is_empty(), outcome) {
        (false, _) => complaint,
        (true, Some(outcome)) => outcome,
        (true, None) => status.to_string(),
    };
    Ok((n_frames, Some(reason)))
}

/// A run of `ffmpeg` that passes on the first so many coded pictures of a part, as they are.
fn copy_packets(
    program: &str,
    path: &Path,
    from: Option<f64>,
    n: usize,
) -> Result<Process, DatasetError> {
    let mut command = Command::new(program);
    command.args(["-nostdin", "-hide_banner", "-loglevel", "error"]);
    command.args(["-protocol_whitelist", "file"]);
    seek(&mut command, from);
    command.args(["-copyts", "-i"]).arg(input(path));
    command
        .args(["-map", "0:v:0", "-c", "copy"])
        .args(["-avoid_negative_ts", "disabled"])
        .args(["-frames:v", &n.to_string(), "-f", "nut", "pipe:1"])
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::null());
    start(&mut command, path)
}

/// A file's name as `ffmpeg` takes it.
fn input(path: &Path) -> OsString {
    // `file:` keeps names with a colon or a leading dash from being taken for protocols or options.
    let mut input = OsString::from("file:");
    input.push(path);
    input
}

fn seek(command: &mut Command, seconds: Option<f64>) {
    if let Some(seconds) = seconds {
        command.args(["-noaccurate_seek", "-ss", &format!("{seconds:.6}")]);
    }
}

fn start(command: &mut Command, path: &Path) -> Result<Process, DatasetError> {
    command.spawn().map(Process).map_err(|e| match e.kind() {
        io::ErrorKind::NotFound => DatasetError::FfmpegMissing {
            path: path.to_path_buf(),
        },
        _ => failed(path, e.to_string()),
    })
}

/// `[h264 @ 0x55c8] error` as `[h264] error`: where things were in memory differs from run to run.
fn without_addresses(complaint: &str) -> String {
    let mut pieces = complaint.split(" @ 0x");
    let mut text = pieces.next().unwrap_or_default().to_string();
    for piece in pieces {
        text.push_str(piece.trim_start_matches(|c: char| c.is_ascii_hexdigit()));
    }
    text
}

/// Ends the program when reading stops early.
struct Process(Child);

impl Drop for Process {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// The next image of a stream of binary PPMs; `None` at its end.
fn read_ppm(stream: &mut BufReader<ChildStdout>) -> io::Result<Option<ImageData>> {
    if stream.fill_buf()?.is_empty() {
        return Ok(None);
    }
    let bad = |what: &str| io::Error::new(io::ErrorKind::InvalidData, what.to_string());
    let mut header = String::new();
    for _ in 0..3 {
        stream.by_ref().take(64).read_line(&mut header)?;
    }
    let fields: Vec<&str> = header.split_ascii_whitespace().collect();
    let ["P6", width, height, "255"] = fields[..] else {
        return Err(bad("not an 8-bit PPM"));
    };
    let side = |text: &str| {
        text.parse()
            .ok()
            .filter(|v| (1..=MAX_IMAGE_SIDE as usize).contains(v))
    };
    let (Some(width), Some(height)) = (side(width), side(height)) else {
        return Err(bad("frames larger than 16384 pixels"));
    };
    let mut pixels = vec![0; width * height * 3];
    stream.read_exact(&mut pixels)?;
    Ok(Some(ImageData::from_rgb(width, height, pixels)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn complaints_are_the_same_in_every_run() {
        for (said, kept) in [
            (
                "[h264 @ 0x55da3366f940] error\n[nut @ 0xa] @ 0x",
                "[h264] error\n[nut]",
            ),
            ("a.mp4: @ 3", "a.mp4: @ 3"),
            ("", ""),
        ] {
            assert_eq!(without_addresses(said), kept);
        }
    }

    #[test]
    fn a_missing_ffmpeg_is_one_error_that_says_how_to_install_it() {
        let path = Path::new("cam00.mp4");
        let error = decode_frames_with(
            "ffmpeg-that-does-not-exist",
            path,
            &Part::default(),
            |_, _| Ok(()),
        )
        .expect_err("no such program");
        assert!(matches!(error, DatasetError::FfmpegMissing { .. }));
        let message = error.to_string();
        assert!(
            message.contains("cam00.mp4") && message.contains("apt install ffmpeg"),
            "{message}"
        );
    }
}
