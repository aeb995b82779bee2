//! Frames of a portion of a video, decoded by `ffmpeg`.

use std::ffi::OsStr;
use std::io::{self, BufRead, BufReader, Read};
use std::ops::Range;
use std::path::Path;
use std::process::{ChildStdout, Command, Stdio};

use super::error::reading;
use super::ffmpeg::{ffmpeg, ffmpeg_program, file_argument, listen, start};
use super::picture::MAX_IMAGE_SIDE;
use super::probe::Track;
use crate::Error;
use crate::process::Child;

/// The option that forbids duplicating and dropping frames, and its name before ffmpeg 5.1.
const PASSTHROUGH: [&str; 2] = ["-fps_mode", "-vsync"];

/// A decoded frame.
#[derive(Debug, Clone)]
pub(crate) struct VideoFrame {
    pub(crate) width: usize,
    pub(crate) height: usize,
    /// `[H * W * 3]`.
    pub(crate) rgb: Vec<u8>,
}

/// A portion of a video.
#[derive(Debug, Clone, Default, PartialEq)]
pub(super) struct Portion {
    /// Seconds into the file from which decoding starts: a moment after a key frame's.
    pub(super) seek: Option<f64>,
    pub(super) frames: Which,
    pub(super) max_frames: Option<usize>,
    /// Most coded pictures that are read.
    pub(super) max_packets: Option<usize>,
    /// Whether pictures may be damaged.
    pub(super) lenient: bool,
    /// Width and height to scale to; the frames' own when `None`.
    pub(super) size: Option<[usize; 2]>,
}

/// Which frames of a video are wanted.
#[derive(Debug, Clone, Default, PartialEq)]
pub(super) enum Which {
    #[default]
    All,
    /// From the first to the last presentation time, on the file's clock.
    Times([f64; 2]),
    /// By their numbers in a video that is decoded from its beginning.
    Numbers(Range<usize>),
}

impl Which {
    /// `ffmpeg`'s filter.
    fn filter(&self) -> Option<String> {
        let condition = match self {
            Self::All => return None,
            Self::Times([from, to]) => format!("between(t\\,{from:.6}\\,{to:.6})"),
            Self::Numbers(range) => format!("gte(n\\,{})*lt(n\\,{})", range.start, range.end),
        };
        Some(format!("select={condition}"))
    }
}

/// Width and height of the video's frames as shown; with `skip_broken`, its first pictures may be damaged.
pub(crate) fn frame_size(path: &Path, skip_broken: bool) -> Result<(usize, usize), Error> {
    size_of(&Track::read(path)?, skip_broken)
}

/// [`frame_size`] of a track.
pub(super) fn size_of(track: &Track, skip_broken: bool) -> Result<(usize, usize), Error> {
    let mut size = None;
    let first = Portion {
        max_frames: Some(1),
        lenient: skip_broken,
        ..Portion::default()
    };
    decode(track, &first, |frame| {
        size = Some((frame.width, frame.height));
        Ok(())
    })?;
    size.ok_or_else(|| Error::video_decode(&track.path, "it has no frames"))
}

/// Calls `on_frame` with the frames of a portion, in order, and returns their number.
///
/// # Errors
/// When `ffmpeg` is missing or cannot decode the file, or `on_frame` fails.
pub(super) fn decode(
    track: &Track,
    portion: &Portion,
    on_frame: impl FnMut(VideoFrame) -> Result<(), Error>,
) -> Result<usize, Error> {
    decode_with(&ffmpeg_program(), track, portion, on_frame)
}

fn decode_with(
    program: &OsStr,
    track: &Track,
    portion: &Portion,
    mut on_frame: impl FnMut(VideoFrame) -> Result<(), Error>,
) -> Result<usize, Error> {
    let path = &track.path;
    for option in PASSTHROUGH {
        let (n_frames, complaint) = run(program, track, option, portion, &mut on_frame)?;
        match complaint {
            Some(complaint) if n_frames == 0 && complaint.contains(&option[1..]) => {}
            Some(_) if n_frames > 0 && portion.lenient => return Ok(n_frames),
            Some(reason) => return Err(Error::video_decode(path, reason)),
            None if n_frames == 0 => return Err(Error::video_decode(path, "it has no frames")),
            None => return Ok(n_frames),
        }
    }
    Err(Error::video_decode(
        path,
        "this ffmpeg knows neither -fps_mode nor -vsync; install a newer one",
    ))
}

