//! Errors of the model crate.

use std::path::PathBuf;

use dash_kernels::KernelError;

/// What building, saving or loading a model can refuse.
#[derive(Debug, thiserror::Error)]
pub enum ModelError {
    /// A kernel refused its input.
    #[error(transparent)]
    Kernel(#[from] KernelError),
    /// A configuration value is out of range.
    #[error("model configuration: {0}")]
    Config(String),
    /// A file could not be read or written.
    #[error("{path}: cannot {action}: {source}; check that it exists and is accessible")]
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
}

impl ModelError {
    /// An [`ModelError::Io`] for `path`.
    pub fn io(path: &std::path::Path, action: &'static str, source: std::io::Error) -> Self {
        Self::Io {
            path: path.to_path_buf(),
            action,
            source,
        }
    }

    /// An [`ModelError::Format`] for `path`.
    pub fn format(
        path: &std::path::Path,
        expected: impl Into<String>,
        found: impl Into<String>,
    ) -> Self {
        Self::Format {
            path: path.to_path_buf(),
            expected: expected.into(),
            found: found.into(),
        }
    }
}
