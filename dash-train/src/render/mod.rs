//! Pictures of a scene in host memory, and whole sets of them on disk.
//!
//! `picture`: one camera at one time. `shots`: which cameras at which times. `output`: folders of
//! pictures and videos, complete or absent. `overview`: one contact sheet of a run.

mod output;
mod overview;
mod picture;
mod shots;

pub use dash_model::{NO_SURFACE_ALPHA, Picture};
pub use output::{FRAME_RATE, PictureFormat, RenderJob, write_pictures, write_video};
pub use overview::write_overview;
pub(crate) use picture::render_timed;
pub use picture::{PictureLayer, render, render_over_time};
pub use shots::{Shot, at_times, file_shots, spiral_shots, test_shots};
