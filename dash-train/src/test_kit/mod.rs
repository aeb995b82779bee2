//! What the tests of several rooms share.
//!
//! | file | what |
//! | --- | --- |
//! | `fixture.rs` | a folder with files that goes at the end of the test |
//! | `poses.rs` | cameras, and the files of poses that hold them |
//! | `slow_motion.rs` | clips in which something moves slowly, or nothing does |
//! | `video.rs` | videos of grey frames, and `ffmpeg` |
//! | `captures.rs` | real captures, in the folder that an environment variable names |

mod captures;
mod fixture;
mod poses;
mod slow_motion;
mod video;

pub(crate) use captures::real_capture;
pub(crate) use fixture::{Fixture, H, W};
pub(crate) use poses::{
    assert_cameras_equal, axis, camera, negated, npy, npy_f64, quaternion, write_model,
};
pub(crate) use slow_motion::slow_clips;
pub(crate) use video::{ffmpeg, grey_frames, output, run};
