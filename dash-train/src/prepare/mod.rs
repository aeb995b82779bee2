//! From a rig's recordings to a dataset: frames of all cameras at the same times, poses and points of
//! the first frame, and the dataset's files.
//!
//! | file | what |
//! | --- | --- |
//! | `config.rs`, `summary.rs` | settings, summary |
//! | `sources.rs`, `schedule.rs` | the cameras of a folder; their common times |
//! | `frames.rs` | frames of videos and of folders of images |
//! | `colmap.rs`, `reconstruct.rs` | poses and points by the program `colmap` |
//! | `cloud.rs`, `random.rs` | initial points |
//! | `write.rs`, `output.rs` | the dataset's files; all of them or none |

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
use std::path::{Path, PathBuf};

pub use cloud::CloudCounts;
pub use colmap::{COLMAP, COLMAP_VARIABLE};
pub use config::{CameraModel, LensChoice, PrepareConfig};
pub use frames::FrameSize;
pub use summary::PrepareSummary;

use crate::Error;
use crate::dataset::poses::known::{self, KnownCamera};
use crate::dataset::{LoadOptions, load};
use crate::ply::PointCloud;
use colmap::Colmap;
use config::{held_out, read_offsets};
use output::Output;
use schedule::{Wanted, schedule};
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
    let sources = sources::find(input)?;
    let names: Vec<String> = sources.iter().map(|source| source.name.clone()).collect();
    let held_out = held_out(&config.test_cameras, names.len())?;
    let offsets = match &config.offsets {
        Some(path) => read_offsets(path, &names)?,
        None => vec![0.0; names.len()],
    };
    let output = Output::create(out)?;
    // Before minutes of work.
    let colmap = match config.random_points {
        Some(_) => None,
        None => Some(find_colmap(&output.workspace(), config, program)?),
    };

    let timelines = frames::timelines(&sources, &offsets, config.image_rate)?;
    let wanted = Wanted {
        fps: config.fps,
        start: config.start,
        end: config.end,
    };
    let mut schedule = schedule(&names, &timelines, wanted)?;
    let first_frames = output.workspace().join("first");
    let first_frames = frames::first_frames(&sources, &timelines, &schedule, &first_frames)?;
    let recorded_sizes = frames::sizes(&first_frames)?;
    let sizes: Vec<[usize; 2]> = recorded_sizes
        .iter()
        .map(|&size| config.size.of(size))
        .collect();

    let known = config.poses.as_deref();
    let known = known
        .map(|path| known::read(path, &names, &recorded_sizes))
        .transpose()?;
    let found = find_cameras_and_points(
        config,
        known,
        colmap.as_ref(),
        &first_frames,
        &recorded_sizes,
        &names,
    )?;

    check_lenses(input, &names, &found.cameras, config)?;
    tracing::info!(
        "writing {} frames of {} cameras",
        schedule.n_frames,
        names.len()
    );
    let (written, shortest) = frames::write_all(
        &sources,
        &timelines,
        &schedule,
        &sizes,
        &recorded_sizes,
        &output.dataset(),
    )?;
    let n_frames = written.first().map_or(0, Vec::len);
    let mut remarks = std::mem::take(&mut schedule.remarks);
    if n_frames < schedule.n_frames {
        remarks.push(format!(
            "the last {} frames are left out: {} could not be decoded so far",
            schedule.n_frames - n_frames,
            names[shortest]
        ));
    }
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
            held_out: held_out[index],
        })
        .collect();
    if !found.points.is_empty() {
        write::write_cloud(&output.dataset(), &found.points)?;
    }
    write::write_transforms(
        &output.dataset(),
        &written,
        &schedule,
        !found.points.is_empty(),
    )?;
    check(&output.dataset())?;
    output.finish()?;
    if found.points.len() < FEW_POINTS {
        remarks.push(format!(
            "{} points are few: training looks for more by comparing views; check that the poses belong \
             to these pictures and that neighbouring cameras see the same",
            found.points.len()
        ));
    }
    Ok(PrepareSummary {
        path: out.to_path_buf(),
        n_cameras: names.len(),
        n_frames,
        fps: schedule.fps,
        poses: found.origin,
        cloud: found.counts,
        n_points: found.points.len(),
        held_out: (names
            .iter()
            .zip(&held_out)
            .filter(|(_, held_out)| **held_out))
        .map(|(name, _)| name.clone())
        .collect(),
        remarks,
    })
}

