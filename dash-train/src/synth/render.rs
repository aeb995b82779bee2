//! Rays to pixels.

use super::scene::{Instant, Scene, Seen, nearer};
use super::shape::{Ray, Shape};
use super::texture::linear_to_srgb8;
use dash_kernels::Camera;
use glam::{DMat3, DVec3};
use rayon::prelude::*;

/// Samples per pixel side: what is visible is decided on a regular grid of 16 per pixel.
pub const SAMPLES_PER_SIDE: usize = 4;
const SAMPLES: usize = SAMPLES_PER_SIDE * SAMPLES_PER_SIDE;
/// The samples (one per row and column of the grid) that are shaded where all 16 see the same
/// face: textures are smooth over a pixel, silhouettes are not.
const SHADED_INSIDE: [usize; 4] = [1, 7, 8, 14];
/// Least cosine between normals of one face within a pixel.
const SAME_FACE_COSINE: f64 = 0.9;
/// Pixels per side of a tile; objects off a tile are skipped for all of it.
const TILE_PX: usize = 8;

/// A rendered view. All buffers are row-major, one entry per pixel.
#[derive(Debug, Clone, PartialEq)]
pub struct Rendered {
    /// Picture width.
    pub width: usize,
    /// Picture height.
    pub height: usize,
    /// sRGB, three bytes per pixel, samples averaged in linear light.
    pub rgb: Vec<u8>,
    /// Whether a moving object is the nearest surface in at least half of the pixel's samples.
    pub moving: Vec<bool>,
    /// Whether it is in any sample; elsewhere the colour does not depend on moving objects.
    pub touched: Vec<bool>,
    /// Depth (camera z, metres) of the pixel's centre; infinite where nothing is hit.
    pub depth: Vec<f32>,
}

/// Renders `scene` as `camera` sees it at `time` in [0, 1].
pub fn render(scene: &Scene, camera: &Camera, time: f64) -> Rendered {
    render_over(scene, camera, time, None)
}

/// As [`render`], but copies tiles without moving objects from `rest`, a view of the same scene
/// by the same camera from [`render_rest`].
pub(super) fn render_over(
    scene: &Scene,
    camera: &Camera,
    time: f64,
    rest: Option<&Rendered>,
) -> Rendered {
    let instant = scene.at(time);
    Tracer::new(&instant, camera, |_| true).render(rest)
}

/// The view without the moving objects.
pub(super) fn render_rest(scene: &Scene, camera: &Camera) -> Rendered {
    let instant = scene.at(0.0);
    Tracer::new(&instant, camera, |moving| !moving).render(None)
}

/// The ray through a picture point; a hit's distance is its depth.
pub(super) fn pixel_ray(camera: &Camera, u: f64, v: f64) -> Ray {
    let rows = camera.rotation.map(DVec3::from);
    let direction =
        rows[0] * ((u - camera.cx) / camera.fx) + rows[1] * ((v - camera.cy) / camera.fy) + rows[2];
    Ray {
        origin: camera.position().into(),
        direction,
    }
}

/// An object as one camera sees it.
struct View {
    index: usize,
    /// The camera's centre in object coordinates.
    origin: DVec3,
    object_from_camera: DMat3,
    /// First and past-the-last pixel column and row it can cover.
    columns: [f64; 2],
    rows: [f64; 2],
}

struct Tracer<'a> {
    instant: &'a Instant<'a>,
    camera: &'a Camera,
    views: Vec<View>,
}

impl<'a> Tracer<'a> {
    fn new(instant: &'a Instant<'a>, camera: &'a Camera, keep: impl Fn(bool) -> bool) -> Self {
        let camera_from_world = DMat3::from_cols_array_2d(&camera.rotation).transpose();
        let eye = DVec3::from(camera.position());
        let views = instant
            .posed
            .iter()
            .enumerate()
            .filter(|(_, posed)| keep(posed.moving))
            .map(|(index, posed)| {
                let object_from_camera = posed.object_from_world * camera_from_world.transpose();
                let origin = posed.pose.to_object(eye);
                let [columns, rows] = covered(
                    camera,
                    &posed.object.shape,
                    object_from_camera.transpose(),
                    origin,
                );
                View {
                    index,
                    origin,
                    object_from_camera,
                    columns,
                    rows,
                }
            })
            .collect();
        Self {
            instant,
            camera,
            views,
        }
    }

    fn render(&self, rest: Option<&Rendered>) -> Rendered {
        let (width, height) = (self.camera.width, self.camera.height);
        let bands: Vec<Rendered> = (0..height.div_ceil(TILE_PX))
            .into_par_iter()
            .map(|band| {
                let rows = band * TILE_PX..((band + 1) * TILE_PX).min(height);
                self.band(rows, rest)
            })
            .collect();
        let mut whole = Rendered::empty(width, height);
        for band in bands {
            whole.rgb.extend(band.rgb);
            whole.moving.extend(band.moving);
            whole.touched.extend(band.touched);
            whole.depth.extend(band.depth);
        }
        whole
    }

