//! The error of this crate.

use std::path::{Path, PathBuf};

use dash_kernels::KernelError;
use dash_model::ModelError;

use crate::dataset::DatasetError;
use crate::device::DeviceChoice;
use crate::metrics::lpips::Network;
use crate::video::VideoError;

/// Why this crate refused or could not finish its work.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The dataset can't be used.
    #[error(transparent)]
    Dataset(#[from] DatasetError),
    /// A model refused its input, or a scene file is damaged.
    #[error(transparent)]
    Model(#[from] ModelError),
    /// A kernel refused its input.
    #[error(transparent)]
    Kernel(#[from] KernelError),
    /// A picture or a video could not be written.
    #[error(transparent)]
    Video(#[from] VideoError),
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
    /// A file is neither a JSON list with at least one camera nor a `transforms*.json`.
    #[error(
        "{path}: expected a JSON list of cameras (the `cameras.json` of 3DGS) or an object with `frames` (a \
         `transforms.json` of NeRF, D-NeRF, Blender or nerfstudio), found {found}"
    )]
    NoCameras {
        /// The file.
        path: PathBuf,
        /// What is there.
        found: String,
    },
    /// A camera of a file can't be used.
    #[error("{path}: camera {index}{name}: {what}")]
    Camera {
        /// The file.
        path: PathBuf,
        /// The camera's place in the file, from 0.
        index: usize,
        /// Its image's name in parentheses, where it has one.
        name: String,
        /// What was expected and what was found.
        what: String,
    },
    /// A file holds no LPIPS weights, or is damaged.
    #[error(
        "{path}: expected {expected}, found {found}; name a .safetensors file, or a .pth file as \
         torchvision and LPIPS publish them"
    )]
    WeightFile {
        /// The file.
        path: PathBuf,
        /// What it should have held.
        expected: String,
        /// What it holds.
        found: String,
    },
    /// A weight tensor is in none of the files.
    #[error(
        "LPIPS weights of {network}: expected a tensor `{name}` of shape {shape:?}, found none in {}; {hint}",
        list(files)
    )]
    WeightMissing {
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
    /// A weight tensor has another shape than the network's.
    #[error(
        "{path}: expected `{key}` of shape {expected:?} as {network} has it, found {found:?}; \
         is it the weights of another network?"
    )]
    WeightShape {
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
    /// The values of a weight tensor can't be used.
    #[error(
        "{path}: `{key}`: expected {expected}, found {found}; save the weights again, or get the file anew"
    )]
    WeightValues {
        /// The file.
        path: PathBuf,
        /// The tensor's name in the file.
        key: String,
        /// What it should have held.
        expected: &'static str,
        /// What it holds.
        found: String,
    },
    /// Two files hold the same weight tensor.
    #[error(
        "LPIPS weights: expected `{name}` in one file, found it in {first} and {second}; name only one of them"
    )]
    WeightRepeated {
        /// The tensor.
        name: String,
        /// The file named first.
        first: PathBuf,
        /// The other.
        second: PathBuf,
    },
    /// Pictures have fewer pixels than LPIPS's network needs.
    #[error(
        "LPIPS with {network}: expected pictures of at least {min}x{min} pixels, found {width}x{height}"
    )]
    PictureTooSmall {
        /// The network.
        network: Network,
        /// Least width and height in pixels.
        min: usize,
        /// Width of the pictures in pixels.
        width: usize,
        /// Height of the pictures in pixels.
        height: usize,
    },
    /// A setting of a synthetic dataset is out of its range, or two of them contradict each other.
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
    #[error(
        "{path}: expected no such path or an empty folder, found {found}; choose another name or remove it"
    )]
    OutputExists {
        /// The output that was asked for.
        path: PathBuf,
        /// What is there.
        found: &'static str,
    },
    /// The output path does not end in a name.
    #[error("{path}: expected a path that ends in a folder name, such as `out/room`")]
    OutputName {
        /// The output that was asked for.
        path: PathBuf,
    },
    /// A dataset's file or folder could not be written.
    #[error("{path}: could not {action}: {source}; check the permissions and the free space")]
    Write {
        /// The file or folder.
        path: PathBuf,
        /// What was tried.
        action: &'static str,
        /// The system's answer.
        source: std::io::Error,
    },
    /// A dataset's image could not be encoded.
    #[error(
        "{path}: could not write the image: {source}; check the permissions and the free space"
    )]
    Image {
        /// The image file.
        path: PathBuf,
        /// The encoder's reason.
        source: image::ImageError,
    },
    /// A dataset's videos need ffmpeg, which could not be started.
    #[error(
        "{program}: could not start it to write videos: {source}; install ffmpeg and put it on the PATH, or write \
         PNG frames: no --video, and another layout than rig"
    )]
    FfmpegMissing {
        /// The program that was tried.
        program: String,
        /// The system's answer.
        source: std::io::Error,
    },
    /// A dataset's video could not be written.
    #[error("{0}; or leave out --video to get PNG frames")]
    DatasetVideo(#[source] VideoError),
}

impl Error {
    /// An [`Error::Io`] for `path`.
    pub fn io(path: &Path, action: &'static str, source: std::io::Error) -> Self {
        Self::Io {
            path: path.to_path_buf(),
            action,
            source,
        }
    }

    /// For `map_err`: an [`Error::Write`] for `path`.
    pub(crate) fn write(path: &Path, action: &'static str) -> impl FnOnce(std::io::Error) -> Self {
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
}

fn list(files: &[PathBuf]) -> String {
    let names: Vec<String> = files
        .iter()
        .map(|file| file.display().to_string())
        .collect();
    names.join(", ")
}
