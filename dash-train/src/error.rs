//! Errors of the training crate.

use std::path::{Path, PathBuf};

use dash_kernels::KernelError;
use dash_model::ModelError;

use crate::cameras::CameraFileError;
use crate::dataset::DatasetError;
use crate::device::DeviceChoice;
use crate::metrics::lpips::LpipsError;
use crate::synth::SynthError;
use crate::video::VideoError;

/// What training, evaluation and rendering can refuse.
#[derive(Debug, thiserror::Error)]
pub enum TrainError {
    /// The dataset can't be used.
    #[error(transparent)]
    Dataset(#[from] DatasetError),
    /// A model refused its input, or a scene file is damaged.
    #[error(transparent)]
    Model(#[from] ModelError),
    /// A kernel refused its input.
    #[error(transparent)]
    Kernel(#[from] KernelError),
    /// A camera file can't be used.
    #[error(transparent)]
    CameraFile(#[from] CameraFileError),
    /// A picture or a video could not be written.
    #[error(transparent)]
    Video(#[from] VideoError),
    /// A synthetic clip could not be written.
    #[error(transparent)]
    Synth(#[from] SynthError),
    /// LPIPS can't be measured.
    #[error(transparent)]
    Lpips(#[from] LpipsError),
    /// A configuration value can't be used.
    #[error("configuration: {0}")]
    Config(String),
    /// This build has no backend for a device.
    #[error(
        "--device {device}: expected a build and a machine with it, found {found}; use --device auto"
    )]
    Device {
        /// The device that was asked for.
        device: DeviceChoice,
        /// What there is instead.
        found: String,
    },
    /// The device broke down.
    #[error("the device failed: {0}; try --device auto, or a smaller picture")]
    DeviceFault(String),
    /// A file or folder could not be read or written.
    #[error("{path}: cannot {action}: {source}; check that it exists and that you may access it")]
    Io {
        /// The file or folder.
        path: PathBuf,
        /// What was tried.
        action: &'static str,
        /// The system's answer.
        source: std::io::Error,
    },
    /// No view is left to train on.
    #[error(
        "{dataset}: every view is a test view, found none to train on; \
         choose fewer test cameras with --test-cameras"
    )]
    NoTrainingViews {
        /// The dataset's folder.
        dataset: PathBuf,
    },
    /// Step after step the loss, a parameter or a gradient was NaN or infinite.
    #[error(
        "training cannot go on after skipped steps ({n} in a row): expected the loss and every \
         parameter to be finite, found at last: {last}; lower learning_rates.* or report this"
    )]
    NotFinite {
        /// How many steps.
        n: usize,
        /// The last of them.
        last: String,
    },
    /// A checkpoint is damaged.
    #[error(
        "{path}: expected a complete checkpoint, found {found}; \
         remove its folder to go back to the one before"
    )]
    Checkpoint {
        /// The damaged file.
        path: PathBuf,
        /// What is wrong with it.
        found: String,
    },
    /// A run's folder is not what the command needs.
    #[error("{path}: {what}")]
    Run {
        /// The folder.
        path: PathBuf,
        /// What is wrong and what to do.
        what: String,
    },
}

impl TrainError {
    /// A [`TrainError::Io`] for `path`.
    pub fn io(path: &Path, action: &'static str, source: std::io::Error) -> Self {
        Self::Io {
            path: path.to_path_buf(),
            action,
            source,
        }
    }

    /// A [`TrainError::Run`] for `path`.
    pub fn run(path: &Path, what: impl Into<String>) -> Self {
        Self::Run {
            path: path.to_path_buf(),
            what: what.into(),
        }
    }
}
