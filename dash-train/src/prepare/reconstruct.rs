//! Poses and points from the first frames, by COLMAP.

use std::fs;
use std::path::{Path, PathBuf};

use glam::{DMat3, DQuat};

use super::colmap::{Colmap, Lenses};
use super::config::{CameraModel, LensChoice};
use crate::Error;
use crate::dataset::poses::colmap::{TrackedPoint, read_tracked_points};
use crate::dataset::poses::known::{KnownCamera, model_cameras};

/// The camera model of the second attempt, which gives each camera its own lens. One image per camera does not
/// determine more parameters.
const SECOND_MODEL: CameraModel = CameraModel::SimpleRadial;

/// Cameras at the size of the first frames, in the cameras' order, and points.
#[derive(Debug)]
pub(super) struct Reconstruction {
    pub(super) cameras: Vec<KnownCamera>,
    pub(super) points: Vec<TrackedPoint>,
    /// What was assumed, for the user.
    pub(super) remark: String,
}

/// Structure from motion on the first frames: `first_frames` lie in one folder and are called after
/// the index of their camera.
pub(super) fn from_motion(
    colmap: &Colmap,
    first_frames: &[PathBuf],
    sizes: &[[usize; 2]],
    names: &[String],
    model: CameraModel,
    choice: LensChoice,
) -> Result<Reconstruction, Error> {
    let folder = folder_of(first_frames);
    let mut best: Option<(Vec<Option<KnownCamera>>, PathBuf, String)> = None;
    for (model, shared) in attempts(model, choice, sizes) {
        let lenses = Lenses {
            model: model.name(),
            shared,
        };
        let database = colmap.match_features(folder, lenses)?;
        for path in colmap.map(&database, folder)? {
            let cameras = by_index(model_cameras(&path)?, names.len());
            if best
                .as_ref()
                .is_none_or(|(known, ..)| count(&cameras) > count(known))
            {
                // Kept from the next attempt, which empties the folder.
                let kept = colmap.fresh_folder("best")?.join("model");
                fs::rename(&path, &kept).map_err(Error::access(&path))?;
                best = Some((cameras, kept, describe(model, shared)));
            }
        }
        let found = best.as_ref().map_or(0, |(known, ..)| count(known));
        if found == names.len() {
            break;
        }
        tracing::info!(
            "COLMAP found the poses of {found} of {} cameras with {}",
            names.len(),
            describe(model, shared)
        );
    }
    let Some((cameras, path, remark)) = best else {
        return Err(Error::NotRegistered {
            missing: names.to_vec(),
            n_cameras: names.len(),
        });
    };
    let missing: Vec<String> = names
        .iter()
        .zip(&cameras)
        .filter(|(_, camera)| camera.is_none())
        .map(|(name, _)| name.clone())
        .collect();
    if !missing.is_empty() {
        return Err(Error::NotRegistered {
            missing,
            n_cameras: names.len(),
        });
    }
    Ok(Reconstruction {
        cameras: cameras.into_iter().flatten().collect(),
        points: read_tracked_points(&path)?,
        remark,
    })
}

/// Points of the first frames with known poses.
pub(super) fn triangulate(
    colmap: &Colmap,
    first_frames: &[PathBuf],
    known: &[KnownCamera],
) -> Result<Vec<TrackedPoint>, Error> {
    let folder = folder_of(first_frames);
    let lenses = Lenses {
        model: CameraModel::Opencv.name(),
        shared: false,
    };
    let database = colmap.match_features(folder, lenses)?;
    let model = colmap.fresh_folder("known")?;
    write_model(&model, first_frames, known)?;
    let out = colmap.triangulate(&database, folder, &model)?;
    read_tracked_points(&out)
}

/// Camera models to try, and whether all cameras are taken to have one lens.
fn attempts(
    model: CameraModel,
    choice: LensChoice,
    sizes: &[[usize; 2]],
) -> Vec<(CameraModel, bool)> {
    let alike = sizes.windows(2).all(|pair| pair[0] == pair[1]);
    match choice {
        LensChoice::Shared => vec![(model, true)],
        LensChoice::Own => vec![(model, false)],
        LensChoice::Auto if alike => vec![(model, true), (SECOND_MODEL, false)],
        LensChoice::Auto => vec![(model, false)],
    }
}

fn describe(model: CameraModel, shared: bool) -> String {
    let lenses = if shared {
        "one lens for all"
    } else {
        "a lens of its own for each"
    };
    format!("{lenses} ({})", model.name())
}

fn count(cameras: &[Option<KnownCamera>]) -> usize {
    cameras.iter().flatten().count()
}

/// The cameras by the indices that their images are called after.
fn by_index(model: Vec<(String, KnownCamera)>, n: usize) -> Vec<Option<KnownCamera>> {
    let mut cameras = vec![None; n];
    for (image, camera) in model {
        let index = image
            .split('.')
            .next()
            .and_then(|stem| stem.parse::<usize>().ok());
        if let Some(place) = index.and_then(|index| cameras.get_mut(index)) {
            *place = Some(camera);
        }
    }
    cameras
}

fn folder_of(first_frames: &[PathBuf]) -> &Path {
    first_frames
        .first()
        .and_then(|image| image.parent())
        .unwrap_or(Path::new("."))
}

/// Writes a COLMAP text model of cameras without points.
pub(super) fn write_model(
    folder: &Path,
    images: &[PathBuf],
    known: &[KnownCamera],
) -> Result<(), Error> {
    let (mut cameras, mut poses) = (String::new(), String::new());
    for (index, (image, KnownCamera { camera, distortion })) in images.iter().zip(known).enumerate()
    {
        let [k1, k2, k3, k4] = distortion.k;
        let [p1, p2] = distortion.p;
        if k4 != 0.0 {
            return Err(Error::invalid(
                image,
                "lens distortion that COLMAP knows, with k4 = 0",
                format!("k4 = {k4} in the known poses"),
                "undistort the pictures first, or write random points with --random-points",
            ));
        }
        let id = index + 1;
        let model = if k3 == 0.0 { "OPENCV" } else { "FULL_OPENCV" };
        cameras += &format!(
            "{id} {model} {} {} {} {} {} {} {k1} {k2} {p1} {p2}",
            camera.width, camera.height, camera.fx, camera.fy, camera.cx, camera.cy
        );
        // The last three divide, and stay at zero.
        cameras += &if k3 == 0.0 {
            "\n".into()
        } else {
            format!(" {k3} 0 0 0\n")
        };
        let [x, y, z] = camera.rotation;
        let rotation = DMat3::from_cols_array_2d(&[x, y, z]).transpose();
        let q = DQuat::from_mat3(&rotation);
        let [tx, ty, tz] = camera.translation;
        let name = image.file_name().unwrap_or_default().to_string_lossy();
        // The line of observations is empty.
        poses += &format!(
            "{id} {} {} {} {} {tx} {ty} {tz} {id} {name}\n\n",
            q.w, q.x, q.y, q.z
        );
    }
    for (name, text) in [
        ("cameras", cameras),
        ("images", poses),
        ("points3D", String::new()),
    ] {
        let path = folder.join(format!("{name}.txt"));
        fs::write(&path, text).map_err(Error::access(&path))?;
    }
    Ok(())
}
