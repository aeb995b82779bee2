//! A window to look at dynamic Gaussian scenes.
//!
//! [`open_window`] shows a [`Content`]: a [`DynamicScene`](dash_model::DynamicScene), one for each window of time of a long clip, or one set of
//! Gaussians for each frame, and the cameras that captured it. The scene is drawn on its own device by the kernels that trained it: a picture in the
//! window is the picture of [`DynamicScene::render_layer`](dash_model::DynamicScene::render_layer), rounded to 8 bits.
//! What the window asks of the world around it (captured pictures, files to write or to open) goes through a [`Host`].
//!
//! # Map
//! | module | holds |
//! | --- | --- |
//! | `content` | what is shown, and the [`Host`] |
//! | [`navigator`] | the eye: orbit, pan, zoom, fly |
//! | [`playback`] | the time: play, step, seek, loop |
//! | [`camera_path`] | cameras between keyframes |
//! | [`draw`] | one layer at one time in 8 bits |
//! | [`pace`] | how large pictures are while something moves |
//! | [`worker`] | the thread that draws |
//! | `screen` | a GPU that scene and window share |
//! | `live` | a scene that trains meanwhile |
//! | `window` | the window: picture, time line, side panel, keys |
//! | [`page`] | a scene as a web page |
//! | `web` | built for browsers: what the page's JavaScript calls |
//!
//! Only `window` knows egui; the others can be used without a window.
//!
//! # Example
//! ```no_run
//! use burn::tensor::Device;
//! use dash_model::{DynamicScene, GaussianRows, Gaussians, SceneSettings};
//! use dash_view::{Content, NoHost, Source, open_window};
//!
//! let rows = GaussianRows::from_points(&[[0.0; 3], [0.3, 0.0, 0.2]], &[[0.9, 0.2, 0.1]; 2], 0, 0.1);
//! let scene = DynamicScene {
//!     static_set: Gaussians::from_rows(&rows, &Device::flex()),
//!     dynamic: None,
//!     settings: SceneSettings::default(),
//! };
//! open_window(Content::new("two spheres", Source::Scene(Box::new(scene)), 1), Box::new(NoHost), None)?;
//! # Ok::<(), dash_view::ViewError>(())
//! ```

#[cfg(not(target_family = "wasm"))]
mod beside;
pub mod camera_path;
mod content;
pub mod draw;
mod error;
#[cfg(not(target_family = "wasm"))]
mod live;
mod middle;
pub mod navigator;
pub mod pace;
pub mod page;
pub mod playback;
#[cfg(not(target_family = "wasm"))]
#[cfg_attr(not(feature = "wgpu"), path = "no_screen.rs")]
mod screen;
mod speed;
mod tracks;
#[cfg(target_family = "wasm")]
mod web;
#[cfg(not(target_family = "wasm"))]
mod window;
#[cfg(not(target_family = "wasm"))]
pub mod worker;

pub use content::{
    Content, FRAME_RATE, FrameSource, Host, NamedCamera, NoHost, Source, WindowSource,
};
pub use error::ViewError;
#[cfg(not(target_family = "wasm"))]
pub use live::Live;
#[cfg(not(target_family = "wasm"))]
pub use screen::Screen;
#[cfg(not(target_family = "wasm"))]
pub use window::{check_display, open_window};
