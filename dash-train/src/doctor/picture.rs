//! The cameras, the points and the training box, seen from above and from the side.

mod geometry;
mod labels;

use dash_kernels::Camera;
use dash_model::SpaceBox;
use glam::DVec3;
use image::RgbImage;

use crate::draw::{Anchor, Drawing, Ink, Mark, Shape, text_width};
use geometry::{clipped, edges, pyramid};
use labels::{Labels, bounds};

/// Side of each of the two panels, pixels.
const SIDE: f64 = 800.0;
/// Height of the titles above them and of the legend below, pixels.
const STRIP: f64 = 40.0;
/// Room around what is drawn, as a share of a panel.
const MARGIN: f64 = 0.06;
/// Points beyond this share on either side do not widen the view.
const TAIL: f64 = 0.02;
/// Length of a camera's pyramid, as a share of what is shown.
const PYRAMID: f64 = 0.06;
/// With more cameras than this, each is drawn smaller.
const FEW_CAMERAS: f64 = 20.0;
const TITLES: [&str; 2] = ["from above", "from the side"];
const BOX: (Ink, &str) = (Ink::Rgb([30, 140, 60]), "box of the 4D field");
const TRAIN: (Ink, &str) = (Ink::Rgb([30, 80, 200]), "camera to train on");
const HELD_OUT: (Ink, &str) = (Ink::Rgb([225, 130, 0]), "held out");
const DOUBTFUL: (Ink, &str) = (Ink::Rgb([215, 20, 30]), "doubtful pose");
const FOCUS: (Ink, &str) = (Ink::Rgb([120, 0, 140]), "where the cameras look");
/// Heights of letters, pixels.
const LABEL: f64 = 14.0;
const TITLE: f64 = 18.0;
/// Half the side of a point, pixels.
const POINT: f64 = 1.3;

/// A camera in the picture.
#[derive(Debug, Clone)]
pub(super) struct DrawnCamera {
    pub(super) camera: Camera,
    /// What messages call it.
    pub(super) name: String,
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

impl DrawnCamera {
    fn ink(&self) -> (Ink, &'static str) {
        match self {
            camera if camera.doubtful => DOUBTFUL,
            camera if camera.held_out => HELD_OUT,
            _ => TRAIN,
        }
    }
}

impl Sketch {
    /// Above on the left, from the side on the right, with a legend below.
    pub(super) fn draw(&self) -> RgbImage {
        let mut shapes = Vec::new();
        let [right, ahead, up] = self.axes();
        for (k, axes) in [[right, ahead], [ahead, up]].into_iter().enumerate() {
            let left = k as f64 * SIDE;
            self.draw_panel(&mut shapes, left, axes);
            shapes.push(text([left + 16.0, 26.0], TITLES[k], Ink::Text, TITLE));
        }
        for points in [
            [[SIDE, 0.0], [SIDE, SIDE + STRIP]],
            [[0.0, SIDE + STRIP], [2.0 * SIDE, SIDE + STRIP]],
        ] {
            shapes.push(line(points, Ink::Grid));
        }
        self.draw_legend(&mut shapes);
        let drawing = Drawing {
            width: 2.0 * SIDE,
            height: SIDE + 2.0 * STRIP,
            shapes,
        };
        drawing.raster(1.0)
    }

