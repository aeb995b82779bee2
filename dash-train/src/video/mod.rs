//! Pictures and videos on disk: PNG and EXR, and everything that `ffmpeg` does.
//!
//! Every file is written whole or not at all: into a scratch file beside it, then renamed.
//!
//! | file | what |
//! | --- | --- |
//! | `ffmpeg.rs` | the programs `ffmpeg` and `ffprobe`; nothing else starts them |
//! | `decode.rs`, `index.rs`, `damage.rs`, `stamps.rs` | any frame of a video, where frames are, what a damaged video still gives, what time stamps tell |
//! | `extract.rs` | frames at given times as PNG files |
//! | `encode.rs`, `image_files.rs` | videos and pictures that are written |
//! | `error.rs` | the errors for how `ffmpeg` fails |

mod damage;
mod decode;
mod encode;
mod error;
mod extract;
mod ffmpeg;
mod image_files;
mod index;
pub(crate) mod stamps;

pub(crate) use decode::{MAX_IMAGE_SIDE, VideoFrame, frame_size};
pub(crate) use encode::Encoding;
pub use encode::{VideoWriter, write_mp4};
pub(crate) use error::refusal;
pub(crate) use extract::{Selection, frame_times, write_frames};
pub(crate) use ffmpeg::version_status;
pub use ffmpeg::{FFMPEG, FFMPEG_VARIABLE, ffmpeg_available, ffmpeg_program, ffprobe_program};
pub(crate) use image_files::write_whole;
pub use image_files::{rgb8, write_exr_plane, write_exr_rgb, write_png};
pub(crate) use index::VideoIndex;
