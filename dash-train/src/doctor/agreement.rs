//! Whether points lie on pixels of their own colour.

use dash_kernels::Camera;

use super::cloud::Cloud;
use crate::Error;
use crate::dataset::{Dataset, View};
use crate::numbers::median;
use crate::train::core::initial_views::difference;

/// Largest mean difference of the channels between a pixel and a point of the same colour.
///
/// Compression, view-dependent shading and averaging over pictures stay below a tenth. Different surfaces mostly
/// don't; how often they agree by chance is measured, too.
pub(super) const TOLERANCE: f32 = 0.1;
/// Most pictures that are compared.
const MAX_PICTURES: usize = 96;
/// Pictures with more pixels are made smaller first.
const MAX_PICTURE_PIXELS: usize = 700_000;
/// Points in sight below which a picture says nothing.
const MIN_SEEN: usize = 30;
/// Brightness in which the ratio of two colours is meaningful.
const EXPOSED: [f32; 2] = [0.08, 0.92];
/// Bounds of the exposure that is undone before colours are compared.
const GAINS: [f64; 2] = [0.25, 4.0];
/// Strangers whose colours each point is compared with.
const STRANGERS: usize = 3;

/// A camera's picture of the first frame, where it has one.
#[derive(Clone)]
pub(super) struct Picture {
    pub(super) name: String,
    pub(super) camera_index: usize,
    /// At the size of `pixels`.
    pub(super) camera: Camera,
    pixels: Vec<[u8; 3]>,
}

/// The earliest picture of every camera, evenly chosen among them if there are very many.
pub(super) fn first_pictures(dataset: &Dataset) -> Result<Vec<Picture>, Error> {
    let mut first: std::collections::BTreeMap<usize, &View> = std::collections::BTreeMap::new();
    for view in &dataset.views {
        let known = first.entry(view.camera_index).or_insert(view);
        if view.frame < known.frame {
            *known = view;
        }
    }
    let views: Vec<&View> = first.into_values().collect();
    let kept = views.len().min(MAX_PICTURES);
    (0..kept)
        .map(|k| Picture::of(views[k * views.len() / kept], dataset.background))
        .collect()
}

impl Picture {
    fn of(view: &View, background: Option<[f32; 3]>) -> Result<Self, Error> {
        let rgb = view.rgb(background.unwrap_or([0.0; 3]))?;
        let (width, height) = (view.camera.width, view.camera.height);
        let block = (1..).find(|b| (width / b) * (height / b) <= MAX_PICTURE_PIXELS);
        let block = block.unwrap_or(1).min(width.min(height)).max(1);
        let (small_width, small_height) = (width / block, height / block);
        let mut pixels = Vec::with_capacity(small_width * small_height);
        for y in 0..small_height {
            for x in 0..small_width {
                let mut sum = [0.0; 3];
                for row in y * block..(y + 1) * block {
                    for column in x * block..(x + 1) * block {
                        let at = 3 * (row * width + column);
                        for (c, sum) in sum.iter_mut().enumerate() {
                            *sum += rgb[at + c];
                        }
                    }
                }
                let scale = 255.0 / (block * block) as f32;
                pixels.push(sum.map(|s| (s * scale).round() as u8));
            }
        }
        // Rows and columns that do not fill a block are cut off, so that pixels stay square.
        let scale = block as f64;
        let camera = Camera {
            fx: view.camera.fx / scale,
            fy: view.camera.fy / scale,
            cx: view.camera.cx / scale,
            cy: view.camera.cy / scale,
            width: small_width,
            height: small_height,
            ..view.camera.clone()
        };
        Ok(Self {
            name: view.camera_name.clone(),
            camera_index: view.camera_index,
            camera,
            pixels,
        })
    }

    fn color_at(&self, camera: &Camera, point: [f64; 3]) -> Option<[f32; 3]> {
        let ([u, v], _) = camera.project_inside(point)?;
        // Another camera's pose may come with another size.
        let (x, y) = (u as usize, v as usize);
        let inside = x < self.camera.width && y < self.camera.height;
        inside.then(|| self.pixels[y * self.camera.width + x].map(|c| f32::from(c) / 255.0))
    }

    /// This picture's intrinsics at another camera's pose.
    pub(super) fn at_pose_of(&self, other: &Camera) -> Camera {
        Camera {
            rotation: other.rotation,
            translation: other.translation,
            ..self.camera.clone()
        }
    }
}