    /// Only what is there.
    fn draw_legend(&self, shapes: &mut Vec<Shape>) {
        let cameras = [TRAIN, HELD_OUT, DOUBTFUL].into_iter();
        let entries = cameras
            .filter(|entry| self.cameras.iter().any(|camera| camera.ink() == *entry))
            .chain(self.space.is_some().then_some(BOX))
            .chain(self.focus.is_some().then_some(FOCUS));
        let (mut x, y) = (20.0, SIDE + 1.5 * STRIP);
        for (ink, words) in entries {
            shapes.push(point([x, y], ink, 6.0));
            shapes.push(text([x + 14.0, y + 5.0], words, Ink::Text, LABEL));
            x += 44.0 + text_width(words, LABEL);
        }
        if !self.positions.is_empty() {
            let words = "points in their colours";
            shapes.push(text([x, y + 5.0], words, Ink::Muted, LABEL));
        }
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

    fn draw_panel(&self, shapes: &mut Vec<Shape>, left: f64, axes: [DVec3; 2]) {
        let flat = |p: DVec3| axes.map(|axis| axis.dot(p));
        let (centre, extent) = self.window(flat);
        let scale = SIDE * (1.0 - 2.0 * MARGIN) / extent;
        let place = |p: DVec3| {
            let [x, y] = flat(p);
            let middle = SIDE / 2.0;
            [
                middle + (x - centre[0]) * scale,
                middle - (y - centre[1]) * scale,
            ]
        };
        let shown = |[x, y]: [f64; 2]| [x + left, y + STRIP];
        for (position, color) in self.positions.iter().zip(&self.colors) {
            let at = place((*position).into());
            if at.iter().all(|v| (POINT..SIDE - POINT).contains(v)) {
                // White points would not show on paper.
                let shade = color.map(|c| (c * 215.0) as u8);
                shapes.push(point(shown(at), Ink::Rgb(shade), POINT));
            }
        }
        let mut draw = |from, to, ink| {
            shapes.extend(clipped(from, to).map(|ends| line(ends.map(shown), ink)));
        };
        for (from, to) in self.space.iter().flat_map(edges) {
            draw(place(from), place(to), BOX.0);
        }
        if let Some([x, y]) = self.focus.map(place) {
            for (dx, dy) in [(6.0, 6.0), (6.0, -6.0)] {
                draw([x - dx, y - dy], [x + dx, y + dy], FOCUS.0);
            }
        }
        let crowd = (self.cameras.len() as f64 / FEW_CAMERAS).max(1.0);
        let length = PYRAMID / crowd.sqrt();
        let pyramids: Vec<[[f64; 2]; 5]> = self
            .cameras
            .iter()
            .map(|drawn| pyramid(&drawn.camera, length * extent).map(place))
            .collect();
        for (drawn, [apex, corners @ ..]) in self.cameras.iter().zip(&pyramids) {
            for k in 0..4 {
                draw(*apex, corners[k], drawn.ink().0);
                draw(corners[k], corners[(k + 1) % 4], drawn.ink().0);
            }
        }
        let shown_at: Vec<_> = pyramids.iter().map(|corners| bounds(corners)).collect();
        let mut labels = Labels::around(&shown_at);
        // Those that a message is about first.
        for doubtful in [true, false] {
            let named = self.cameras.iter().zip(&shown_at);
            for (drawn, beside) in named.filter(|(drawn, _)| drawn.doubtful == doubtful) {
                if let Some(at) = labels.room(*beside, &drawn.name) {
                    shapes.push(text(shown(at), &drawn.name, drawn.ink().0, LABEL));
                }
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

fn line(points: [[f64; 2]; 2], ink: Ink) -> Shape {
    Shape::Line {
        points: points.into(),
        ink,
        width: 1.5,
        dashed: false,
    }
}

fn point(at: [f64; 2], ink: Ink, radius: f64) -> Shape {
    Shape::Point {
        at,
        mark: Mark::Square,
        ink,
        radius,
        tip: String::new(),
    }
}

fn text(at: [f64; 2], words: &str, ink: Ink, size: f64) -> Shape {
    Shape::Text {
        at,
        text: words.into(),
        ink,
        size,
        anchor: Anchor::Start,
        bold: size == TITLE,
    }
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
            name: "cam".into(),
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
        assert_eq!(image.dimensions(), (1600, 880));
        // What is mostly of this colour.
        let is_near = |p: [u8; 3], (ink, _): (Ink, &str)| {
            let Ink::Rgb(color) = ink else { return false };
            p.iter().zip(color).all(|(&a, b)| a.abs_diff(b) < 60)
        };
        let centre = |color: (Ink, &str), left: u32| {
            let of: Vec<(f64, f64)> = image
                .enumerate_pixels()
                .filter(|(x, y, p)| {
                    is_near(p.0, color) && *y < 840 && (left..left + 800).contains(x)
                })
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
        let (box_, sound, doubtful) = (centre(BOX, 0), centre(TRAIN, 0), centre(DOUBTFUL, 0));
        assert!(sound.1 > box_.1 + 100.0 && doubtful.1 > box_.1 + 100.0);
        assert!(
            (sound.0 - doubtful.0).abs() > 50.0,
            "{sound:?} {doubtful:?}"
        );
        assert_eq!(Sketch::default().draw().dimensions(), (1600, 880));
    }
}
