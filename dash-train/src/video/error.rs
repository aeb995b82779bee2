//! The errors for how `ffmpeg` failed.

use std::path::Path;

use super::ffmpeg::{Failure, ffmpeg_program, refusal};
use crate::Error;

/// The error for a video that `ffmpeg` or `ffprobe` was to read.
pub(super) fn reading(path: &Path) -> impl FnOnce(Failure) -> Error {
    move |failure| match failure {
        Failure::Missing => Error::NoFfmpegToRead {
            path: path.to_path_buf(),
        },
        Failure::System(source) => Error::access(Path::new(&ffmpeg_program()))(source),
        Failure::Stopped { status, words } if words.is_empty() => {
            Error::video_decode(path, status.to_string())
        }
        Failure::Stopped { words, .. } => Error::video_decode(path, words),
    }
}

/// The error for a video that `program` was to write.
pub(super) fn writing(path: &Path, program: &str) -> impl FnOnce(Failure) -> Error {
    move |failure| match failure {
        Failure::Missing => Error::NoFfmpegToWrite {
            path: path.to_path_buf(),
            program: program.to_string(),
        },
        Failure::System(source) => Error::access(Path::new(program))(source),
        Failure::Stopped { status, words } => match refusal(&words) {
            Some(source) => Error::media_write(path)(source),
            None => Error::VideoEncode {
                path: path.to_path_buf(),
                status,
                reason: if words.is_empty() {
                    "it gave no reason".into()
                } else {
                    words
                },
            },
        },
    }
}
