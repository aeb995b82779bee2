//! Rays to pixels.
//!
//! A pixel's result depends on its 16 samples and its centre alone. Shortcuts skip work whose result is known:
//! objects outside a tile, objects behind the nearest hit of a ray, and pixels without an object in any
//! sample that moves or changes.

use super::color::linear_to_srgb8;
use super::rendered::{Rendered, Rest};
use super::scene::{Instant, Seen, nearer};
use super::shape::{Ray, Shape};
use dash_kernels::Camera;
use glam::{DMat3, DVec3};
use rayon::prelude::*;
use std::ops::Range;

/// Samples per pixel side: what is visible is decided on a regular grid of 16 per pixel.
pub const SAMPLES_PER_SIDE: usize = 4;
const SAMPLES: usize = SAMPLES_PER_SIDE * SAMPLES_PER_SIDE;
/// Rays per pixel: the samples, then the centre, which decides the depth.
const RAYS: usize = SAMPLES + 1;
/// The samples (one per row and column of the grid) that are shaded where all 16 see the same
/// face: textures are smooth over a pixel, silhouettes are not.
const SHADED_INSIDE: [usize; 4] = [1, 7, 8, 14];
/// Least cosine between normals of one face within a pixel.
const SAME_FACE_COSINE: f64 = 0.9;
/// Pixels per side of a tile; objects off a tile are skipped for all of it.
const TILE_PX: usize = 8;
/// Allowance in metres for the rounding of an object's nearest depth, far above f64's.
const DEPTH_SLACK_M: f64 = 1e-6;

/// An object as one camera sees it.
struct InView {
    index: usize,
    changes: bool,
    /// The camera's centre in object coordinates.
    origin: DVec3,
    object_from_camera: DMat3,
    extent: Extent,
}

/// Where in a picture a solid can be, generously.
struct Extent {
    /// First and past-the-last pixel column and row.
    columns: [f64; 2],
    rows: [f64; 2],
    /// No point of the solid is nearer than this.
    nearest: f64,
}

impl Extent {
    const EVERYWHERE: Self = Self {
        columns: [f64::NEG_INFINITY, f64::INFINITY],
        rows: [f64::NEG_INFINITY, f64::INFINITY],
        nearest: f64::NEG_INFINITY,
    };
}

/// The objects in reach of a tile, those that start nearer first.
struct TileObjects<'a> {
    changing: Vec<&'a InView>,
    resting: Vec<&'a InView>,
}

/// Renders an instant as one camera sees it.
pub(super) struct Tracer<'a> {
    instant: &'a Instant<'a>,
    camera: &'a Camera,
    world_from_camera: DMat3,
    views: Vec<InView>,
    /// Per column and per row, how far the rays lean.
    right: Vec<Leans>,
    down: Vec<Leans>,
}

/// How far the rays through a pixel column or row lean per metre of depth: one entry per sample,
/// then the centre's.
type Leans = [f64; SAMPLES_PER_SIDE + 1];

/// Some rows of a picture.
struct Band<'a> {
    rows: Range<usize>,
    rgb: &'a mut [u8],
    moving: &'a mut [bool],
    touched: &'a mut [bool],
    depth: &'a mut [f32],
}

impl<'a> Tracer<'a> {
    /// A tracer for the objects that `keep` accepts, given whether they move or change.
    pub(super) fn new(
        instant: &'a Instant<'a>,
        camera: &'a Camera,
        keep: impl Fn(bool) -> bool,
    ) -> Self {
        let camera_from_world = DMat3::from_cols_array_2d(&camera.rotation).transpose();
        let eye = DVec3::from(camera.position());
        let mut views: Vec<InView> = instant
            .posed
            .iter()
            .enumerate()
            .filter(|(_, posed)| keep(posed.changes))
            .map(|(index, posed)| {
                let object_from_camera = posed.object_from_world * camera_from_world.transpose();
                let origin = posed.pose.to_object(eye);
                InView {
                    index,
                    changes: posed.changes,
                    origin,
                    object_from_camera,
                    extent: extent(
                        camera,
                        &posed.object.shape,
                        object_from_camera.transpose(),
                        origin,
                    ),
                }
            })
            .collect();
        views.sort_by(|a, b| a.extent.nearest.total_cmp(&b.extent.nearest));
        Self {
            instant,
            camera,
            world_from_camera: camera_from_world.transpose(),
            views,
            right: leans(camera.width, camera.cx, camera.fx),
            down: leans(camera.height, camera.cy, camera.fy),
        }
    }

    /// A tracer that asks every object along every ray.
    #[cfg(test)]
    pub(super) fn without_shortcuts(instant: &'a Instant<'a>, camera: &'a Camera) -> Self {
        let mut tracer = Self::new(instant, camera, |_| true);
        for view in &mut tracer.views {
            view.extent = Extent::EVERYWHERE;
        }
        tracer.views.sort_by_key(|view| view.index);
        tracer
    }

