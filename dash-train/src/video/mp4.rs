//! MP4 files through the program `ffmpeg`.

use std::ffi::{OsStr, OsString};
use std::fs::File;
use std::io::{self, BufWriter, Read, Seek, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, Command, ExitStatus, Stdio};

use tempfile::NamedTempFile;

use super::VideoError;
use super::image_files::{checked_size, scratch_beside};

/// The program that encodes videos.
pub const FFMPEG: &str = "ffmpeg";
/// The environment variable that names another program or path for [`FFMPEG`].
pub const FFMPEG_VARIABLE: &str = "DASH_FFMPEG";
const FFPROBE: &str = "ffprobe";
/// Names another `ffprobe` program.
const FFPROBE_VARIABLE: &str = "DASH_FFPROBE";
/// For watching: 4:2:0, which every player shows, and visually without loss.
const FOR_WATCHING: Encoding = Encoding {
    arguments: &[
        "-vf",
        "scale=out_color_matrix=bt709:out_range=tv",
        "-c:v",
        "libx264",
        "-pix_fmt",
        "yuv420p",
        "-crf",
        "18",
        "-colorspace",
        "bt709",
        "-color_primaries",
        "bt709",
        "-color_trc",
        "bt709",
        "-color_range",
        "tv",
    ],
    even_sides: true,
};
/// As much of what `ffmpeg` complains is kept for the error message.
const MAX_COMPLAINT_BYTES: u64 = 4096;

/// The program that will be run: `DASH_FFMPEG` where it is set, else [`FFMPEG`] from the path.
pub fn ffmpeg_program() -> OsString {
    std::env::var_os(FFMPEG_VARIABLE)
        .filter(|program| !program.is_empty())
        .unwrap_or_else(|| FFMPEG.into())
}

/// The program that lists a video's frames: `DASH_FFPROBE` where it is set, else `ffprobe` beside the
/// `ffmpeg` that `DASH_FFMPEG` names, else `ffprobe` from the path.
pub fn ffprobe_program() -> OsString {
    let set = |variable| std::env::var_os(variable).filter(|program| !program.is_empty());
    if let Some(program) = set(FFPROBE_VARIABLE) {
        return program;
    }
    let beside = set(FFMPEG_VARIABLE).and_then(|ffmpeg| {
        let ffmpeg = PathBuf::from(ffmpeg);
        let name = ffmpeg.file_name()?.to_str()?.replace(FFMPEG, FFPROBE);
        let beside = ffmpeg.with_file_name(name);
        (beside != ffmpeg && beside.is_file()).then(|| beside.into_os_string())
    });
    beside.unwrap_or_else(|| FFPROBE.into())
}

/// How frames are encoded.
pub(crate) struct Encoding {
    /// `ffmpeg`'s arguments for the output.
    pub(crate) arguments: &'static [&'static str],
    /// Whether odd sides must be padded, as 4:2:0 asks.
    pub(crate) even_sides: bool,
}

/// Whether `ffmpeg` can be run, so that a command can complain before it renders for an hour.
pub fn ffmpeg_available() -> bool {
    Command::new(ffmpeg_program())
        .arg("-version")
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .status()
        .is_ok_and(|status| status.success())
}

/// Writes frames to an MP4 (H.264, 4:2:0, BT.709) as they come.
///
/// The file appears under its name in [`VideoWriter::finish`]; a writer that is dropped before leaves
/// nothing behind. Odd sizes, which 4:2:0 can't hold, are padded with the last column or row.
pub struct VideoWriter {
    path: PathBuf,
    scratch: NamedTempFile,
    encoder: Encoder,
    stdin: Option<BufWriter<ChildStdin>>,
    complaints: File,
    width: usize,
    height: usize,
    padded_size: [usize; 2],
    padded: Vec<u8>,
    n_frames: usize,
}

/// Ends the program when the writer is dropped early.
struct Encoder(Child);

