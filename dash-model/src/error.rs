//! The errors of this crate.

use std::path::{Path, PathBuf};

use dash_kernels::KernelError;

/// What to do where the system refused a file or a folder.
pub fn io_remedy(source: &std::io::Error) -> &'static str {
    use std::io::ErrorKind;
    match source.kind() {
        ErrorKind::StorageFull | ErrorKind::QuotaExceeded => {
            "make room on that disk, or choose another"
        }
        ErrorKind::FileTooLarge => "raise the limit of a file's size, or choose another disk",
        ErrorKind::ReadOnlyFilesystem => "choose a place that can be written to",
        _ => "check that it exists and that you may access it",
    }
}

/// What building, rendering, saving or loading a model can refuse.
#[derive(Debug, thiserror::Error)]
pub enum ModelError {
    /// A kernel refused its input.
    #[error(transparent)]
    Kernel(#[from] KernelError),
    /// The device failed while it computed or copied.
    #[error("the device failed: {0}")]
    Device(String),
    /// A configuration value is out of range.
    #[error("model configuration: `{key}`: expected {expected}, found {found}")]
    Config {
        /// The key, with dots for nested ones.
        key: &'static str,
        /// What is in range.
        expected: String,
        /// What the configuration has.
        found: String,
    },
    /// An argument does not fit the module.
    #[error("`{argument}`: expected {expected}, found {found}")]
    Argument {
        /// The argument.
        argument: &'static str,
        /// What fits.
        expected: String,
        /// What came.
        found: String,
    },
    /// A named parameter is missing, unknown or of another shape.
    #[error("parameter `{name}`: expected {expected}, found {found}")]
    Parameter {
        /// The parameter, such as `static_set.means`.
        name: String,
        /// What the module has.
        expected: String,
        /// What came.
        found: String,
    },
    /// A file could not be read or written.
    #[error("{path}: cannot {action}: {source}; {}", io_remedy(source))]
    Io {
        /// The file.
        path: PathBuf,
        /// What was tried.
        action: &'static str,
        /// The system's answer.
        source: std::io::Error,
    },
    /// A file does not hold what its format promises.
    #[error("{path}: expected {expected}, found {found}; the file is damaged or of another kind")]
    Format {
        /// The file.
        path: PathBuf,
        /// What the format promises.
        expected: String,
        /// What the file holds.
        found: String,
    },
    /// A scene file has another version.
    #[error(
        "{path}: expected scene format version {expected}, found {found}; save the scene again with this version of dash"
    )]
    Version {
        /// The file.
        path: PathBuf,
        /// The version that this crate reads.
        expected: u32,
        /// The version of the file.
        found: u32,
    },
}

impl ModelError {
    /// A [`ModelError::Io`] for `path`.
    pub fn io(path: &Path, action: &'static str, source: std::io::Error) -> Self {
        Self::Io {
            path: path.to_path_buf(),
            action,
            source,
        }
    }

    /// A [`ModelError::Format`] for `path`.
    pub fn format(path: &Path, expected: impl Into<String>, found: impl Into<String>) -> Self {
        Self::Format {
            path: path.to_path_buf(),
            expected: expected.into(),
            found: found.into(),
        }
    }

    pub(crate) fn config(
        key: &'static str,
        expected: impl Into<String>,
        found: impl Into<String>,
    ) -> Self {
        Self::Config {
            key,
            expected: expected.into(),
            found: found.into(),
        }
    }

    pub(crate) fn argument(
        argument: &'static str,
        expected: impl Into<String>,
        found: impl Into<String>,
    ) -> Self {
        Self::Argument {
            argument,
            expected: expected.into(),
            found: found.into(),
        }
    }

    pub(crate) fn parameter(
        name: &str,
        expected: impl Into<String>,
        found: impl Into<String>,
    ) -> Self {
        Self::Parameter {
            name: name.into(),
            expected: expected.into(),
            found: found.into(),
        }
    }
}
