//! What is shown, and what the viewer asks of the world around it.

use std::path::{Path, PathBuf};
#[cfg(not(target_family = "wasm"))]
use std::sync::Arc;

#[cfg(not(target_family = "wasm"))]
use burn::tensor::Device;
use dash_kernels::Camera;
use dash_model::{DynamicScene, TimeWindows};

#[cfg(not(target_family = "wasm"))]
use crate::Live;
use crate::ViewError;
use crate::camera_path::PathCamera;
use crate::draw::Frame;

/// Frames per second of a clip that says nothing about it.
pub const FRAME_RATE: f64 = 30.0;

/// What the window shows.
pub struct Content {
    /// Its name, for the title.
    pub name: String,
    /// The Gaussians.
    pub source: Source,
    /// Frames of the clip; 1 for a static scene.
    pub n_frames: usize,
    /// Frames per second at speed 1.
    pub frame_rate: f64,
    /// Cameras to look through.
    pub cameras: Vec<NamedCamera>,
    /// The point to orbit; the middle of the Gaussians where `None`.
    pub focus: Option<[f64; 3]>,
}

impl Content {
    /// Content without cameras.
    pub fn new(name: &str, source: Source, n_frames: usize) -> Self {
        Self {
            name: name.into(),
            source,
            n_frames,
            frame_rate: FRAME_RATE,
            cameras: Vec::new(),
            focus: None,
        }
    }
}

/// Where the Gaussians of an instant come from.
pub enum Source {
    /// A scene over all times.
    Scene(Box<DynamicScene>),
    /// A static scene for each frame.
    Frames(Box<dyn FrameSource>),
    /// A long clip in windows of time, each a scene of its own.
    Windows(Box<dyn WindowSource>),
    /// A scene over all times that trains meanwhile; its copies are drawn on this device.
    #[cfg(not(target_family = "wasm"))]
    Live(Arc<Live>, Device),
}

/// A static scene for each frame, made when it is shown.
pub trait FrameSource: Send {
    /// The scene of a frame.
    ///
    /// # Errors
    /// When it can't be read; the message is shown in the window.
    fn scene(&mut self, frame: usize) -> Result<DynamicScene, ViewError>;
}

/// A long clip in windows of time. Only those that a picture needs are asked for.
pub trait WindowSource: Send {
    /// When each window begins and ends.
    fn times(&self) -> &TimeWindows;

    /// The scene of a window.
    ///
    /// # Errors
    /// When it can't be read; the message is shown in the window on the screen.
    fn scene(&self, window: usize) -> Result<DynamicScene, ViewError>;
}

/// A camera to look through.
#[derive(Debug, Clone, PartialEq)]
pub struct NamedCamera {
    /// Its name.
    pub name: String,
    /// Pose and intrinsics.
    pub camera: Camera,
    /// The time of its only picture; `None` for a camera that saw the whole clip.
    pub time: Option<f32>,
    /// Whether it was held out of training.
    pub held_out: bool,
}

/// What the viewer asks of the world around it. Called on the thread that draws.
pub trait Host: Send {
    /// The picture that a camera of the content captured nearest to a time, `[H * W * 3]` at the camera's size; `None` where
    /// there is none.
    ///
    /// # Errors
    /// When it can't be read.
    fn captured(&mut self, camera: usize, time: f32) -> Result<Option<Vec<u8>>, ViewError>;

    /// Opens what was dropped on the window.
    ///
    /// # Errors
    /// When it can't be read.
    fn open(&mut self, path: &Path) -> Result<Content, ViewError>;

    /// Saves a picture; where it is then.
    ///
    /// # Errors
    /// When it can't be written.
    fn save_picture(&mut self, frame: &Frame) -> Result<PathBuf, ViewError>;

    /// Saves a path of cameras; where it is then.
    ///
    /// # Errors
    /// When it can't be written.
    fn save_path(&mut self, path: &[PathCamera]) -> Result<PathBuf, ViewError>;

    /// Renders a path of cameras as a video; where it is then.
    ///
    /// # Errors
    /// When it can't be rendered or written.
    fn render_path(
        &mut self,
        scene: &DynamicScene,
        path: &[PathCamera],
    ) -> Result<PathBuf, ViewError>;
}

/// A host that has nothing and writes nothing.
pub struct NoHost;

impl NoHost {
    fn refuse<T>() -> Result<T, ViewError> {
        Err(ViewError::Host("there is nowhere to write to".into()))
    }
}

impl Host for NoHost {
    fn captured(&mut self, _camera: usize, _time: f32) -> Result<Option<Vec<u8>>, ViewError> {
        Ok(None)
    }

    fn open(&mut self, path: &Path) -> Result<Content, ViewError> {
        Err(ViewError::Host(format!(
            "{}: this window opens nothing else",
            path.display()
        )))
    }

    fn save_picture(&mut self, _frame: &Frame) -> Result<PathBuf, ViewError> {
        Self::refuse()
    }

    fn save_path(&mut self, _path: &[PathCamera]) -> Result<PathBuf, ViewError> {
        Self::refuse()
    }

    fn render_path(
        &mut self,
        _scene: &DynamicScene,
        _path: &[PathCamera],
    ) -> Result<PathBuf, ViewError> {
        Self::refuse()
    }
}
