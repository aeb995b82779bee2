//! Synchronised rigs: the frames of several cameras at the same times.
//!
//! | file | what |
//! | --- | --- |
//! | `camera.rs`, `folders.rs` | cameras and their frames; folders of frames below `images/` |
//! | `assign.rs` | which pose is which camera's, by name |
//! | `images.rs`, `videos.rs` | from cameras to views, by the numbers of images or the time stamps of videos |

pub(crate) mod assign;
pub(crate) mod camera;
pub(crate) mod folders;
mod images;
mod videos;

use camera::{FrameFile, RigCamera};

use super::format::Capture;
use super::loader::{Loader, PlannedView};
use crate::Error;
use crate::ply::PointCloud;

/// What a rig's files are to become.
struct Plan {
    /// Of all cameras at all wanted frames, camera by camera.
    views: Vec<PlannedView>,
    /// How many frames are wanted.
    n_frames: usize,
    /// How many of these are in a second, where that is known.
    frame_rate: Option<f64>,
}

/// All cameras at all wanted frames, camera by camera, with the points that first Gaussians are made of. A camera
/// that is dropped tells nothing of the others' times.
///
/// # Errors
/// When cameras differ in their frames, a frame in its shape from the poses, or one is damaged.
pub(crate) fn load(
    loader: &Loader,
    cameras: &[RigCamera],
    held_out: &[bool],
    points: Option<PointCloud>,
) -> Result<Capture, Error> {
    let names: Vec<&str> = cameras.iter().map(|c| c.source.name.as_str()).collect();
    let kept = loader.options.kept(&names)?;
    let (cameras, held_out): (Vec<RigCamera>, Vec<bool>) = cameras
        .iter()
        .zip(held_out)
        .zip(kept)
        .filter(|(_, kept)| *kept)
        .map(|((camera, held_out), _)| (camera.clone(), *held_out))
        .unzip();
    let (cameras, held_out) = (cameras.as_slice(), held_out.as_slice());
    let lists: Option<Vec<&[FrameFile]>> = cameras.iter().map(|c| c.source.images()).collect();
    let plan = match lists {
        Some(lists) => images::plan(loader, cameras, &lists, held_out)?,
        None => videos::plan(loader, cameras, held_out)?,
    };
    Ok(Capture {
        views: loader.load_kept(plan.views)?,
        points,
        n_frames: plan.n_frames,
        n_cameras: cameras.len(),
        stated_span: None,
        frame_rate: plan.frame_rate,
    })
}
