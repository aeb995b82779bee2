//! A drawing as pixels.

use ab_glyph::OutlineCurve;
use image::{Rgb, RgbImage};
use tiny_skia::{
    Color, FillRule, LineCap, LineJoin, Paint, Path, PathBuilder, Pixmap, Stroke, StrokeDash,
    Transform,
};

use super::font::{advance, glyph};
use super::{Anchor, Drawing, Ink, Mark, Shape};

/// Lines around letters make a light font a regular one, and a bold one; shares of the size.
const REGULAR: f64 = 0.022;
const BOLD: f64 = 0.065;
/// Larger pictures are drawn at a smaller scale.
const MAX_SIDE_PX: f64 = 16_000.0;

/// The drawing on light paper.
pub(super) fn raster(drawing: &Drawing, scale: f64) -> RgbImage {
    let longest = drawing.width.max(drawing.height).max(1.0);
    let scale = scale.min(MAX_SIDE_PX / longest);
    let side = |length: f64| (length * scale).ceil().max(1.0) as u32;
    let mut pixels = Pixmap::new(side(drawing.width), side(drawing.height))
        .expect("the sides are positive and bounded");
    pixels.fill(color(Ink::Paper, 1.0));
    let transform = Transform::from_scale(scale as f32, scale as f32);
    for shape in &drawing.shapes {
        draw(shape, &mut pixels, transform);
    }
    RgbImage::from_fn(pixels.width(), pixels.height(), |x, y| {
        let pixel = pixels.pixel(x, y).expect("within the picture");
        Rgb([pixel.red(), pixel.green(), pixel.blue()])
    })
}

fn draw(shape: &Shape, pixels: &mut Pixmap, transform: Transform) {
    let mut fill = |path: Option<Path>, ink, opacity| {
        if let Some(path) = path {
            let rule = FillRule::Winding;
            pixels.fill_path(&path, &paint(ink, opacity), rule, transform, None);
        }
    };
    match shape {
        Shape::Area {
            points,
            ink,
            opacity,
        } => fill(polygon(points, true), *ink, *opacity),
        Shape::Point {
            at,
            mark: Mark::Circle,
            ink,
            radius,
            ..
        } => fill(circle(*at, *radius), *ink, 1.0),
        Shape::Point {
            at,
            mark,
            ink,
            radius,
            ..
        } => fill(polygon(&mark.outline(*at, *radius), true), *ink, 1.0),
        Shape::Line {
            points,
            ink,
            width,
            dashed,
        } => {
            let stroke = Stroke {
                width: *width as f32,
                line_cap: LineCap::Round,
                line_join: LineJoin::Round,
                dash: dashed
                    .then(|| StrokeDash::new(vec![5.0, 4.0], 0.0))
                    .flatten(),
                ..Stroke::default()
            };
            if let Some(path) = polygon(points, false) {
                pixels.stroke_path(&path, &paint(*ink, 1.0), &stroke, transform, None);
            }
        }
        Shape::Ring { at, ink, radius } => {
            let stroke = Stroke {
                width: 1.3,
                ..Stroke::default()
            };
            if let Some(path) = circle(*at, *radius) {
                pixels.stroke_path(&path, &paint(*ink, 1.0), &stroke, transform, None);
            }
        }
        Shape::Text {
            at,
            text,
            ink,
            size,
            anchor,
            bold,
        } => {
            let width = advance(text, *size);
            let start = match anchor {
                Anchor::Start => at[0],
                Anchor::Middle => at[0] - width / 2.0,
                Anchor::End => at[0] - width,
            };
            if let Some(path) = letters(text, [start, at[1]], *size) {
                let paint = paint(*ink, 1.0);
                pixels.fill_path(&path, &paint, FillRule::Winding, transform, None);
                let stroke = Stroke {
                    width: (size * if *bold { BOLD } else { REGULAR }) as f32,
                    ..Stroke::default()
                };
                pixels.stroke_path(&path, &paint, &stroke, transform, None);
            }
        }
    }
}

fn letters(text: &str, [mut x, y]: [f64; 2], size: f64) -> Option<Path> {
    let mut path = PathBuilder::new();
    for character in text.chars() {
        let glyph = glyph(character);
        if let Some(outline) = &glyph.outline {
            add_outline(&mut path, &outline.curves, |px, py| {
                let unit = size / glyph.units;
                (
                    (x + f64::from(px) * unit) as f32,
                    (y - glyph.raised * size - f64::from(py) * unit) as f32,
                )
            });
        }
        x += glyph.advance * size;
    }
    path.finish()
}

