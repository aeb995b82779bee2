//! MP4 files, encoded by `ffmpeg`.

use std::ffi::OsStr;
use std::fs;
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};
use std::process::{ChildStdin, ExitStatus, Stdio};
use std::thread::JoinHandle;

use dash_model::unfinished::Unfinished;

use super::error::writing;
use super::ffmpeg::{
    FFMPEG, Failure, ffmpeg, ffmpeg_program, file_argument, heard, listen, refusal, start,
};
use super::image_files::checked_size;
use crate::Error;
use crate::process::Child;

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

/// How frames are encoded.
pub(crate) struct Encoding {
    /// `ffmpeg`'s arguments for the output.
    pub(crate) arguments: &'static [&'static str],
    /// Whether odd sides must be padded, as 4:2:0 asks.
    pub(crate) even_sides: bool,
}

/// Writes frames to an MP4 (H.264, 4:2:0, BT.709) as they come.
///
/// The file appears under its name in [`VideoWriter::finish`]; a writer that is dropped before leaves
/// nothing behind. Odd sizes, which 4:2:0 can't hold, are padded with the last column or row.
pub struct VideoWriter {
    path: PathBuf,
    // Ends before its file is removed.
    encoder: Child,
    scratch: Unfinished,
    stdin: Option<BufWriter<ChildStdin>>,
    complaints: Option<JoinHandle<String>>,
    width: usize,
    height: usize,
    padded_size: [usize; 2],
    padded: Vec<u8>,
    n_frames: usize,
}

impl VideoWriter {
    /// Starts `ffmpeg` for frames of one size.
    ///
    /// # Units
    /// `fps` in frames per second.
    ///
    /// # Errors
    /// When `ffmpeg` is missing, the folder can't be written to, or the size or rate is zero.
    pub fn create(path: &Path, width: usize, height: usize, fps: f64) -> Result<Self, Error> {
        Self::create_with(&ffmpeg_program(), path, [width, height], fps, &FOR_WATCHING)
    }

    /// As [`VideoWriter::create`], with another program or encoding.
    pub(crate) fn create_with(
        program: &OsStr,
        path: &Path,
        [width, height]: [usize; 2],
        fps: f64,
        encoding: &Encoding,
    ) -> Result<Self, Error> {
        checked_size(path, [width, height], width.saturating_mul(height), 1)?;
        if !(fps.is_finite() && fps > 0.0) {
            return Err(Error::invalid(
                path,
                "a positive number of frames per second",
                fps.to_string(),
                "give another rate",
            ));
        }
        let io_error = Error::media_write(path);
        let scratch = Unfinished::file(path).map_err(&io_error)?;
        let multiple = if encoding.even_sides { 2 } else { 1 };
        let padded_size = [width, height].map(|side| side.next_multiple_of(multiple));
        let mut command = ffmpeg(program);
        command
            .args(["-f", "rawvideo", "-pix_fmt", "rgb24"])
            .args([
                "-video_size",
                &format!("{}x{}", padded_size[0], padded_size[1]),
            ])
            .args(["-framerate", &fps.to_string(), "-i", "pipe:0"])
            .args(encoding.arguments)
            .args(["-movflags", "+faststart", "-f", "mp4", "-y"])
            .arg(file_argument(scratch.path()))
            .stdin(Stdio::piped())
            .stdout(Stdio::null())
            .stderr(Stdio::piped());
        let program = program.to_string_lossy();
        let mut encoder = start(&mut command).map_err(writing(path, &program))?;
        let stdin = encoder.stdin().map(BufWriter::new);
        let complaints = encoder.stderr().map(listen);
        Ok(Self {
            path: path.to_path_buf(),
            encoder,
            scratch,
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
    pub fn push(&mut self, rgb: &[u8]) -> Result<(), Error> {
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
    pub fn finish(mut self) -> Result<(), Error> {
        if self.n_frames == 0 {
            return Err(Error::invalid(
                &self.path,
                "at least one frame",
                "none",
                "push a frame first",
            ));
        }
        if let Some(mut stdin) = self.stdin.take()
            && let Err(source) = stdin.flush()
        {
            return Err(self.gave_up(source));
        }
        let io_error = Error::media_write(&self.path);
        let status = self.encoder.wait().map_err(&io_error)?;
        // Where its last write fails, `ffmpeg` says so and ends with success all the same.
        let words = heard(self.complaints.take());
        if !status.success() || refusal(&words).is_some() {
            return Err(self.failed(status, words));
        }
        self.scratch
            .finish(|scratch| fs::rename(scratch, &self.path))
            .map_err(io_error)
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
    fn gave_up(&mut self, source: io::Error) -> Error {
        self.stdin = None;
        match self.encoder.wait() {
            Ok(status) => {
                let words = heard(self.complaints.take());
                self.failed(status, words)
            }
            Err(_) => Error::media_write(&self.path)(source),
        }
    }

    fn failed(&self, status: ExitStatus, words: String) -> Error {
        writing(&self.path, FFMPEG)(Failure::Stopped { status, words })
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
) -> Result<(), Error> {
    let mut writer = VideoWriter::create(path, width, height, fps)?;
    for frame in frames {
        writer.push(frame)?;
    }
    writer.finish()
}

#[cfg(test)]
mod tests;