/// Cameras at the size of the first frames, and the cleaned points.
struct Found {
    cameras: Vec<KnownCamera>,
    origin: String,
    points: PointCloud,
    counts: Option<CloudCounts>,
}

fn find_cameras_and_points(
    config: &PrepareConfig,
    known: Option<Vec<KnownCamera>>,
    colmap: Option<&Colmap>,
    first_frames: &[PathBuf],
    sizes: &[[usize; 2]],
    names: &[String],
) -> Result<Found, Error> {
    let given = || match &config.poses {
        Some(path) => format!("from {}", path.display()),
        None => "known".into(),
    };
    let (cameras, origin, triangulated) = match (known, colmap) {
        (Some(cameras), None) => {
            let n = config.random_points.unwrap_or_default();
            let pinholes: Vec<_> = cameras.iter().map(|known| known.camera.clone()).collect();
            return Ok(Found {
                cameras,
                origin: given(),
                points: random::random_points(&pinholes, n, config.seed),
                counts: None,
            });
        }
        (Some(cameras), Some(colmap)) => {
            tracing::info!("COLMAP triangulates points of the first frame with the known poses");
            let points = reconstruct::triangulate(colmap, first_frames, &cameras)?;
            (cameras, given(), points)
        }
        (None, Some(colmap)) => {
            tracing::info!("COLMAP looks for poses and points in the first frame");
            let found = reconstruct::from_motion(
                colmap,
                first_frames,
                sizes,
                names,
                config.camera_model,
                config.lens,
            )?;
            let origin = format!("by COLMAP with {}", found.remark);
            (found.cameras, origin, found.points)
        }
        // Refused by `PrepareConfig::validate`.
        (None, None) => (Vec::new(), String::new(), Vec::new()),
    };
    let (points, counts) = cloud::clean(&triangulated, config.max_points);
    Ok(Found {
        cameras,
        origin,
        points,
        counts: Some(counts),
    })
}

fn find_colmap(
    workspace: &Path,
    config: &PrepareConfig,
    program: Option<OsString>,
) -> Result<Colmap, Error> {
    let (purpose, instead) = match config.poses {
        Some(_) => (
            "points with the known poses",
            ", or write random points instead with --random-points 20000",
        ),
        None => ("the cameras' poses", ", or give known poses with --poses"),
    };
    match program {
        Some(program) => Colmap::find_at(program, workspace, purpose, instead),
        None => Colmap::find(workspace, purpose, instead),
    }
}

/// Refuses lenses whose distortion can't be undone when the dataset is loaded.
fn check_lenses(
    input: &Path,
    names: &[String],
    cameras: &[KnownCamera],
    config: &PrepareConfig,
) -> Result<(), Error> {
    let remedy = match config.poses {
        Some(_) => "undistort the pictures first and give poses without distortion",
        None => "the lens was not found well: try --camera-model simple-radial, or --lens shared",
    };
    let folds = |(_, known): &(&String, &KnownCamera)| !known.lens_can_be_undone();
    match names.iter().zip(cameras).find(folds) {
        None => Ok(()),
        Some((name, known)) => Err(Error::invalid(
            input,
            "lens distortion that can be undone over the whole picture",
            format!(
                "coefficients k {:?}, p {:?} of {name}",
                known.distortion.k, known.distortion.p
            ),
            remedy,
        )),
    }
}

/// Loads the first frame of every camera as training will, so that unreadable files are an error now.
fn check(dataset: &Path) -> Result<(), Error> {
    let options = LoadOptions {
        max_frames: Some(1),
        ..LoadOptions::default()
    };
    load(dataset, &options).map(|_| ())
}
