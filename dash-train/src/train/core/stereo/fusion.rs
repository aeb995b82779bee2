//! Points that several depth maps agree on.

use dash_kernels::Camera;
use glam::DVec3;

use super::{DepthMap, Picture};

/// How far the depths of two views at a point may be apart, in planes.
const TOLERANCE: f64 = 1.5;

/// Mean colour difference from which on two pictures do not show the same, whatever their exposures.
const OTHER_COLOR: f32 = 0.3;

/// For each pixel of a view its point, the mean of those of the views that agree on it; `None` where no other view
/// does.
pub(super) fn confirmed(
    pictures: &[Picture],
    maps: &[DepthMap],
    index: usize,
    neighbours: &[usize],
) -> Vec<Option<[f32; 3]>> {
    let own = &pictures[index];
    let points = own.colors.iter().enumerate().map(|(pixel, color)| {
        let here = point(&own.camera, pixel, maps[index].inverse[pixel]);
        let (mut sum, mut count) = (here, 1.0);
        for &other in neighbours {
            let (picture, map) = (&pictures[other], &maps[other]);
            let Some(([u, v], depth)) = picture.camera.project_inside(here.to_array()) else {
                continue;
            };
            let seen = v as usize * picture.camera.width + u as usize;
            let colors = [color, &picture.colors[seen]];
            let off = (1.0 / depth - f64::from(map.inverse[seen])).abs();
            if off <= TOLERANCE * map.planes.step && alike(colors) {
                sum += point(&picture.camera, seen, map.inverse[seen]);
                count += 1.0;
            }
        }
        (count > 1.0).then(|| (sum / count).as_vec3().to_array())
    });
    points.collect()
}

/// Whether two pixels may show the same.
pub(super) fn alike([a, b]: [&[f32; 4]; 2]) -> bool {
    (0..3).map(|c| (a[c] - b[c]).abs()).sum::<f32>() < 3.0 * OTHER_COLOR
}

/// The point of a pixel's centre, at an inverse depth.
pub(super) fn point(camera: &Camera, pixel: usize, inverse_depth: f32) -> DVec3 {
    let (x, y) = (pixel % camera.width, pixel / camera.width);
    let centre = [x as f64 + 0.5, y as f64 + 0.5];
    camera
        .unproject(centre, 1.0 / f64::from(inverse_depth))
        .into()
}
