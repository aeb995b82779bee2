//! What LPIPS and its weight files can refuse.

use std::path::{Path, PathBuf};

use super::Network;

/// Why LPIPS can't be measured.
#[derive(Debug, thiserror::Error)]
pub enum LpipsError {
    /// A weight file could not be read.
    #[error(
        "{path}: cannot read the LPIPS weights: {source}; check that the file exists and that you may access it"
    )]
    Io {
        /// The file.
        path: PathBuf,
        /// The system's answer.
        source: std::io::Error,
    },
    /// A file is no weight file, or a damaged one.
    #[error(
        "{path}: expected {expected}, found {found}; name a .safetensors file, or a .pth file as \
         torchvision and LPIPS publish them"
    )]
    Format {
        /// The file.
        path: PathBuf,
        /// What it should have held.
        expected: String,
        /// What it holds.
        found: String,
    },
    /// A tensor is in none of the files.
    #[error(
        "LPIPS weights of {network}: expected a tensor `{name}` of shape {shape:?}, found none in {}; {hint}",
        list(files)
    )]
    Missing {
        /// Whose weights they are.
        network: Network,
        /// The tensor.
        name: String,
        /// Its shape.
        shape: Vec<usize>,
        /// The files that were searched.
        files: Vec<PathBuf>,
        /// Which file has such tensors.
        hint: &'static str,
    },
    /// A tensor has another shape than the network's.
    #[error(
        "{path}: expected `{key}` of shape {expected:?} as {network} has it, found {found:?}; \
         is it the weights of another network?"
    )]
    Shape {
        /// The file.
        path: PathBuf,
        /// The tensor's name in the file.
        key: String,
        /// Whose weights were wanted.
        network: Network,
        /// The network's shape.
        expected: Vec<usize>,
        /// The file's shape.
        found: Vec<usize>,
    },
    /// A tensor can't be used.
    #[error(
        "{path}: `{key}`: expected {expected}, found {found}; save the weights again, or get the file anew"
    )]
    Tensor {
        /// The file.
        path: PathBuf,
        /// The tensor's name in the file.
        key: String,
        /// What it should have held.
        expected: &'static str,
        /// What it holds.
        found: String,
    },
    /// Two files hold the same tensor.
    #[error(
        "LPIPS weights: expected `{name}` in one file, found it in {first} and {second}; name only one of them"
    )]
    Repeated {
        /// The tensor.
        name: String,
        /// The file named first.
        first: PathBuf,
        /// The other.
        second: PathBuf,
    },
    /// The pictures have fewer pixels than the network needs.
    #[error(
        "LPIPS with {network}: expected pictures of at least {min}x{min} pixels, found {width}x{height}"
    )]
    TooSmall {
        /// The network.
        network: Network,
        /// Least width and height in pixels.
        min: usize,
        /// Width of the pictures in pixels.
        width: usize,
        /// Height of the pictures in pixels.
        height: usize,
    },
    /// The device failed.
    #[error("LPIPS: the device failed: {0}; try --device auto, or smaller pictures")]
    Device(String),
}

impl LpipsError {
    /// An [`LpipsError::Io`] for `path`.
    pub(super) fn io(path: &Path, source: std::io::Error) -> Self {
        Self::Io {
            path: path.to_path_buf(),
            source,
        }
    }

    /// An [`LpipsError::Format`] for `path`.
    pub(super) fn format(
        path: &Path,
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

fn list(files: &[PathBuf]) -> String {
    let names: Vec<String> = files
        .iter()
        .map(|file| file.display().to_string())
        .collect();
    names.join(", ")
}
