//! The error of this crate.
//!
//! Every message names the file or option, what was expected, what was found and what can be done.
//! `make.rs` has the short ways to make one, `words.rs` parts of their messages.

mod make;
mod words;

use std::path::PathBuf;
use std::process::ExitStatus;

use dash_kernels::KernelError;
use dash_model::{ModelError, io_remedy};

use self::words::{REGISTRATION_REMEDY, list, not_found, write_remedy};
use crate::device::DeviceChoice;
use crate::metrics::lpips::Network;

/// Why this crate refused or could not finish its work.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// A model refused its input, or a scene file is damaged.
    #[error(transparent)]
    Model(#[from] ModelError),
    /// A kernel refused its input.
    #[error(transparent)]
    Kernel(#[from] KernelError),
    /// A configuration value can't be used.
    #[error("configuration: {0}")]
    Config(String),
    /// Replicas of a run can't go on together.
    #[error("replicas: {0}")]
    Replicas(String),
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
    #[error("{path}: cannot {action}: {source}; {}", io_remedy(source))]
    Io {
        /// The file or folder.
        path: PathBuf,
        /// What was tried.
        action: &'static str,
        /// The system's answer.
        source: std::io::Error,
    },
    /// The operating system refused a file or folder of a dataset.
    #[error("{path}: {source}; {}", io_remedy(source))]
    Access {
        /// The file or folder.
        path: PathBuf,
        /// The system's reason.
        source: std::io::Error,
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
    #[error(
        "{path}: the image cannot be decoded: {reason}; replace the file, or leave it out with --skip-broken"
    )]
    ImageDecode {
        /// The image.
        path: PathBuf,
        /// The decoder's reason.
        reason: String,
    },
    /// A video could not be decoded by the `ffmpeg` program.
    #[error(
        "{path}: ffmpeg could not decode the video: {reason}; write it again (`ffmpeg -i OLD -c:v \
         libx264 NEW.mp4`){}", if *.of_dataset { ", or train with --skip-broken to leave out what is damaged" } else { "" }
    )]
    VideoDecode {
        /// The video.
        path: PathBuf,
        /// What `ffmpeg` said, or what was wrong with its output.
        reason: String,
        /// Whether it belongs to a dataset: training can leave its damaged videos out.
        of_dataset: bool,
    },
    /// A video was to be read, and the `ffmpeg` program is not installed.
    #[error(
        "{path}: reading videos needs the program `ffmpeg`, which was not found; install it \
         (Debian/Ubuntu: `apt install ffmpeg`, macOS: `brew install ffmpeg`, Windows: `winget \
         install ffmpeg`) or extract the frames to camNN/images/0000.png, 0001.png, .."
    )]
    NoFfmpegToRead {
        /// The video that was to be read.
        path: PathBuf,
    },
    /// A loading option does not fit the dataset.
    #[error("{option}: expected {expected}, found {found}")]
    LoadOption {
        /// The option's name as the user wrote it.
        option: &'static str,
        /// What would fit.
        expected: String,
        /// What was given.
        found: String,
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
    /// Training was stopped before its end, as was asked.
    #[error("{run}: training stopped after step {step}, its checkpoint is written")]
    Stopped {
        /// The run's folder.
        run: PathBuf,
        /// Steps done.
        step: usize,
    },
    /// A capture does not show enough for training to begin.
    #[error("{dataset}: expected points, or pictures from several places, found {found}; {remedy}")]
    TooLittle {
        /// The dataset's folder.
        dataset: PathBuf,
        /// What is there.
        found: String,
        /// What the user can do.
        remedy: &'static str,
    },
    /// Step after step the loss, a parameter or a gradient was NaN or infinite.
    #[error(
        "training cannot go on after skipped steps ({n} in a row): expected the loss and every \
         parameter to be finite, found at last: {last}; lower optimizer.* or report this"
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
    /// The operating system refused a picture or a video that was to be written.
    #[error("{path}: cannot write it: {source}; {}", write_remedy(source))]
    MediaWrite {
        /// The file.
        path: PathBuf,
        /// The system's reason.
        source: std::io::Error,
    },
    /// A picture could not be encoded.
    #[error("{path}: the image cannot be encoded: {reason}; choose another format")]
    ImageEncode {
        /// The file.
        path: PathBuf,
        /// The encoder's reason.
        reason: String,
    },
    /// A video was to be written, and the `ffmpeg` program is not installed.
    #[error(
        "{path}: writing videos needs the program `{program}`, which was not found; install it \
         (Debian/Ubuntu: `apt install ffmpeg`, macOS: `brew install ffmpeg`, Windows: `winget \
         install ffmpeg`), or write PNG files into a folder instead"
    )]
    NoFfmpegToWrite {
        /// The video that was to be written.
        path: PathBuf,
        /// The program that was looked for.
        program: String,
    },
    /// `ffmpeg` ran and could not encode a video.
    #[error(
        "{path}: ffmpeg could not encode the video ({status}): {reason}; it needs the encoder libx264 \
         and room on the disk, or write PNG files into a folder instead"
    )]
    VideoEncode {
        /// The video.
        path: PathBuf,
        /// How it ended.
        status: ExitStatus,
        /// What it said.
        reason: String,
    },
    /// An option of `prepare` or `synth` is out of its range, or options contradict each other.
    #[error("{option}: expected {expected}, found {found}")]
    Setting {
        /// The option as it is written on the command line.
        option: &'static str,
        /// What would fit.
        expected: String,
        /// What was given.
        found: String,
    },
    /// The `colmap` program is not installed.
    #[error(
        "finding {purpose} needs the program `{program}`, which was not found; install it \
         (Debian/Ubuntu: `apt install colmap`, macOS: `brew install colmap`, any: `conda install -c \
         conda-forge colmap`){instead}"
    )]
    ColmapMissing {
        /// What it was to find.
        purpose: &'static str,
        /// The program that was looked for.
        program: String,
        /// What else can be done.
        instead: &'static str,
    },
    /// `colmap` ran and failed.
    #[error("colmap {step} failed ({status}); its last words: {words}; {remedy}")]
    ColmapFailed {
        /// The command of `colmap` that failed.
        step: &'static str,
        /// How it ended.
        status: ExitStatus,
        /// The last lines that it wrote.
        words: String,
        /// What the user can do.
        remedy: &'static str,
    },
    /// Structure from motion did not find the poses of some cameras.
    #[error(
        "COLMAP found the poses of {} of {n_cameras} cameras{}; {REGISTRATION_REMEDY}",
        .n_cameras - .missing.len(), not_found(.missing, *.n_cameras)
    )]
    NotRegistered {
        /// The cameras without a pose.
        missing: Vec<String>,
        /// Number of cameras.
        n_cameras: usize,
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
    /// A file or folder of a synthetic dataset could not be written.
    #[error("{path}: could not {action}: {source}; {}", write_remedy(source))]
    Write {
        /// The file or folder.
        path: PathBuf,
        /// What was tried.
        action: &'static str,
        /// The system's answer.
        source: std::io::Error,
    },
    /// Videos of a synthetic dataset need ffmpeg, which could not be started.
    #[error(
        "{program}: could not start it to write videos: {source}; install ffmpeg and put it on the PATH, or write \
         PNG frames: no --video, and another layout than rig"
    )]
    FfmpegNotStarted {
        /// The program that was tried.
        program: String,
        /// The system's answer.
        source: std::io::Error,
    },
    /// A video of a synthetic dataset could not be written.
    #[error("{0}; or leave out --video to get PNG frames")]
    SynthVideo(#[source] Box<Error>),
}
