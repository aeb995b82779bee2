//! A point cloud of frame 0, as structure from motion would find it.

use super::color::linear_to_srgb8;
use super::render::pixel_ray;
use super::scene::{Instant, ROOM_BACK_M, ROOM_HALF_WIDTH_M, Scene, Seen};
use crate::numbers::standard_normal;
use dash_kernels::Camera;
use glam::DVec3;
use rand::{Rng, SeedableRng};
use rand_pcg::Pcg64;
use serde::{Deserialize, Serialize};

/// Standard deviation of a point's position along each axis, in metres.
pub const POINT_NOISE_M: f64 = 0.003;
/// One point in this many is an outlier anywhere in the room.
pub const OUTLIER_EVERY: usize = 200;
/// A point is kept when this many cameras see it (all of them if there are fewer).
const SEEN_BY: usize = 3;
/// Largest depth difference between a point and what a camera sees there, in metres.
const SAME_POINT_M: f64 = 1e-4;

/// One vertex, with the property names and types of the field's PLY files.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct CloudPoint {
    /// World x in metres.
    pub x: f32,
    /// World y in metres.
    pub y: f32,
    /// World z in metres.
    pub z: f32,
    /// sRGB red.
    pub red: u8,
    /// sRGB green.
    pub green: u8,
    /// sRGB blue.
    pub blue: u8,
}

/// Number of points for a picture size: one per four pixels, 1,000 to 6,000.
pub fn cloud_size(width: usize, height: usize) -> usize {
    (width * height / 4).clamp(1000, 6000)
}

/// `count` surface points at time 0 that at least three cameras see, with noise and outliers.
///
/// Points are drawn evenly over the pictures, so that near surfaces are denser.
pub fn cloud(scene: &Scene, cameras: &[Camera], count: usize, seed: u64) -> Vec<CloudPoint> {
    let instant = scene.at(0.0);
    // Another stream than the scene's own, which has the same seed.
    let mut rng = Pcg64::seed_from_u64(seed ^ 0xc10d);
    let needed = SEEN_BY.min(cameras.len());
    let mut points = Vec::with_capacity(count);
    // The cameras' views overlap almost fully; the bound is for rigs that see nothing.
    for _ in 0..100 * count {
        if points.len() == count || cameras.is_empty() {
            break;
        }
        let camera = &cameras[rng.random_range(0..cameras.len())];
        let u = rng.random_range(0.0..camera.width as f64);
        let v = rng.random_range(0.0..camera.height as f64);
        let ray = pixel_ray(camera, u, v);
        let Some(seen) = instant.trace(&ray) else {
            continue;
        };
        let point = ray.at(seen.distance);
        let seen_by = cameras
            .iter()
            .filter(|camera| sees(&instant, camera, point, &seen))
            .count();
        if seen_by < needed {
            continue;
        }
        let color = instant.shade(&seen, &ray).to_array().map(linear_to_srgb8);
        let position = if points.len() % OUTLIER_EVERY == OUTLIER_EVERY - 1 {
            DVec3::new(
                rng.random_range(-ROOM_HALF_WIDTH_M..ROOM_HALF_WIDTH_M),
                rng.random_range(0.0..2.5),
                rng.random_range(ROOM_BACK_M..1.5),
            )
        } else {
            let noise = [(); 3].map(|()| standard_normal(&mut rng));
            point + POINT_NOISE_M * DVec3::from(noise)
        };
        points.push(CloudPoint {
            x: position.x as f32,
            y: position.y as f32,
            z: position.z as f32,
            red: color[0],
            green: color[1],
            blue: color[2],
        });
    }
    points
}

/// Whether `camera` sees `point`, a point of `seen.object`, in its picture.
fn sees(instant: &Instant<'_>, camera: &Camera, point: DVec3, seen: &Seen) -> bool {
    let Some(([u, v], depth)) = camera.project_inside(point.to_array()) else {
        return false;
    };
    instant
        .trace(&pixel_ray(camera, u, v))
        .is_some_and(|other| {
            other.object == seen.object && (other.distance - depth).abs() < SAME_POINT_M
        })
}