/// How points fare in one picture.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Agreement {
    /// Points inside the picture.
    pub(super) seen: usize,
    /// Share of them on pixels of their own colour.
    pub(super) own: f64,
    /// Share of them on pixels of other points' colours.
    pub(super) chance: f64,
    /// Correlation of the points' colours with their pixels', whatever the exposure.
    pub(super) correlation: f64,
    /// How much brighter the picture is than the points, by their median.
    pub(super) gain: Option<f64>,
}

impl Agreement {
    /// The correlation of colours; 0 where too few points are in sight.
    pub(super) fn score(&self) -> f64 {
        if self.seen < MIN_SEEN {
            return 0.0;
        }
        self.correlation
    }

    /// Points, moved by `moved` first, in a picture as `camera` took it.
    pub(super) fn of(
        picture: &Picture,
        camera: &Camera,
        cloud: &Cloud,
        stride: usize,
        moved: impl Fn([f64; 3]) -> [f64; 3],
    ) -> Self {
        let n = cloud.positions.len();
        let seen: Vec<(usize, [f32; 3])> = (0..n)
            .step_by(stride.max(1))
            .filter_map(|row| Some((row, picture.color_at(camera, moved(cloud.positions[row]))?)))
            .collect();
        let luma = |c: [f32; 3]| (c[0] + c[1] + c[2]) / 3.0;
        let exposed = |v: f32| (EXPOSED[0]..EXPOSED[1]).contains(&v);
        let ratios: Vec<f64> = seen
            .iter()
            .map(|&(row, pixel)| (luma(cloud.colors[row]), luma(pixel)))
            .filter(|(point, pixel)| exposed(*point) && exposed(*pixel))
            .map(|(point, pixel)| f64::from(pixel / point))
            .collect();
        let gain = (ratios.len() >= MIN_SEEN).then(|| median(ratios)).flatten();
        let exposure = gain.unwrap_or(1.0).clamp(GAINS[0], GAINS[1]) as f32;
        let hit = |color: [f32; 3], pixel: [f32; 3]| {
            let exposed = color.map(|c| (c * exposure).min(1.0));
            difference(exposed, pixel) <= TOLERANCE
        };
        let (mut own, mut chance) = (0, 0);
        for &(row, pixel) in &seen {
            own += usize::from(hit(cloud.colors[row], pixel));
            for k in 1..=STRANGERS {
                let stranger = (row + k * n / (STRANGERS + 1)) % n;
                chance += usize::from(hit(cloud.colors[stranger], pixel));
            }
        }
        let count = seen.len().max(1) as f64;
        let pairs = seen.iter().map(|&(row, pixel)| (cloud.colors[row], pixel));
        Self {
            correlation: correlation(&pairs.collect::<Vec<_>>()),
            seen: seen.len(),
            own: own as f64 / count,
            chance: chance as f64 / (STRANGERS as f64 * count),
            gain,
        }
    }
}

/// The middle score of all pictures, with cameras changed by `camera` and points moved by `moved`.
pub(super) fn middle_score(
    pictures: &[Picture],
    cloud: &Cloud,
    stride: usize,
    camera: impl Fn(&Camera) -> Camera,
    moved: impl Fn([f64; 3]) -> [f64; 3],
) -> f64 {
    let score = |p: &Picture| Agreement::of(p, &camera(&p.camera), cloud, stride, &moved).score();
    median(pictures.iter().map(score)).unwrap_or(0.0)
}

/// Pearson's correlation over the three channels, each about its own mean; 0 where it is not defined.
fn correlation(pairs: &[([f32; 3], [f32; 3])]) -> f64 {
    let n = pairs.len().max(1) as f64;
    let (mut ab, mut aa, mut bb) = (0.0, 0.0, 0.0);
    for c in 0..3 {
        let mean_a = pairs.iter().map(|p| f64::from(p.0[c])).sum::<f64>() / n;
        let mean_b = pairs.iter().map(|p| f64::from(p.1[c])).sum::<f64>() / n;
        for pair in pairs {
            let (a, b) = (f64::from(pair.0[c]) - mean_a, f64::from(pair.1[c]) - mean_b);
            ab += a * b;
            aa += a * a;
            bb += b * b;
        }
    }
    if aa * bb > 0.0 {
        ab / (aa * bb).sqrt()
    } else {
        0.0
    }
}
