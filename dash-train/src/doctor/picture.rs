//! The cameras, the points and the training box, seen from above and from the side.

use dash_kernels::Camera;
use dash_model::SpaceBox;
use glam::DVec3;
use image::{Rgb, RgbImage};

use super::raster::Panel;

/// Side of each of the two panels, pixels.
const SIDE: i64 = 800;
/// Room around what is drawn, as a share of a panel.
const MARGIN: f64 = 0.06;
/// Points beyond this share on either side do not widen the view.
const TAIL: f64 = 0.02;
/// Length of a camera's pyramid, as a share of what is shown.
const PYRAMID: f64 = 0.06;
/// With more cameras than this, each is drawn smaller.
const FEW_CAMERAS: f64 = 20.0;
const PAPER: [u8; 3] = [250, 250, 248];
const BOX_COLOR: [u8; 3] = [30, 140, 60];
const TRAIN_COLOR: [u8; 3] = [30, 80, 200];
const TEST_COLOR: [u8; 3] = [225, 130, 0];
const DOUBTFUL_COLOR: [u8; 3] = [215, 20, 30];
const FOCUS_COLOR: [u8; 3] = [120, 0, 140];
/// Cameras that are numbered.
const MAX_NUMBERED: usize = 64;

/// A camera in the picture.
#[derive(Debug, Clone)]
pub(super) struct DrawnCamera {
    pub(super) camera: Camera,
    pub(super) held_out: bool,
    pub(super) doubtful: bool,
}

/// What is drawn.
#[derive(Debug, Clone, Default)]
pub(super) struct Sketch {
    pub(super) cameras: Vec<DrawnCamera>,
    pub(super) positions: Vec<[f64; 3]>,
    pub(super) colors: Vec<[f32; 3]>,
    pub(super) space: Option<SpaceBox>,
    pub(super) focus: Option<DVec3>,
}

impl Sketch {
    /// Above on the left, from the side on the right: points in their colours, the box green, cameras to
    /// train on blue, held out orange, with doubtful poses red, each with its index.
    pub(super) fn draw(&self) -> RgbImage {
        let mut image = RgbImage::from_pixel(2 * SIDE as u32, SIDE as u32, Rgb(PAPER));
        let [right, ahead, up] = self.axes();
        for (left, axes) in [(0, [right, ahead]), (SIDE, [ahead, up])] {
            let mut panel = Panel {
                image: &mut image,
                left,
                side: SIDE,
            };
            self.draw_panel(&mut panel, axes);
        }
        for y in 0..SIDE as u32 {
            image.put_pixel(SIDE as u32, y, Rgb([180; 3]));
        }
        image
    }

    /// Right, ahead and up in the world: up is what the cameras agree on, ahead where most look.
    fn axes(&self) -> [DVec3; 3] {
        let sum = |row: usize| -> DVec3 {
            let rows = self
                .cameras
                .iter()
                .map(|c| DVec3::from(c.camera.rotation[row]));
            rows.sum()
        };
        let up = (-sum(1)).try_normalize().unwrap_or(DVec3::Z);
        let forward = sum(2);
        let ahead = (forward - up * forward.dot(up)).try_normalize();
        let ahead = ahead.unwrap_or_else(|| up.any_orthonormal_vector());
        [ahead.cross(up), ahead, up]
    }

    fn draw_panel(&self, panel: &mut Panel, axes: [DVec3; 2]) {
        let flat = |p: DVec3| axes.map(|axis| axis.dot(p));
        let (centre, extent) = self.window(flat);
        let scale = SIDE as f64 * (1.0 - 2.0 * MARGIN) / extent;
        let place = |p: DVec3| {
            let [x, y] = flat(p);
            let middle = SIDE as f64 / 2.0;
            [
                middle + (x - centre[0]) * scale,
                middle - (y - centre[1]) * scale,
            ]
        };
        for (position, color) in self.positions.iter().zip(&self.colors) {
            // White points would not show on paper.
            let shade = color.map(|c| (c * 215.0) as u8);
            panel.dot(place((*position).into()), 1, shade);
        }
        if let Some(space) = &self.space {
            for (from, to) in edges(space) {
                panel.line(place(from), place(to), BOX_COLOR);
            }
        }
        if let Some(focus) = self.focus {
            let [x, y] = place(focus);
            for (dx, dy) in [(6.0, 6.0), (6.0, -6.0)] {
                panel.line([x - dx, y - dy], [x + dx, y + dy], FOCUS_COLOR);
            }
        }
        let crowd = (self.cameras.len() as f64 / FEW_CAMERAS).max(1.0);
        let length = PYRAMID / crowd.sqrt();
        for (index, drawn) in self.cameras.iter().enumerate() {
            let color = match drawn {
                d if d.doubtful => DOUBTFUL_COLOR,
                d if d.held_out => TEST_COLOR,
                _ => TRAIN_COLOR,
            };
            let (apex, corners) = pyramid(&drawn.camera, length * extent);
            for k in 0..4 {
                panel.line(place(apex), place(corners[k]), color);
                panel.line(place(corners[k]), place(corners[(k + 1) % 4]), color);
            }
            panel.dot(place(apex), 1, color);
            if self.cameras.len() <= MAX_NUMBERED {
                let [x, y] = place(apex);
                panel.number([x + 4.0, y + 4.0], index, color);
            }
        }
    }

