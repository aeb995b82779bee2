//! What can go wrong while a dataset is made.

use crate::video::VideoError;
use std::path::PathBuf;

/// Why a synthetic dataset could not be written.
#[derive(Debug, thiserror::Error)]
pub enum SynthError {
    /// A setting is out of its range, or two settings contradict each other.
    #[error("synth: {setting} is {found}, expected {expected}")]
    Setting {
        /// The setting's name on the command line.
        setting: &'static str,
        /// What was given.
        found: String,
        /// The accepted range, and what to do instead.
        expected: &'static str,
    },
    /// The output exists and is not an empty folder.
    #[error("{}: expected no such path or an empty folder, found {found}; choose another name or remove it", .path.display())]
    OutputExists {
        /// The output that was asked for.
        path: PathBuf,
        /// What is there.
        found: &'static str,
    },
    /// The output path does not end in a name.
    #[error("{}: expected a path that ends in a folder name, such as `out/room`", .path.display())]
    OutputName {
        /// The output that was asked for.
        path: PathBuf,
    },
    /// A file or folder could not be written.
    #[error("{}: could not {action}: {source}; check the permissions and the free space", .path.display())]
    Io {
        /// The file or folder.
        path: PathBuf,
        /// What was tried.
        action: &'static str,
        /// The system's reason.
        source: std::io::Error,
    },
    /// An image could not be encoded.
    #[error("{}: could not write the image: {source}; check the permissions and the free space", .path.display())]
    Image {
        /// The image file.
        path: PathBuf,
        /// The encoder's reason.
        source: image::ImageError,
    },
    /// ffmpeg is needed for videos and could not be started.
    #[error(
        "{program}: could not start it to write videos: {source}; install ffmpeg and put it on the PATH, or write PNG frames: no --video, and another layout than rig"
    )]
    FfmpegMissing {
        /// The program that was tried.
        program: String,
        /// The system's reason.
        source: std::io::Error,
    },
    /// A video could not be written.
    #[error("{0}; or leave out --video to get PNG frames")]
    Video(#[from] VideoError),
}

impl SynthError {
    /// For `map_err`: an [`SynthError::Io`] about `path`.
    pub(super) fn io(
        path: &std::path::Path,
        action: &'static str,
    ) -> impl FnOnce(std::io::Error) -> Self {
        let path = path.to_path_buf();
        move |source| Self::Io {
            path,
            action,
            source,
        }
    }
}
