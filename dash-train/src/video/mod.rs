//! Pictures and videos on disk: PNG and EXR, and everything that `ffmpeg` does.
//!
//! Every file is written whole or not at all: into a scratch file beside it, then renamed.
//!
//! | file | what |
//! | --- | --- |
//! | `ffmpeg.rs` | the programs `ffmpeg` and `ffprobe`; nothing else starts them |
//! | `probe.rs`, `picture.rs`, `clock.rs` | what a file says: its tracks, how pictures are shown, when frames were taken |
//! | `decode.rs`, `index.rs`, `damage.rs`, `stamps.rs` | any frame of a video, where frames are, what a damaged video still gives, whether videos show the same times |
//! | `extract.rs` | chosen frames as PNG files |
//! | `encode.rs`, `image_files.rs` | videos and pictures that are written |
//! | `error.rs` | the errors for how `ffmpeg` fails |

mod clock;
mod damage;
mod decode;
mod encode;
mod error;
mod extract;
mod ffmpeg;
mod image_files;
mod index;
mod picture;
mod probe;
pub(crate) mod stamps;

pub use dash_model::rgb8;
pub(crate) use decode::{VideoFrame, frame_size};
pub(crate) use encode::Encoding;
pub use encode::{VideoWriter, write_mp4};
pub(crate) use extract::write_frames;
pub(crate) use ffmpeg::version_status;
pub use ffmpeg::{FFMPEG, FFMPEG_VARIABLE, ffmpeg_available, ffmpeg_program, ffprobe_program};
pub(crate) use image_files::write_whole;
pub use image_files::{write_exr_plane, write_exr_rgb, write_png};
pub(crate) use index::VideoIndex;
pub(crate) use picture::MAX_IMAGE_SIDE;