    /// The middle and the side of the square that shows cameras, box and most of the points.
    fn window(&self, flat: impl Fn(DVec3) -> [f64; 2]) -> ([f64; 2], f64) {
        let mut shown: Vec<[f64; 2]> = self
            .cameras
            .iter()
            .map(|c| flat(c.camera.position().into()))
            .collect();
        for (from, to) in self.space.iter().flat_map(edges) {
            shown.extend([flat(from), flat(to)]);
        }
        let range = |axis: usize| {
            let mut of_points: Vec<f64> = self
                .positions
                .iter()
                .map(|p| flat((*p).into())[axis])
                .collect();
            of_points.sort_by(f64::total_cmp);
            let last = of_points.len().saturating_sub(1) as f64;
            let tails = [TAIL, 1.0 - TAIL].map(|share| of_points.get((share * last) as usize));
            let others = shown.iter().map(|p| &p[axis]);
            others
                .chain(tails.into_iter().flatten())
                .filter(|v| v.is_finite())
                .fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], &v| {
                    [low.min(v), high.max(v)]
                })
        };
        let ranges = [range(0), range(1)];
        let extent = ranges
            .iter()
            .map(|[low, high]| high - low)
            .fold(0.0, f64::max);
        let centre = ranges.map(|[low, high]| if low <= high { (low + high) / 2.0 } else { 0.0 });
        (centre, if extent > 0.0 { extent } else { 1.0 })
    }
}

/// The camera's centre, and the corners of its picture so far in front of it.
fn pyramid(camera: &Camera, depth: f64) -> (DVec3, [DVec3; 4]) {
    let apex = DVec3::from(camera.position());
    let rows = camera.rotation.map(DVec3::from);
    let corner = |u: f64, v: f64| {
        let (x, y) = ((u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy);
        let ray = rows[0] * x + rows[1] * y + rows[2];
        apex + ray * (depth / ray.length())
    };
    let (w, h) = (camera.width as f64, camera.height as f64);
    (
        apex,
        [
            corner(0.0, 0.0),
            corner(w, 0.0),
            corner(w, h),
            corner(0.0, h),
        ],
    )
}

/// The twelve edges of a box.
fn edges(space: &SpaceBox) -> Vec<(DVec3, DVec3)> {
    let corner = |k: usize| {
        let at = |axis: usize| {
            f64::from(if k >> axis & 1 == 1 {
                space.max[axis]
            } else {
                space.min[axis]
            })
        };
        DVec3::new(at(0), at(1), at(2))
    };
    (0..8)
        .flat_map(|k| {
            (0..3)
                .filter(move |axis| k >> axis & 1 == 0)
                .map(move |axis| (k, k | 1 << axis))
        })
        .map(|(a, b)| (corner(a), corner(b)))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cameras_points_and_box_are_where_they_are() {
        let camera = |x: f64| {
            Camera::new(40.0, 40.0, 20.0, 15.0, 40, 30).look_at(
                [x, 0.0, -5.0],
                [0.0; 3],
                [0.0, 1.0, 0.0],
            )
        };
        let drawn = |x, doubtful| DrawnCamera {
            camera: camera(x),
            held_out: false,
            doubtful,
        };
        let sketch = Sketch {
            cameras: vec![drawn(-1.0, false), drawn(1.0, true)],
            positions: vec![[0.0; 3]],
            colors: vec![[0.0; 3]],
            space: Some(SpaceBox {
                min: [-1.0; 3],
                max: [1.0; 3],
                clamp: true,
            }),
            focus: None,
        };
        let image = sketch.draw();
        assert_eq!(image.dimensions(), (1600, 800));
        let centre = |color: [u8; 3], left: u32| {
            let of: Vec<(f64, f64)> = image
                .enumerate_pixels()
                .filter(|(x, _, p)| p.0 == color && (left..left + 800).contains(x))
                .map(|(x, y, _)| (f64::from(x - left), f64::from(y)))
                .collect();
            assert!(!of.is_empty(), "{color:?}");
            let n = of.len() as f64;
            (
                of.iter().map(|p| p.0).sum::<f64>() / n,
                of.iter().map(|p| p.1).sum::<f64>() / n,
            )
        };
        // From above, the cameras are below the box, and the doubtful one at x = 1 beside the other.
        let (box_, sound, doubtful) = (
            centre(BOX_COLOR, 0),
            centre(TRAIN_COLOR, 0),
            centre(DOUBTFUL_COLOR, 0),
        );
        assert!(sound.1 > box_.1 + 100.0 && doubtful.1 > box_.1 + 100.0);
        assert!(
            (sound.0 - doubtful.0).abs() > 50.0,
            "{sound:?} {doubtful:?}"
        );
        assert_eq!(Sketch::default().draw().dimensions(), (1600, 800));
    }
}
