//! The cameras and initial points of a rig: known ones, or by COLMAP.

use std::ffi::OsString;
use std::path::{Path, PathBuf};

use super::cloud::{self, CloudCounts};
use super::colmap::Colmap;
use super::config::PrepareConfig;
use super::random::random_points;
use super::reconstruct;
use crate::Error;
use crate::dataset::poses::known::KnownCamera;
use crate::ply::PointCloud;

/// Cameras at the size of the first frames, and the cleaned points.
pub(super) struct Found {
    pub(super) cameras: Vec<KnownCamera>,
    /// Where the poses come from, for the user.
    pub(super) origin: String,
    pub(super) points: PointCloud,
    pub(super) counts: Option<CloudCounts>,
}

/// Known or by structure from motion; points triangulated or random.
pub(super) fn find_cameras_and_points(
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
                points: random_points(&pinholes, n, config.seed),
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

/// Looks for COLMAP, and says for what.
pub(super) fn find_colmap(
    workspace: &Path,
    config: &PrepareConfig,
    program: Option<OsString>,
) -> Result<Colmap, Error> {
    let (purpose, instead) = match config.poses {
        Some(_) => (
            "points with the known poses",
            ", or write random points instead with --random-points 20000",
        ),
        None => (
            "the cameras' poses",
            ", or give known poses with --poses, and --random-points 20000 in place of COLMAP's points",
        ),
    };
    match program {
        Some(program) => Colmap::find_at(program, workspace, purpose, instead),
        None => Colmap::find(workspace, purpose, instead),
    }
}

/// Refuses lenses whose distortion can't be undone when the dataset is loaded.
pub(super) fn check_lenses(
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
