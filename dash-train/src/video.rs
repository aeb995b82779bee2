//! Renders as files: PNG, EXR, and MP4 through the program `ffmpeg`.
//!
//! Every file is written whole or not at all: into a scratch file beside it, then renamed.

mod image_files;
mod mp4;

pub(crate) use image_files::write_whole;
pub use image_files::{rgb8, write_exr_plane, write_exr_rgb, write_png};
pub(crate) use mp4::Encoding;
pub use mp4::{
    FFMPEG, FFMPEG_VARIABLE, VideoWriter, ffmpeg_available, ffmpeg_program, ffprobe_program,
    write_mp4,
};

use std::path::PathBuf;
use std::process::ExitStatus;

/// Why an image or a video could not be written.
#[derive(Debug, thiserror::Error)]
pub enum VideoError {
    /// The operating system refused the file.
    #[error("{}: cannot write it: {source}; check the folder, its permissions and the free space", .path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// The system's reason.
        source: std::io::Error,
    },
    /// An image could not be encoded.
    #[error("{}: the image cannot be encoded: {reason}", .path.display())]
    Encode {
        /// The file.
        path: PathBuf,
        /// The encoder's reason.
        reason: String,
    },
    /// A frame, an image size or a frame rate does not fit.
    #[error("{}: expected {expected}, found {found}", .path.display())]
    Invalid {
        /// The file.
        path: PathBuf,
        /// What would fit.
        expected: String,
        /// What was given.
        found: String,
    },
    /// The `ffmpeg` program is not installed.
    #[error(
        "{}: writing videos needs the program `{program}`, which was not found; install it \
         (Debian/Ubuntu: `apt install ffmpeg`, macOS: `brew install ffmpeg`, Windows: `winget \
         install ffmpeg`), or write PNG files into a folder instead", .path.display()
    )]
    FfmpegMissing {
        /// The video that was to be written.
        path: PathBuf,
        /// The program that was looked for.
        program: String,
    },
    /// `ffmpeg` ran and failed.
    #[error(
        "{}: ffmpeg could not encode the video ({status}): {reason}; it needs the encoder libx264 \
         and room on the disk, or write PNG files into a folder instead", .path.display()
    )]
    FfmpegFailed {
        /// The video.
        path: PathBuf,
        /// How it ended.
        status: ExitStatus,
        /// What it said.
        reason: String,
    },
}