    /// Renders into `view`; see [`super::render::render_over`].
    pub(super) fn render(&self, rest: Option<&Rest>, view: &mut Rendered) {
        if let Some(rest) = rest {
            view.copy_from(&rest.view);
        }
        self.bands(view).for_each(|mut band| {
            for tile in 0..self.camera.width.div_ceil(TILE_PX) {
                let (columns, views) = self.tile(tile, &band.rows);
                if rest.is_some() && views.changing.is_empty() {
                    continue;
                }
                for y in band.rows.clone() {
                    for x in columns.clone() {
                        let pixel = y * self.camera.width + x;
                        let bounds = rest.map(|rest| [rest.nearest[pixel], rest.farthest[pixel]]);
                        if let Some(seen) = self.look(&views, x, y, bounds) {
                            self.fill(&mut band, x, y, &seen);
                        }
                    }
                }
            }
        });
    }

    /// Renders the resting objects, and bounds the depths of each pixel's surfaces.
    pub(super) fn render_rest(&self, rest: &mut Rest) {
        let pixels = TILE_PX * self.camera.width;
        let depths = rest
            .nearest
            .par_chunks_mut(pixels)
            .zip(rest.farthest.par_chunks_mut(pixels));
        self.bands(&mut rest.view)
            .zip(depths)
            .for_each(|(mut band, (nearest, farthest))| {
                for tile in 0..self.camera.width.div_ceil(TILE_PX) {
                    let (columns, views) = self.tile(tile, &band.rows);
                    for y in band.rows.clone() {
                        for x in columns.clone() {
                            let seen = std::array::from_fn(|ray| {
                                self.trace(&views.resting, None, x, y, ray)
                            });
                            self.fill(&mut band, x, y, &seen);
                            let depths = seen
                                .iter()
                                .map(|seen| seen.map_or(f64::INFINITY, |seen| seen.distance));
                            let pixel = (y - band.rows.start) * self.camera.width + x;
                            nearest[pixel] =
                                (depths.clone().fold(f64::INFINITY, f64::min) as f32).next_down();
                            farthest[pixel] = (depths.fold(0.0, f64::max) as f32).next_up();
                        }
                    }
                }
            });
    }

