//! What the tests of several rooms share.
//!
//! | file | what |
//! | --- | --- |
//! | `fixture.rs` | a folder with files that goes at the end of the test |
//! | `poses.rs` | cameras, and the files of poses that hold them |
//! | `video.rs` | videos of grey frames, and `ffmpeg` |
//! | `captures.rs` | real captures, in the folder that an environment variable names |

mod captures;
mod fixture;
mod poses;
mod video;

pub(crate) use captures::real_capture;
pub(crate) use fixture::{Fixture, H, W};
pub(crate) use poses::{
    assert_cameras_equal, axis, camera, negated, npy, npy_f64, quaternion, write_model,
};
pub(crate) use video::{ffmpeg, grey_frames, output, run};