impl Drop for Encoder {
    fn drop(&mut self) {
        // Both fail only when the program is gone already.
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

impl VideoWriter {
    /// Starts `ffmpeg` for frames of one size.
    ///
    /// # Units
    /// `fps` in frames per second.
    ///
    /// # Errors
    /// When `ffmpeg` is missing, the folder can't be written to, or the size or rate is zero.
    pub fn create(path: &Path, width: usize, height: usize, fps: f64) -> Result<Self, VideoError> {
        Self::create_with(&ffmpeg_program(), path, [width, height], fps, &FOR_WATCHING)
    }

    /// As [`VideoWriter::create`], with another program or encoding.
    pub(crate) fn create_with(
        program: &OsStr,
        path: &Path,
        [width, height]: [usize; 2],
        fps: f64,
        encoding: &Encoding,
    ) -> Result<Self, VideoError> {
        checked_size(path, [width, height], width.saturating_mul(height), 1)?;
        if !(fps.is_finite() && fps > 0.0) {
            return Err(VideoError::Invalid {
                path: path.to_path_buf(),
                expected: "a positive number of frames per second".into(),
                found: fps.to_string(),
            });
        }
        let io_error = io_error(path);
        let scratch = scratch_beside(path).map_err(&io_error)?;
        let complaints = tempfile::tempfile().map_err(&io_error)?;
        let multiple = if encoding.even_sides { 2 } else { 1 };
        let padded_size = [width, height].map(|side| side.next_multiple_of(multiple));
        // `file:` keeps names with a colon from being taken for protocols.
        let mut output = OsString::from("file:");
        output.push(scratch.path());
        let mut command = Command::new(program);
        command
            .args(["-nostdin", "-hide_banner", "-loglevel", "error"])
            .args(["-f", "rawvideo", "-pix_fmt", "rgb24"])
            .args([
                "-video_size",
                &format!("{}x{}", padded_size[0], padded_size[1]),
            ])
            .args(["-framerate", &fps.to_string(), "-i", "pipe:0"])
            .args(encoding.arguments)
            .args(["-movflags", "+faststart", "-f", "mp4", "-y"])
            .arg(output)
            .stdin(Stdio::piped())
            .stdout(Stdio::null())
            // A file, since a pipe that nobody reads can fill up.
            .stderr(complaints.try_clone().map_err(&io_error)?);
        let child = command.spawn().map_err(|source| match source.kind() {
            io::ErrorKind::NotFound => VideoError::FfmpegMissing {
                path: path.to_path_buf(),
                program: program.to_string_lossy().into_owned(),
            },
            _ => io_error(source),
        })?;
        let mut encoder = Encoder(child);
        let stdin = encoder.0.stdin.take().map(BufWriter::new);
        Ok(Self {
            path: path.to_path_buf(),
            scratch,
            encoder,
            stdin,
            complaints,
            width,
            height,
            padded_size,
            padded: Vec::new(),
            n_frames: 0,
        })
    }

    /// Appends a frame.
    ///
    /// # Shapes
    /// `rgb [H, W, 3]`.
    ///
    /// # Errors
    /// When the frame's size is another one, or `ffmpeg` has given up.
    pub fn push(&mut self, rgb: &[u8]) -> Result<(), VideoError> {
        checked_size(&self.path, [self.width, self.height], rgb.len(), 3)?;
        let fits = self.padded_size == [self.width, self.height];
        if !fits {
            self.pad(rgb);
        }
        let frame = if fits { rgb } else { &self.padded };
        let written = match &mut self.stdin {
            Some(stdin) => stdin.write_all(frame),
            None => Err(io::ErrorKind::BrokenPipe.into()),
        };
        self.n_frames += 1;
        match written {
            Ok(()) => Ok(()),
            Err(source) => Err(self.gave_up(source)),
        }
    }

    /// Ends the video and puts it under its name.
    ///
    /// # Errors
    /// When there are no frames, or `ffmpeg` or the renaming fails.
    pub fn finish(mut self) -> Result<(), VideoError> {
        if self.n_frames == 0 {
            return Err(VideoError::Invalid {
                path: self.path.clone(),
                expected: "at least one frame".into(),
                found: "none".into(),
            });
        }
        if let Some(mut stdin) = self.stdin.take()
            && let Err(source) = stdin.flush()
        {
            return Err(self.gave_up(source));
        }
        let io_error = io_error(&self.path);
        let status = self.encoder.0.wait().map_err(&io_error)?;
        if !status.success() {
            return Err(self.failed(status));
        }
        self.scratch
            .persist(&self.path)
            .map_err(|error| io_error(error.error))?;
        Ok(())
    }

    /// The frame with its last column and row repeated where the size is odd.
    fn pad(&mut self, rgb: &[u8]) {
        self.padded.clear();
        for row in rgb.chunks_exact(self.width * 3) {
            self.padded.extend_from_slice(row);
            if self.padded_size[0] > self.width {
                self.padded.extend_from_slice(&row[row.len() - 3..]);
            }
        }
        if self.padded_size[1] > self.height {
            let last_row = self.padded.len() - self.padded_size[0] * 3;
            self.padded.extend_from_within(last_row..);
        }
    }

    /// The error for a pipe that broke: what `ffmpeg` said matters more than the pipe.
    fn gave_up(&mut self, source: io::Error) -> VideoError {
        self.stdin = None;
        match self.encoder.0.wait() {
            Ok(status) => self.failed(status),
            Err(_) => io_error(&self.path)(source),
        }
    }

    fn failed(&mut self, status: ExitStatus) -> VideoError {
        let mut reason = Vec::new();
        // Without its words the status alone is reported.
        let _ = self.complaints.rewind();
        let _ = (&self.complaints)
            .take(MAX_COMPLAINT_BYTES)
            .read_to_end(&mut reason);
        let reason = String::from_utf8_lossy(&reason).trim().to_string();
        VideoError::FfmpegFailed {
            path: self.path.clone(),
            status,
            reason: if reason.is_empty() {
                "it gave no reason".into()
            } else {
                reason
            },
        }
    }
}

/// Writes a whole clip; see [`VideoWriter`].
///
/// # Shapes
/// `frames` of `[H, W, 3]`.
///
/// # Errors
/// Those of [`VideoWriter`].
pub fn write_mp4(
    path: &Path,
    width: usize,
    height: usize,
    fps: f64,
    frames: &[Vec<u8>],
) -> Result<(), VideoError> {
    let mut writer = VideoWriter::create(path, width, height, fps)?;
    for frame in frames {
        writer.push(frame)?;
    }
    writer.finish()
}

fn io_error(path: &Path) -> impl Fn(io::Error) -> VideoError + use<> {
    let path = path.to_path_buf();
    move |source| VideoError::Io {
        path: path.clone(),
        source,
    }
}

#[cfg(test)]
mod tests;
