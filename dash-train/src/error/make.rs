//! Short ways to make an [`Error`].

use std::io;
use std::path::Path;

use super::Error;

impl Error {
    /// An [`Error::Io`] for `path`.
    pub fn io(path: &Path, action: &'static str, source: io::Error) -> Self {
        Self::Io {
            path: path.to_path_buf(),
            action,
            source,
        }
    }

    /// For `map_err`: an [`Error::Write`] for `path`.
    pub(crate) fn write(path: &Path, action: &'static str) -> impl FnOnce(io::Error) -> Self {
        let path = path.to_path_buf();
        move |source| Self::Write {
            path,
            action,
            source,
        }
    }

    /// An [`Error::Run`] for `path`.
    pub fn run(path: &Path, what: impl Into<String>) -> Self {
        Self::Run {
            path: path.to_path_buf(),
            what: what.into(),
        }
    }

    /// An [`Error::WeightFile`] for `path`.
    pub(crate) fn weight_file(
        path: &Path,
        expected: impl Into<String>,
        found: impl Into<String>,
    ) -> Self {
        Self::WeightFile {
            path: path.to_path_buf(),
            expected: expected.into(),
            found: found.into(),
        }
    }

    /// For `map_err`: an [`Error::Access`] for `path`.
    pub(crate) fn access(path: &Path) -> impl FnOnce(io::Error) -> Self {
        |source| Self::Access {
            path: path.to_path_buf(),
            source,
        }
    }

    /// An [`Error::Invalid`] from its four parts.
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

    /// An [`Error::ImageDecode`] for `path`.
    pub(crate) fn image_decode(path: &Path, reason: impl ToString) -> Self {
        Self::ImageDecode {
            path: path.to_path_buf(),
            reason: reason.to_string(),
        }
    }

    /// An [`Error::VideoDecode`] for `path`.
    pub(crate) fn video_decode(path: &Path, reason: impl Into<String>) -> Self {
        Self::VideoDecode {
            path: path.to_path_buf(),
            reason: reason.into(),
            of_dataset: true,
        }
    }

    /// For `map_err`: the error without a remedy that only datasets have, since it is about a recording.
    pub(crate) fn of_recording(mut self) -> Self {
        if let Self::VideoDecode { of_dataset, .. } = &mut self {
            *of_dataset = false;
        }
        self
    }

    /// For `map_err`: an [`Error::MediaWrite`] for `path`.
    pub(crate) fn media_write(path: &Path) -> impl Fn(io::Error) -> Self + use<> {
        let path = path.to_path_buf();
        move |source| Self::MediaWrite {
            path: path.clone(),
            source,
        }
    }

    /// For `map_err`: an [`Error::SynthVideo`].
    pub(crate) fn synth_video(source: Self) -> Self {
        Self::SynthVideo(Box::new(source))
    }

    /// An [`Error::Setting`] from its three parts.
    pub(crate) fn setting(
        option: &'static str,
        expected: impl Into<String>,
        found: impl ToString,
    ) -> Self {
        Self::Setting {
            option,
            expected: expected.into(),
            found: found.to_string(),
        }
    }
}