/// One run of `ffmpeg`: the number of frames and, when it failed, what it said.
fn run(
    program: &OsStr,
    track: &Track,
    passthrough: &str,
    portion: &Portion,
    on_frame: &mut impl FnMut(VideoFrame) -> Result<(), Error>,
) -> Result<(usize, Option<String>), Error> {
    let path = &track.path;
    let mut copier = portion
        .max_packets
        .map(|n| copy_packets(program, track, portion.seek, n))
        .transpose()?;
    let copied = copier.as_mut().and_then(Child::stdout);
    let mut command = decoder(program, track, passthrough, portion, copied);
    let mut process = start(&mut command).map_err(reading(path))?;
    // The command holds the copier's output open.
    drop(command);
    let (Some(stdout), Some(stderr)) = (process.stdout(), process.stderr()) else {
        return Err(Error::video_decode(path, "its output could not be opened"));
    };
    let complaints = listen(stderr);
    let mut n_frames = 0;
    let mut output = BufReader::with_capacity(1 << 20, stdout);
    let outcome = loop {
        match read_ppm(&mut output) {
            Ok(Some(frame)) => {
                on_frame(frame)?;
                n_frames += 1;
            }
            Ok(None) => break None,
            Err(e) => break Some(format!("its output broke off: {e}")),
        }
    };
    drop(output);
    let status = process
        .wait()
        .map_err(|e| Error::video_decode(path, e.to_string()))?;
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

/// `ffmpeg` that writes the frames of a portion, from the file or from `copied` pictures of it.
fn decoder(
    program: &OsStr,
    track: &Track,
    passthrough: &str,
    portion: &Portion,
    copied: Option<ChildStdout>,
) -> Command {
    let mut command = ffmpeg(program);
    if !portion.lenient {
        command.arg("-xerror");
    }
    // With more threads, ffmpeg 5 conceals damage silently.
    command.args(["-threads", "1"]);
    // The track's own filters turn pictures.
    command.arg("-noautorotate");
    let is_copied = copied.is_some();
    let stdin = if let Some(copied) = copied {
        // `-copyts` keeps the times of the file, by which frames are selected.
        command.args(["-protocol_whitelist", "pipe", "-copyts", "-i", "pipe:0"]);
        Stdio::from(copied)
    } else {
        command.args(["-protocol_whitelist", "file"]);
        seek(&mut command, portion.seek);
        command
            .args(["-copyts", "-i"])
            .arg(file_argument(&track.path));
        Stdio::null()
    };
    // The copier passes on no other stream.
    let stream = if is_copied { 0 } else { track.stream };
    command.args(["-map", &format!("0:{stream}"), passthrough, "passthrough"]);
    let mut filters = Vec::from_iter(portion.frames.filter());
    filters.extend(track.picture.filters(is_copied, portion.size));
    if !filters.is_empty() {
        command.args(["-vf", &filters.join(",")]);
    }
    if let Some(max) = portion.max_frames {
        command.args(["-frames:v", &max.to_string()]);
    }
    // PPM is raw rgb24 behind a header with the size.
    command
        .args(["-f", "image2pipe", "-c:v", "ppm"])
        .args(["-pix_fmt", "rgb24", "pipe:1"])
        .stdin(stdin)
        .stdout(Stdio::piped())
        .stderr(Stdio::piped());
    command
}

/// `ffmpeg` that copies the first `n` coded pictures of a portion without decoding them.
fn copy_packets(
    program: &OsStr,
    track: &Track,
    from: Option<f64>,
    n: usize,
) -> Result<Child, Error> {
    let mut command = ffmpeg(program);
    command.args(["-protocol_whitelist", "file"]);
    seek(&mut command, from);
    command
        .args(["-copyts", "-i"])
        .arg(file_argument(&track.path))
        .args(["-map", &format!("0:{}", track.stream), "-c", "copy"])
        .args(["-avoid_negative_ts", "disabled"])
        .args(["-frames:v", &n.to_string(), "-f", "nut", "pipe:1"])
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::null());
    start(&mut command).map_err(reading(&track.path))
}

fn seek(command: &mut Command, seconds: Option<f64>) {
    if let Some(seconds) = seconds {
        command.args(["-noaccurate_seek", "-ss", &format!("{seconds:.6}")]);
    }
}

/// The next image of a stream of binary PPMs; `None` at its end.
fn read_ppm(stream: &mut BufReader<ChildStdout>) -> io::Result<Option<VideoFrame>> {
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
    let mut rgb = vec![0; width * height * 3];
    stream.read_exact(&mut rgb)?;
    Ok(Some(VideoFrame { width, height, rgb }))
}

#[cfg(test)]
mod tests {
    use super::super::probe::track;
    use super::*;

    #[test]
    fn a_missing_ffmpeg_is_one_error_that_says_how_to_install_it() {
        let program = "ffmpeg-that-does-not-exist".as_ref();
        let error = decode_with(
            program,
            &track("cam00.mp4"),
            &Portion::default(),
            |_| Ok(()),
        )
        .expect_err("no such program");
        assert!(matches!(error, Error::NoFfmpegToRead { .. }));
        let message = error.to_string();
        assert!(
            message.contains("cam00.mp4") && message.contains("apt install ffmpeg"),
            "{message}"
        );
    }
}
