//! Initial points: where they are looked for, and colours for those that have none.

use std::path::{Path, PathBuf};

use super::partition::Partition;
use super::poses::colmap::{MODEL_FOLDERS, RIG_MODEL_FOLDERS, has_file, read_model_points};
use super::poses::transforms::{Applied, Transforms};
use super::view::View;
use crate::Error;
use crate::files::{self};
use crate::ply::{PointCloud, read_points};

/// Files with initial points, in the order in which they are looked for.
const POINT_FILES: [&str; 7] = [
    "points3D_downsample2.ply",
    "points3D_downsample.ply",
    "points3d.ply",
    "points3D.ply",
    "fused.ply",
    "sparse_points.ply",
    "sparse_pc.ply",
];
/// COLMAP's dense clouds; they come last, since they are large.
const DENSE_CLOUDS: [&str; 2] = ["colmap/dense/workspace/fused.ply", "colmap/dense/fused.ply"];
/// Points without colours take them from this many views.
const COLORING_VIEWS: usize = 12;
/// Colour of points that no view shows.
const GRAY: u8 = 128;

/// Which COLMAP models share the world of the dataset's poses.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Models {
    /// None.
    Foreign,
    /// Those where COLMAP's own layout has them.
    Own,
    /// Those that preparing a rig leaves behind, dense clouds among them.
    Rig,
}

/// The first of [`POINT_FILES`] that a folder has.
pub(crate) fn known_point_file(root: &Path) -> Option<PathBuf> {
    let mut paths = POINT_FILES.iter().map(|name| root.join(name));
    paths.find(|path| path.is_file())
}

/// The initial points of a dataset: the file its poses name, one of [`POINT_FILES`], or COLMAP's.
pub(crate) fn find_points(
    root: &Path,
    named: Option<&Path>,
    models: Models,
) -> Result<Option<PointCloud>, Error> {
    let known = || known_point_file(root);
    if let Some(file) = named.map(Path::to_path_buf).or_else(known) {
        return Ok(Some(read_points(&file)?).filter(|points| !points.is_empty()));
    }
    let mut folders: Vec<PathBuf> = match models {
        Models::Foreign => Vec::new(),
        Models::Own => MODEL_FOLDERS.iter().map(|name| root.join(name)).collect(),
        Models::Rig => RIG_MODEL_FOLDERS
            .iter()
            .map(|name| root.join(name))
            .collect(),
    };
    if models == Models::Rig {
        folders.extend(first_frames_model(root)?);
    }
    for folder in folders {
        if let Some(points) = read_model_points(&folder)? {
            return Ok(Some(points));
        }
    }
    let is_file = |name: &&&str| root.join(name).is_file();
    match DENSE_CLOUDS.iter().find(is_file) {
        Some(name) if models == Models::Rig => {
            let points = read_points(&root.join(name))?;
            Ok(Some(points).filter(|points| !points.is_empty()))
        }
        _ => Ok(None),
    }
}

/// [`find_points`] where the file of poses may name the points. If it names a missing file, there are none, with
/// a warning.
///
/// # Errors
/// As [`find_points`], and when the file lies outside the dataset's folder.
pub(crate) fn find_named_points(
    root: &Path,
    (name, listed_in): (Option<&str>, &Path),
    models: Models,
) -> Result<Option<PointCloud>, Error> {
    let Some(name) = name else {
        return find_points(root, None, models);
    };
    let file = files::confined(root, name, listed_in)?;
    if !file.is_file() {
        tracing::warn!(
            "{}: not there, although it is named by ply_file_path in {}: training starts without points",
            file.display(),
            listed_in.display()
        );
        return Ok(None);
    }
    find_points(root, Some(&file), models)
}

/// The initial points beside a `transforms.json`: those that it names, or that are there under a known name; else those of the
/// COLMAP model that its poses were made from, brought into their world.
///
/// # Errors
/// As [`find_named_points`].
pub(crate) fn points_of_transforms(
    root: &Path,
    file: &Path,
    transforms: &Transforms,
) -> Result<Option<PointCloud>, Error> {
    let named = transforms.ply_file_path.as_deref();
    let is_file = named.is_some() || known_point_file(root).is_some();
    match transforms.applied() {
        Applied::Transform(applied) if !is_file => find_model_points(root, &applied),
        Applied::Unclear if !is_file => {
            let has_points = |name: &str| has_file(&root.join(name), "points3D");
            if let Some(model) = RIG_MODEL_FOLDERS.into_iter().find(|name| has_points(name)) {
                tracing::warn!(
                    "{}: points of {model} are not used, since `applied_transform` and `applied_scale` don't tell where they are; \
                     name points in the poses' world by `ply_file_path`",
                    file.display()
                );
            }
            Ok(None)
        }
        _ => find_named_points(root, (named, file), Models::Own),
    }
}

/// The points of the first COLMAP model, with a transform applied to them.
fn find_model_points(root: &Path, applied: &[[f64; 4]; 3]) -> Result<Option<PointCloud>, Error> {
    for name in RIG_MODEL_FOLDERS {
        let Some(found) = read_model_points(&root.join(name))? else {
            continue;
        };
        let mut points = PointCloud::default();
        for ([x, y, z], color) in found.positions.into_iter().zip(found.colors) {
            let [x, y, z] = [x, y, z].map(f64::from);
            points.push_finite(applied.map(|[a, b, c, d]| a * x + b * y + c * z + d), color);
        }
        return Ok(Some(points));
    }
    Ok(None)
}

/// The first of the models with one frame each.
fn first_frames_model(root: &Path) -> Result<Option<PathBuf>, Error> {
    let of_frame = |name: &String| {
        let frame = name.strip_prefix("colmap_");
        frame.is_some_and(|digits| digits.parse::<u32>().is_ok())
    };
    let first = files::list(root)?.into_iter().find(of_frame);
    Ok(first.map(|name| root.join(name).join("sparse/0")))
}

/// Points with the median colour of their pixels in some training views; gray where no view shows them.
pub(crate) fn colored(positions: Vec<[f64; 3]>, views: &[View]) -> Result<PointCloud, Error> {
    let train: Vec<&View> = views
        .iter()
        .filter(|v| v.partition == Partition::Train)
        .collect();
    let step = train.len().div_ceil(COLORING_VIEWS).max(1);
    let mut seen: Vec<[Vec<u8>; 3]> = vec![Default::default(); positions.len()];
    for view in train.into_iter().step_by(step) {
        let rgb = view.rgb([1.0; 3])?;
        for (position, seen) in positions.iter().zip(&mut seen) {
            let Some(([u, v], _)) = view.camera.project_inside(*position) else {
                continue;
            };
            let at = (v as usize * view.camera.width + u as usize) * 3;
            for (values, value) in seen.iter_mut().zip(&rgb[at..]) {
                values.push((value * 255.0).round() as u8);
            }
        }
    }
    let mut points = PointCloud::default();
    for (position, seen) in positions.into_iter().zip(seen) {
        let color = seen.map(|mut values| {
            values.sort_unstable();
            values.get(values.len() / 2).copied().unwrap_or(GRAY)
        });
        points.push_finite(position, color);
    }
    Ok(points)
}
