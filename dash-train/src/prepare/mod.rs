//! From a rig's recordings to a dataset: frames of all cameras at the same times, poses and points of
//! the first frame, and the dataset's files.
//!
//! | file | what |
//! | --- | --- |
//! | `config.rs`, `summary.rs` | settings, summary |
//! | `sources.rs`, `schedule.rs` | the cameras of a folder; their common times |
//! | `frames.rs` | frames of videos and of folders of images |
//! | `cameras.rs`, `colmap.rs`, `reconstruct.rs` | poses and points, known or by the program `colmap` |
//! | `cloud.rs`, `random.rs` | initial points |
//! | `write.rs`, `output.rs` | the dataset's files; all of them or none |

mod cameras;
mod cloud;
mod colmap;
mod config;
mod frames;
mod output;
mod random;
mod reconstruct;
mod schedule;
mod sources;
mod summary;
#[cfg(test)]
mod tests;
mod write;

use std::ffi::OsString;
use std::path::Path;

pub use cloud::CloudCounts;
pub use colmap::{COLMAP, COLMAP_VARIABLE};
pub use config::{CameraModel, LensChoice, PrepareConfig};
pub use frames::FrameSize;
pub use summary::PrepareSummary;

use crate::Error;
use crate::dataset::poses::known::{self, KnownCamera};
use crate::dataset::{LoadOptions, load};
use cameras::{Found, check_lenses, find_cameras_and_points, find_colmap};
use config::{held_out, read_offsets};
use frames::{Pictures, turned};
use output::Output;
use schedule::{Schedule, Timeline, Wanted, schedule};
use sources::Source;
use write::WrittenCamera;

/// With fewer points than this, the summary warns.
const FEW_POINTS: usize = 100;

/// Makes a dataset in the folder `out` of the recordings in the folder `input`.
///
/// `out` appears when everything is written: a failure leaves nothing behind.
///
/// # Errors
/// An option that does not fit, recordings without a common time, a missing or failing `ffmpeg` or
/// `colmap`, cameras whose poses are not found, or an `out` that exists and is not an empty folder.
pub fn prepare(input: &Path, out: &Path, config: &PrepareConfig) -> Result<PrepareSummary, Error> {
    prepare_with(input, out, config, None)
}

/// [`prepare`] with another program for `colmap`.
fn prepare_with(
    input: &Path,
    out: &Path,
    config: &PrepareConfig,
    program: Option<OsString>,
) -> Result<PrepareSummary, Error> {
    config.validate()?;
    let rig = Rig::find(input, config)?;
    let output = Output::create(out)?;
    // Before minutes of work.
    let colmap = match config.random_points {
        Some(_) => None,
        None => Some(find_colmap(&output.workspace(), config, program)?),
    };
    let mut clip = Clip::of(&rig, config)?;
    let first_frames = output.workspace().join("first");
    let first_frames = frames::first_frames(
        &clip.pictures,
        &clip.timelines,
        &clip.schedule,
        &first_frames,
    )?;
    let sizes = frames::sizes(&first_frames)?;
    let known = config.poses.as_deref();
    let known = known
        .map(|path| known::read(path, &rig.names, &sizes))
        .transpose()?;
    let found = find_cameras_and_points(
        config,
        known,
        colmap.as_ref(),
        &first_frames,
        &sizes,
        &rig.names,
    )?;
    check_lenses(input, &rig.names, &found.cameras, config)?;
    let mut remarks = std::mem::take(&mut clip.schedule.remarks);
    let (n_frames, shortened) =
        write_dataset(&output.dataset(), &rig, &clip, &found, &sizes, config.size)?;
    remarks.extend(shortened);
    check(&output.dataset())?;
    output.finish()?;
    remarks.extend(few_points(found.points.len()));
    let held_out = rig.names.iter().zip(&rig.held_out);
    Ok(PrepareSummary {
        path: out.to_path_buf(),
        n_cameras: rig.names.len(),
        n_frames,
        fps: clip.schedule.fps,
        poses: found.origin,
        cloud: found.counts,
        n_points: found.points.len(),
        held_out: held_out
            .filter(|(_, held_out)| **held_out)
            .map(|(name, _)| name.clone())
            .collect(),
        remarks,
    })
}

