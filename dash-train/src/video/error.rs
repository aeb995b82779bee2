//! Why a picture or a video can't be written, and why a video can't be read.

use std::path::{Path, PathBuf};
use std::process::ExitStatus;

use super::ffmpeg::Failure;
use crate::files::DatasetError;

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

impl VideoError {
    /// A [`VideoError::Io`] for `path`.
    pub(super) fn io(path: &Path) -> impl Fn(std::io::Error) -> Self + use<> {
        let path = path.to_path_buf();
        move |source| Self::Io {
            path: path.clone(),
            source,
        }
    }
}

/// The error for a video that can't be decoded.
pub(super) fn undecodable(path: &Path, reason: impl Into<String>) -> DatasetError {
    DatasetError::Video {
        path: path.to_path_buf(),
        reason: reason.into(),
    }
}

/// The error for a video that `ffmpeg` or `ffprobe` was to read.
pub(super) fn reading(path: &Path) -> impl FnOnce(Failure) -> DatasetError {
    move |failure| match failure {
        Failure::Missing => DatasetError::FfmpegMissing {
            path: path.to_path_buf(),
        },
        Failure::System(source) => undecodable(path, source.to_string()),
        Failure::Stopped { status, words } if words.is_empty() => {
            undecodable(path, status.to_string())
        }
        Failure::Stopped { words, .. } => undecodable(path, words),
    }
}

/// The error for a video that `program` was to write.
pub(super) fn writing(path: &Path, program: &str) -> impl FnOnce(Failure) -> VideoError {
    move |failure| match failure {
        Failure::Missing => VideoError::FfmpegMissing {
            path: path.to_path_buf(),
            program: program.to_string(),
        },
        Failure::System(source) => VideoError::io(path)(source),
        Failure::Stopped { status, words } => VideoError::FfmpegFailed {
            path: path.to_path_buf(),
            status,
            reason: if words.is_empty() {
                "it gave no reason".into()
            } else {
                words
            },
        },
    }
}
