//! Points that several depth maps agree on.

use dash_kernels::Camera;
use glam::{DAffine3, DVec3};

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
    let own = Rays::of(&pictures[index].camera);
    let others: Vec<(&Picture, Rays<'_>, &DepthMap)> = neighbours
        .iter()
        .map(|&other| {
            let picture = &pictures[other];
            (picture, Rays::of(&picture.camera), &maps[other])
        })
        .collect();
    let points = (0..pictures[index].colors.len()).map(|pixel| {
        let point = own.point(pixel, maps[index].inverse[pixel]);
        let (mut sum, mut count) = (point, 1.0);
        for (picture, rays, map) in &others {
            let Some(([u, v], depth)) = rays.camera.project_inside(point.to_array()) else {
                continue;
            };
            let seen = v as usize * rays.camera.width + u as usize;
            let colors = [&pictures[index].colors[pixel], &picture.colors[seen]];
            let off = (1.0 / depth - f64::from(map.inverse[seen])).abs();
            if off <= TOLERANCE * map.planes.step && alike(colors) {
                sum += rays.point(seen, map.inverse[seen]);
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

/// The rays of a camera's pixels.
pub(super) struct Rays<'a> {
    camera: &'a Camera,
    world_from_camera: DAffine3,
}

impl<'a> Rays<'a> {
    pub(super) fn of(camera: &'a Camera) -> Self {
        Self {
            camera,
            world_from_camera: camera.camera_from_world().inverse(),
        }
    }

    /// Of a pixel's centre.
    pub(super) fn point(&self, pixel: usize, inverse_depth: f32) -> DVec3 {
        let camera = self.camera;
        let (x, y) = (pixel % camera.width, pixel / camera.width);
        let ahead = DVec3::new(
            (x as f64 + 0.5 - camera.cx) / camera.fx,
            (y as f64 + 0.5 - camera.cy) / camera.fy,
            1.0,
        );
        let local = ahead / f64::from(inverse_depth);
        self.world_from_camera.transform_point3(local)
    }
}
