//! Which triangulated points are kept, and how many.

use std::collections::HashMap;

use kiddo::{ImmutableKdTree, SquaredEuclidean};
use rayon::prelude::*;

use crate::dataset::poses::colmap::TrackedPoint;
use crate::numbers::median;
use crate::ply::PointCloud;

/// Points must be seen in this many images, if enough are.
const TRUSTED_IMAGES: usize = 3;
/// With fewer trusted points, those that two images show are kept too.
const ENOUGH_TRUSTED: usize = 2000;
/// Largest mean reprojection error that is kept, in pixels.
const MAX_ERROR_PX: f64 = 2.0;
/// Neighbours whose mean distance tells whether a point is an outlier.
const N_NEIGHBOURS: usize = 8;
/// Points are outliers this many robust standard deviations above the median log distance to their neighbours.
/// Logarithms, since the background is sparser by orders of magnitude.
const OUTLIER_DEVIATIONS: f64 = 5.0;
/// From the median absolute deviation to a standard deviation, for a normal distribution.
const MAD_TO_DEVIATION: f64 = 1.4826;
/// Smallest standard deviation of the log distances.
const MIN_DEVIATION: f64 = 0.1;
/// Halvings with which the voxels' size is found.
const SIZE_STEPS: usize = 40;

/// How many points were found, left out, merged and kept.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct CloudCounts {
    /// Triangulated.
    pub found: usize,
    /// Left out for a short track or a large error.
    pub doubtful: usize,
    /// Left out as outliers.
    pub outliers: usize,
    /// Merged with others into one.
    pub merged: usize,
    /// Kept.
    pub kept: usize,
    /// Mean reprojection error of all that were triangulated, in pixels of the recorded size.
    pub mean_error_px: f64,
}

/// The points worth starting from, at most `max_points`.
pub(super) fn clean(points: &[TrackedPoint], max_points: usize) -> (PointCloud, CloudCounts) {
    let trusted = reliable(points);
    let without_outliers = without_outliers(&trusted);
    let thinned = thin(&without_outliers, max_points);
    let counts = CloudCounts {
        found: points.len(),
        doubtful: points.len() - trusted.len(),
        outliers: trusted.len() - without_outliers.len(),
        merged: without_outliers.len() - thinned.len(),
        kept: thinned.len(),
        mean_error_px: points.iter().map(|point| point.error).sum::<f64>()
            / points.len().max(1) as f64,
    };
    (thinned, counts)
}

/// Points with small errors in enough images.
fn reliable(points: &[TrackedPoint]) -> PointCloud {
    let exact = |point: &&TrackedPoint| point.error <= MAX_ERROR_PX;
    let trusted = |point: &&TrackedPoint| point.n_images >= TRUSTED_IMAGES;
    let enough = points.iter().filter(exact).filter(trusted).count() >= ENOUGH_TRUSTED;
    let mut cloud = PointCloud::default();
    for point in points.iter().filter(exact) {
        if !enough || trusted(&point) {
            cloud.push_finite(point.position, point.color);
        }
    }
    cloud
}

/// Without the points that are much further from their neighbours than most.
fn without_outliers(cloud: &PointCloud) -> PointCloud {
    if cloud.len() <= N_NEIGHBOURS {
        return cloud.clone();
    }
    let tree: ImmutableKdTree<f32, 3> = ImmutableKdTree::new_from_slice(&cloud.positions);
    let wanted =
        std::num::NonZero::new(N_NEIGHBOURS + 1).unwrap_or(std::num::NonZero::<usize>::MIN);
    let distances: Vec<f64> = cloud
        .positions
        .par_iter()
        .map(|position| {
            // The nearest is the point itself.
            let near = tree.nearest_n::<SquaredEuclidean>(position, wanted);
            let sum: f64 = near.iter().map(|n| f64::from(n.distance).sqrt()).sum();
            (sum / N_NEIGHBOURS as f64).max(f64::MIN_POSITIVE).ln()
        })
        .collect();
    let typical = median(distances.iter().copied()).unwrap_or(0.0);
    let deviations = distances.iter().map(|d| (d - typical).abs());
    let deviation = (MAD_TO_DEVIATION * median(deviations).unwrap_or(0.0)).max(MIN_DEVIATION);
    let limit = typical + OUTLIER_DEVIATIONS * deviation;
    let mut kept = PointCloud::default();
    for (row, _) in distances.iter().enumerate().filter(|(_, d)| **d <= limit) {
        kept.positions.push(cloud.positions[row]);
        kept.colors.push(cloud.colors[row]);
    }
    kept
}

/// At most `max_points`: more are averaged by voxel, with the voxel size that leaves nearly `max_points`.
fn thin(cloud: &PointCloud, max_points: usize) -> PointCloud {
    if cloud.len() <= max_points {
        return cloud.clone();
    }
    let corner = |pick: fn(f32, f32) -> f32| {
        let all = cloud.positions.iter().copied();
        all.reduce(|a, b| [0, 1, 2].map(|axis| pick(a[axis], b[axis])))
            .unwrap_or_default()
    };
    let (low, high) = (corner(f32::min), corner(f32::max));
    let side = (0..3)
        .map(|axis| f64::from(high[axis]) - f64::from(low[axis]))
        .fold(0.0, f64::max);
    // One voxel holds everything at the upper end; at the lower one, next to nothing is merged.
    let (mut too_small, mut large_enough) = (side * 1e-6, side.max(f64::MIN_POSITIVE) * 1.001);
    for _ in 0..SIZE_STEPS {
        let middle = (too_small * large_enough).sqrt();
        if voxels(cloud, low, middle).len() <= max_points {
            large_enough = middle;
        } else {
            too_small = middle;
        }
    }
    let mut groups: Vec<Vec<usize>> = voxels(cloud, low, large_enough).into_values().collect();
    groups.sort();
    let mut thinned = PointCloud::default();
    for rows in groups {
        let n = rows.len() as f64;
        let mean =
            |value: &dyn Fn(usize) -> f64| rows.iter().map(|&row| value(row)).sum::<f64>() / n;
        let position = [0, 1, 2].map(|axis| mean(&|row| f64::from(cloud.positions[row][axis])));
        let color = [0, 1, 2]
            .map(|channel| mean(&|row| f64::from(cloud.colors[row][channel])).round() as u8);
        thinned.push_finite(position, color);
    }
    thinned
}

/// The rows of the points in every voxel that has some, in order.
fn voxels(cloud: &PointCloud, low: [f32; 3], size: f64) -> HashMap<[i64; 3], Vec<usize>> {
    let mut voxels: HashMap<[i64; 3], Vec<usize>> = HashMap::new();
    for (row, position) in cloud.positions.iter().enumerate() {
        let cell = [0, 1, 2]
            .map(|axis| ((f64::from(position[axis]) - f64::from(low[axis])) / size).floor() as i64);
        voxels.entry(cell).or_default().push(row);
    }
    voxels
}
