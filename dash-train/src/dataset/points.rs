//! Initial points: where they are looked for, and colours for those that have none.

use std::path::Path;

use super::{DatasetError, Split, View, colmap_model};
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
/// Folders with COLMAP models whose points serve where there is no such file.
const POINT_MODELS: [&str; 6] = [
    "sparse/0",
    "sparse",
    "colmap/sparse/0",
    "colmap/sparse",
    "colmap/dense/workspace/sparse",
    "colmap_0/sparse/0",
];
/// Dense clouds of COLMAP, which serve last, since they are large.
const DENSE_CLOUDS: [&str; 2] = ["colmap/dense/workspace/fused.ply", "colmap/dense/fused.ply"];
/// Points without colours take them from this many views.
const COLORING_VIEWS: usize = 12;
/// Colour of points that no view shows.
const GRAY: u8 = 128;

/// The initial points of a dataset: the file its poses name, one of [`POINT_FILES`], those of a
/// COLMAP model, or a dense cloud.
pub(super) fn find_points(
    root: &Path,
    named: Option<&Path>,
) -> Result<Option<PointCloud>, DatasetError> {
    let is_file = |name: &&&str| root.join(name).is_file();
    let known = || POINT_FILES.iter().find(is_file).map(|name| root.join(name));
    if let Some(file) = named.map(Path::to_path_buf).or_else(known) {
        return Ok(Some(read_points(&file)?).filter(|points| !points.is_empty()));
    }
    for folder in POINT_MODELS {
        let points = colmap_model::read_model_points(&root.join(folder))?;
        if let Some(points) = points.filter(|points| !points.is_empty()) {
            return Ok(Some(points));
        }
    }
    match DENSE_CLOUDS.iter().find(is_file) {
        Some(name) => Ok(Some(read_points(&root.join(name))?).filter(|p| !p.is_empty())),
        None => Ok(None),
    }
}

/// Points with the median colour of the pixels that they project onto in some of the training
/// views; gray where no view has them.
pub(super) fn colored(
    positions: Vec<[f64; 3]>,
    views: &[View],
) -> Result<PointCloud, DatasetError> {
    let train: Vec<&View> = views.iter().filter(|v| v.split == Split::Train).collect();
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