/// Adds the closed contours of a glyph.
fn add_outline(
    path: &mut PathBuilder,
    curves: &[OutlineCurve],
    place: impl Fn(f32, f32) -> (f32, f32),
) {
    let mut last = None;
    for curve in curves {
        let (from, to) = match curve {
            OutlineCurve::Line(a, b)
            | OutlineCurve::Quad(a, _, b)
            | OutlineCurve::Cubic(a, _, _, b) => (*a, *b),
        };
        if last != Some(from) {
            if last.is_some() {
                path.close();
            }
            let (x, y) = place(from.x, from.y);
            path.move_to(x, y);
        }
        let (x, y) = place(to.x, to.y);
        match curve {
            OutlineCurve::Line(..) => path.line_to(x, y),
            OutlineCurve::Quad(_, c, _) => {
                let (cx, cy) = place(c.x, c.y);
                path.quad_to(cx, cy, x, y);
            }
            OutlineCurve::Cubic(_, c, d, _) => {
                let ((cx, cy), (dx, dy)) = (place(c.x, c.y), place(d.x, d.y));
                path.cubic_to(cx, cy, dx, dy, x, y);
            }
        }
        last = Some(to);
    }
    if last.is_some() {
        path.close();
    }
}

fn polygon(points: &[[f64; 2]], closed: bool) -> Option<Path> {
    let mut path = PathBuilder::new();
    for (i, [x, y]) in points.iter().enumerate() {
        if i == 0 {
            path.move_to(*x as f32, *y as f32);
        } else {
            path.line_to(*x as f32, *y as f32);
        }
    }
    if closed && points.len() > 1 {
        path.close();
    }
    path.finish()
}

fn circle([x, y]: [f64; 2], radius: f64) -> Option<Path> {
    PathBuilder::from_circle(x as f32, y as f32, radius as f32)
}

fn color(ink: Ink, opacity: f64) -> Color {
    let [r, g, b] = ink.light();
    Color::from_rgba8(r, g, b, (opacity * 255.0).round() as u8)
}

fn paint(ink: Ink, opacity: f64) -> Paint<'static> {
    let mut paint = Paint::default();
    paint.set_color(color(ink, opacity));
    paint.anti_alias = true;
    paint
}

#[cfg(test)]
mod tests {
    use super::*;

    fn drawing(shapes: Vec<Shape>) -> Drawing {
        Drawing {
            width: 40.0,
            height: 20.0,
            shapes,
        }
    }

    fn inked(image: &RgbImage) -> Vec<(u32, u32)> {
        let dark = image.enumerate_pixels().filter(|(_, _, p)| p.0[1] < 128);
        dark.map(|(x, y, _)| (x, y)).collect()
    }

    #[test]
    fn text_is_drawn_where_its_anchor_says() {
        let text = |anchor, x| Shape::Text {
            at: [x, 15.0],
            text: "Hi".into(),
            ink: Ink::Text,
            size: 12.0,
            anchor,
            bold: false,
        };
        for (anchor, x) in [
            (Anchor::Start, 2.0),
            (Anchor::Middle, 20.0),
            (Anchor::End, 38.0),
        ] {
            let image = drawing(vec![text(anchor, x)]).raster(2.0);
            assert_eq!(image.dimensions(), (80, 40));
            let inked = inked(&image);
            assert!(inked.len() > 20, "letters are drawn");
            let (low, high) = (
                inked.iter().map(|p| p.0).min().expect("some"),
                inked.iter().map(|p| p.0).max().expect("some"),
            );
            let width = advance("Hi", 12.0) * 2.0;
            assert!(f64::from(high - low) < width, "{low}..{high} of {width}");
            match anchor {
                Anchor::Start => assert!(low >= 4),
                Anchor::Middle => assert!(low < 40 && high > 38),
                Anchor::End => assert!(high <= 76),
            }
        }
    }

    #[test]
    fn letters_with_holes_keep_them() {
        let shape = Shape::Text {
            at: [5.0, 19.0],
            text: "o".into(),
            ink: Ink::Text,
            size: 24.0,
            anchor: Anchor::Start,
            bold: false,
        };
        let image = drawing(vec![shape]).raster(4.0);
        let inked = inked(&image);
        let mean = |f: fn(&(u32, u32)) -> u32| {
            (inked.iter().map(|p| u64::from(f(p))).sum::<u64>() / inked.len() as u64) as u32
        };
        let centre = (mean(|p| p.0), mean(|p| p.1));
        assert!(!inked.contains(&centre), "the middle of an o is empty");
    }

    #[test]
    fn values_that_are_no_numbers_draw_nothing() {
        let shapes = vec![
            Shape::Line {
                points: vec![[f64::NAN, 0.0], [5.0, 5.0]],
                ink: Ink::Text,
                width: 2.0,
                dashed: true,
            },
            Shape::Point {
                at: [f64::INFINITY, 2.0],
                mark: Mark::Circle,
                ink: Ink::Series(9),
                radius: 3.0,
                tip: String::new(),
            },
        ];
        assert!(inked(&drawing(shapes).raster(1.0)).is_empty());
    }
}