    /// The picture in bands as high as a tile.
    fn bands<'b>(
        &self,
        view: &'b mut Rendered,
    ) -> impl IndexedParallelIterator<Item = Band<'b>> + use<'b> {
        let height = self.camera.height;
        let pixels = TILE_PX * self.camera.width;
        view.rgb
            .par_chunks_mut(3 * pixels)
            .zip(view.moving.par_chunks_mut(pixels))
            .zip(view.touched.par_chunks_mut(pixels))
            .zip(view.depth.par_chunks_mut(pixels))
            .enumerate()
            .map(move |(band, (((rgb, moving), touched), depth))| Band {
                rows: band * TILE_PX..((band + 1) * TILE_PX).min(height),
                rgb,
                moving,
                touched,
                depth,
            })
    }

    /// The columns of a tile in a band, and what can be seen in it.
    fn tile(&self, tile: usize, rows: &Range<usize>) -> (Range<usize>, TileObjects<'_>) {
        let columns = tile * TILE_PX..((tile + 1) * TILE_PX).min(self.camera.width);
        let overlaps = |[low, high]: [f64; 2], pixels: &Range<usize>| {
            low < pixels.end as f64 && high > pixels.start as f64
        };
        let (changing, resting) = self
            .views
            .iter()
            .filter(|view| {
                overlaps(view.extent.columns, &columns) && overlaps(view.extent.rows, rows)
            })
            .partition(|view| view.changes);
        (columns, TileObjects { changing, resting })
    }

    /// The hits of a pixel's rays; `None` where only resting objects are hit. `rest_depths` bounds the depths of the
    /// resting objects, where they have been rendered.
    fn look(
        &self,
        views: &TileObjects<'_>,
        x: usize,
        y: usize,
        rest_depths: Option<[f32; 2]>,
    ) -> Option<[Option<Seen>; RAYS]> {
        let mut seen: [Option<Seen>; RAYS] =
            std::array::from_fn(|ray| self.trace(&views.changing, None, x, y, ray));
        let [nearest, farthest] =
            rest_depths.map_or([f64::NEG_INFINITY, f64::INFINITY], |d| d.map(f64::from));
        let behind = |seen: &Option<Seen>| seen.is_none_or(|seen| seen.distance > farthest);
        if rest_depths.is_some() && seen.iter().all(behind) {
            return None;
        }
        for (ray, seen) in seen.iter_mut().enumerate() {
            if !views.resting.is_empty() && seen.is_none_or(|seen| seen.distance >= nearest) {
                *seen = self.trace(&views.resting, *seen, x, y, ray);
            }
        }
        Some(seen)
    }

    /// Keeps the nearer of `nearest` and what a ray of a pixel hits of `views`.
    fn trace(
        &self,
        views: &[&InView],
        mut nearest: Option<Seen>,
        x: usize,
        y: usize,
        ray: usize,
    ) -> Option<Seen> {
        let direction = self.direction(x, y, ray);
        for view in views {
            // A hit's distance is its depth, since the direction is 1 long along the camera's axis.
            if nearest.is_some_and(|seen| seen.distance < view.extent.nearest) {
                break;
            }
            let local = Ray {
                origin: view.origin,
                direction: view.object_from_camera * direction,
            };
            nearest = nearer(nearest, view.index, &self.instant.posed[view.index], &local);
        }
        nearest
    }

    /// Where a ray of a pixel points, in camera coordinates.
    fn direction(&self, x: usize, y: usize, ray: usize) -> DVec3 {
        let [i, j] = if ray < SAMPLES {
            [ray % SAMPLES_PER_SIDE, ray / SAMPLES_PER_SIDE]
        } else {
            [SAMPLES_PER_SIDE; 2]
        };
        DVec3::new(self.right[x][i], self.down[y][j], 1.0)
    }

    /// Writes a pixel.
    fn fill(&self, band: &mut Band<'_>, x: usize, y: usize, seen: &[Option<Seen>; RAYS]) {
        let (samples, centre) = (&seen[..SAMPLES], &seen[SAMPLES]);
        let shade = |sample: usize| {
            let ray = || Ray {
                origin: self.camera.position().into(),
                direction: self.world_from_camera * self.direction(x, y, sample),
            };
            samples[sample]
                .as_ref()
                .map_or(DVec3::ZERO, |seen| self.instant.shade(seen, &ray()))
        };
        let color = if one_face(samples) {
            SHADED_INSIDE.iter().map(|&i| shade(i)).sum::<DVec3>() / SHADED_INSIDE.len() as f64
        } else {
            (0..SAMPLES).map(shade).sum::<DVec3>() / SAMPLES as f64
        };
        let moving = samples
            .iter()
            .flatten()
            .filter(|seen| self.instant.posed[seen.object].moving)
            .count();
        let changes = |seen: &Seen| self.instant.posed[seen.object].changes;
        let pixel = (y - band.rows.start) * self.camera.width + x;
        band.rgb[3 * pixel..3 * pixel + 3].copy_from_slice(&color.to_array().map(linear_to_srgb8));
        band.moving[pixel] = 2 * moving >= SAMPLES;
        band.touched[pixel] = samples.iter().flatten().any(changes);
        band.depth[pixel] = centre.map_or(f32::INFINITY, |seen| seen.distance as f32);
    }
}

/// The rays' leans for all columns or rows, by principal point and focal length in pixels.
fn leans(n_pixels: usize, centre_px: f64, focal_px: f64) -> Vec<Leans> {
    let step = 1.0 / SAMPLES_PER_SIDE as f64;
    let mut within = [0.5; SAMPLES_PER_SIDE + 1];
    for (i, within) in within[..SAMPLES_PER_SIDE].iter_mut().enumerate() {
        *within = (i as f64 + 0.5) * step;
    }
    (0..n_pixels)
        .map(|pixel| within.map(|within| (pixel as f64 + within - centre_px) / focal_px))
        .collect()
}

/// Whether all samples of a pixel see the same object from one side.
fn one_face(samples: &[Option<Seen>]) -> bool {
    let Some(first) = samples[0] else {
        return false;
    };
    samples.iter().all(|seen| {
        seen.is_some_and(|seen| {
            seen.object == first.object
                && seen.local_normal.dot(first.local_normal) > SAME_FACE_COSINE
        })
    })
}

/// Where a solid can be seen; everywhere if it reaches behind the camera.
fn extent(camera: &Camera, shape: &Shape, camera_from_object: DMat3, origin: DVec3) -> Extent {
    let half = shape.half_extent();
    let mut bounds = [[f64::INFINITY, f64::NEG_INFINITY]; 2];
    let mut nearest = f64::INFINITY;
    for corner in 0..8 {
        let sign = |bit: i32| if corner >> bit & 1 == 1 { 1.0 } else { -1.0 };
        let p = camera_from_object * (half * DVec3::new(sign(0), sign(1), sign(2)) - origin);
        if p.z < 0.1 {
            return Extent::EVERYWHERE;
        }
        nearest = nearest.min(p.z - DEPTH_SLACK_M);
        let uv = [
            camera.fx * p.x / p.z + camera.cx,
            camera.fy * p.y / p.z + camera.cy,
        ];
        for (bound, value) in bounds.iter_mut().zip(uv) {
            *bound = [bound[0].min(value), bound[1].max(value)];
        }
    }
    let [columns, rows] = bounds;
    Extent {
        columns,
        rows,
        nearest,
    }
}