/// The cameras of the input.
struct Rig {
    sources: Vec<Source>,
    names: Vec<String>,
    held_out: Vec<bool>,
    /// Seconds by which each camera's clock is ahead of the rig's.
    offsets: Vec<f64>,
}

impl Rig {
    fn find(input: &Path, config: &PrepareConfig) -> Result<Self, Error> {
        let sources = sources::find(input)?;
        let names: Vec<String> = sources.iter().map(|source| source.name.clone()).collect();
        Ok(Self {
            held_out: held_out(&config.test_cameras, names.len())?,
            offsets: match &config.offsets {
                Some(path) => read_offsets(path, &names)?,
                None => vec![0.0; names.len()],
            },
            sources,
            names,
        })
    }
}

/// When each camera recorded, its pictures, and when frames are taken.
struct Clip<'a> {
    timelines: Vec<Timeline>,
    pictures: Vec<Pictures<'a>>,
    schedule: Schedule,
}

impl<'a> Clip<'a> {
    fn of(rig: &'a Rig, config: &PrepareConfig) -> Result<Self, Error> {
        let (timelines, pictures) =
            frames::recorded(&rig.sources, &rig.offsets, config.image_rate)?;
        let wanted = Wanted {
            fps: config.fps,
            start: config.start,
            end: config.end,
        };
        let mut schedule = schedule(&rig.names, &timelines, wanted)?;
        schedule.remarks.extend(turned(&rig.names, &pictures));
        Ok(Self {
            timelines,
            pictures,
            schedule,
        })
    }
}

/// Writes frames, poses and points; the number of frames, and a remark where videos end early.
fn write_dataset(
    dataset: &Path,
    rig: &Rig,
    clip: &Clip,
    found: &Found,
    recorded_sizes: &[[usize; 2]],
    size: FrameSize,
) -> Result<(usize, Option<String>), Error> {
    let (names, schedule) = (&rig.names, &clip.schedule);
    tracing::info!(
        "writing {} frames of {} cameras",
        schedule.n_frames,
        names.len()
    );
    let sizes: Vec<[usize; 2]> = recorded_sizes
        .iter()
        .map(|&recorded| size.of(recorded))
        .collect();
    let scaled: Vec<Option<[usize; 2]>> = sizes
        .iter()
        .zip(recorded_sizes)
        .map(|(&size, &recorded)| (size != recorded).then_some(size))
        .collect();
    let (written, shortest) = frames::write_all(
        names,
        &clip.pictures,
        &clip.timelines,
        schedule,
        &scaled,
        dataset,
    )?;
    let n_frames = written.first().map_or(0, Vec::len);
    let shortened = (n_frames < schedule.n_frames).then(|| {
        format!(
            "the last {} frames are left out: {} could not be decoded so far",
            schedule.n_frames - n_frames,
            names[shortest]
        )
    });
    let cameras: Vec<KnownCamera> = found
        .cameras
        .iter()
        .zip(&sizes)
        .map(|(known, &size)| known.resized(size))
        .collect();
    let written: Vec<WrittenCamera> = (0..names.len())
        .map(|index| WrittenCamera {
            name: &names[index],
            known: &cameras[index],
            frames: &written[index],
            held_out: rig.held_out[index],
        })
        .collect();
    let has_points = !found.points.is_empty();
    if has_points {
        write::write_cloud(dataset, &found.points)?;
    }
    write::write_transforms(dataset, &written, schedule, has_points)?;
    Ok((n_frames, shortened))
}

/// A remark where points are few.
fn few_points(n: usize) -> Option<String> {
    (n < FEW_POINTS).then(|| {
        format!(
            "{n} points are few: training looks for more by comparing views; check that the poses belong \
             to these pictures and that neighbouring cameras see the same"
        )
    })
}

/// Loads the first frame of every camera as training will, so that unreadable files are an error now.
fn check(dataset: &Path) -> Result<(), Error> {
    let options = LoadOptions {
        max_frames: Some(1),
        ..LoadOptions::default()
    };
    load(dataset, &options).map(|_| ())
}