    fn band(&self, rows: std::ops::Range<usize>, rest: Option<&Rendered>) -> Rendered {
        let width = self.camera.width;
        let tiles: Vec<Option<Vec<&View>>> = (0..width.div_ceil(TILE_PX))
            .map(|tile| {
                let columns = [tile * TILE_PX, (tile + 1) * TILE_PX].map(|x| x as f64);
                let views: Vec<&View> = self
                    .views
                    .iter()
                    .filter(|view| {
                        view.columns[0] < columns[1]
                            && view.columns[1] > columns[0]
                            && view.rows[0] < rows.end as f64
                            && view.rows[1] > rows.start as f64
                    })
                    .collect();
                let at_rest =
                    rest.is_some() && !views.iter().any(|v| self.instant.posed[v.index].moving);
                (!at_rest).then_some(views)
            })
            .collect();
        let mut band = Rendered::empty(width, rows.len());
        for y in rows {
            for x in 0..width {
                match (&tiles[x / TILE_PX], rest) {
                    (None, Some(rest)) => band.push_from(rest, y * width + x),
                    (Some(views), _) => self.pixel(views, x, y, &mut band),
                    (None, None) => unreachable!("tiles are only left out over `rest`"),
                }
            }
        }
        band
    }

    fn pixel(&self, views: &[&View], x: usize, y: usize, out: &mut Rendered) {
        let step = 1.0 / SAMPLES_PER_SIDE as f64;
        let seen: [Option<Seen>; SAMPLES] = std::array::from_fn(|sample| {
            let (i, j) = (sample % SAMPLES_PER_SIDE, sample / SAMPLES_PER_SIDE);
            let u = x as f64 + (i as f64 + 0.5) * step;
            let v = y as f64 + (j as f64 + 0.5) * step;
            self.trace(views, u, v)
        });
        let shade = |seen: &Option<Seen>| {
            seen.as_ref()
                .map_or(DVec3::ZERO, |seen| self.instant.shade(seen))
        };
        let color = if one_face(&seen) {
            SHADED_INSIDE
                .iter()
                .map(|&i| shade(&seen[i]))
                .sum::<DVec3>()
                / SHADED_INSIDE.len() as f64
        } else {
            seen.iter().map(shade).sum::<DVec3>() / SAMPLES as f64
        };
        let moving = seen
            .iter()
            .flatten()
            .filter(|seen| self.instant.posed[seen.object].moving)
            .count();
        out.rgb.extend(color.to_array().map(linear_to_srgb8));
        out.moving.push(2 * moving >= SAMPLES);
        out.touched.push(moving > 0);
        let centre = self.trace(views, x as f64 + 0.5, y as f64 + 0.5);
        out.depth
            .push(centre.map_or(f32::INFINITY, |seen| seen.distance as f32));
    }

    fn trace(&self, views: &[&View], u: f64, v: f64) -> Option<Seen> {
        let camera = self.camera;
        let direction = DVec3::new(
            (u - camera.cx) / camera.fx,
            (v - camera.cy) / camera.fy,
            1.0,
        );
        let mut nearest = None;
        for view in views {
            let local = Ray {
                origin: view.origin,
                direction: view.object_from_camera * direction,
            };
            nearest = nearer(nearest, view.index, &self.instant.posed[view.index], &local);
        }
        nearest
    }
}

/// Whether all samples of a pixel see the same object from one side.
fn one_face(seen: &[Option<Seen>; SAMPLES]) -> bool {
    let Some(first) = seen[0] else {
        return false;
    };
    seen.iter().all(|seen| {
        seen.is_some_and(|seen| {
            seen.object == first.object
                && seen.local_normal.dot(first.local_normal) > SAME_FACE_COSINE
        })
    })
}

/// The columns and rows that a solid can cover, generously; everything where it reaches behind
/// the camera.
fn covered(
    camera: &Camera,
    shape: &Shape,
    camera_from_object: DMat3,
    origin: DVec3,
) -> [[f64; 2]; 2] {
    let half = shape.half_extent();
    let mut bounds = [[f64::INFINITY, f64::NEG_INFINITY]; 2];
    for corner in 0..8 {
        let sign = |bit: i32| if corner >> bit & 1 == 1 { 1.0 } else { -1.0 };
        let p = camera_from_object * (half * DVec3::new(sign(0), sign(1), sign(2)) - origin);
        if p.z < 0.1 {
            return [[f64::NEG_INFINITY, f64::INFINITY]; 2];
        }
        let uv = [
            camera.fx * p.x / p.z + camera.cx,
            camera.fy * p.y / p.z + camera.cy,
        ];
        for (bound, value) in bounds.iter_mut().zip(uv) {
            *bound = [bound[0].min(value), bound[1].max(value)];
        }
    }
    bounds
}

impl Rendered {
    fn empty(width: usize, height: usize) -> Self {
        let pixels = width * height;
        Self {
            width,
            height,
            rgb: Vec::with_capacity(3 * pixels),
            moving: Vec::with_capacity(pixels),
            touched: Vec::with_capacity(pixels),
            depth: Vec::with_capacity(pixels),
        }
    }

    fn push_from(&mut self, other: &Self, pixel: usize) {
        self.rgb
            .extend_from_slice(&other.rgb[3 * pixel..3 * pixel + 3]);
        self.moving.push(other.moving[pixel]);
        self.touched.push(other.touched[pixel]);
        self.depth.push(other.depth[pixel]);
    }

    /// Share of the pixels that are moving.
    pub fn moving_share(&self) -> f64 {
        let moving = self.moving.iter().filter(|m| **m).count();
        moving as f64 / self.moving.len().max(1) as f64
    }
}
