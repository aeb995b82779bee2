//! Why a user's file can't be read.

use std::io;
use std::path::{Path, PathBuf};

/// Why a dataset, an image or a point cloud could not be read.
///
/// Every message names the file, what was expected, what was found and what can be done.
#[derive(Debug, thiserror::Error)]
pub enum DatasetError {
    /// The operating system refused a file or folder.
    #[error("{path}: {source}; check that it exists and that you may access it")]
    Io {
        /// The file or folder.
        path: PathBuf,
        /// The system's reason.
        source: io::Error,
    },
    /// A file's or folder's content is not what its layout asks for.
    #[error("{path}: expected {expected}, found {found}; {remedy}")]
    Invalid {
        /// The file or folder.
        path: PathBuf,
        /// What the layout asks for.
        expected: String,
        /// What is there.
        found: String,
        /// What the user can do.
        remedy: String,
    },
    /// An image is damaged, truncated, too large or of an unsupported kind.
    #[error("{path}: the image cannot be decoded: {reason}; replace the file or leave it out")]
    Image {
        /// The image.
        path: PathBuf,
        /// The decoder's reason.
        reason: String,
    },
    /// A video could not be decoded by the `ffmpeg` program.
    #[error(
        "{path}: ffmpeg could not decode the video: {reason}; write it again (`ffmpeg -i OLD -c:v \
         libx264 NEW.mp4`), or leave out what is damaged (--skip-broken)"
    )]
    Video {
        /// The video.
        path: PathBuf,
        /// What `ffmpeg` said, or what was wrong with its output.
        reason: String,
    },
    /// The `ffmpeg` program is not installed.
    #[error(
        "{path}: reading videos needs the program `ffmpeg`, which was not found; install it \
         (Debian/Ubuntu: `apt install ffmpeg`, macOS: `brew install ffmpeg`, Windows: `winget \
         install ffmpeg`) or extract the frames to camNN/images/0000.png, 0001.png, .."
    )]
    FfmpegMissing {
        /// The video that was to be read.
        path: PathBuf,
    },
    /// A loading option does not fit the dataset.
    #[error("{option}: expected {expected}, found {found}")]
    Option {
        /// The option's name as the user wrote it.
        option: &'static str,
        /// What would fit.
        expected: String,
        /// What was given.
        found: String,
    },
}

impl DatasetError {
    /// An [`DatasetError::Invalid`] from its four parts.
    pub(crate) fn invalid(
        path: &Path,
        expected: impl Into<String>,
        found: impl Into<String>,
        remedy: impl Into<String>,
    ) -> Self {
        Self::Invalid {
            path: path.to_path_buf(),
            expected: expected.into(),
            found: found.into(),
            remedy: remedy.into(),
        }
    }

    /// Attaches the path to an I/O error.
    pub(crate) fn io(path: &Path) -> impl FnOnce(io::Error) -> Self {
        |source| Self::Io {
            path: path.to_path_buf(),
            source,
        }
    }

    /// An [`DatasetError::Image`] for `path`.
    pub(crate) fn image(path: &Path, reason: impl ToString) -> Self {
        Self::Image {
            path: path.to_path_buf(),
            reason: reason.to_string(),
        }
    }
}
