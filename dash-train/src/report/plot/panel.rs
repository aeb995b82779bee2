//! One panel: frame, ticks, bands, lines, points and names.

use super::axis::{Range, Tick, with_separators};
use super::labels::{Rectangle, place_beside, spread_heights};
use super::{Panel, Point, Series};
use crate::draw::{Anchor, Ink, Mark, Shape, text_width};

pub(super) const TITLE_SIZE: f64 = 13.0;
const LABEL_SIZE: f64 = 11.5;
const TICK_SIZE: f64 = 11.0;
const NAME_SIZE: f64 = 10.5;
const LINE_WIDTH: f64 = 1.8;
const POINT_RADIUS: f64 = 3.4;
const RING_RADIUS: f64 = 6.6;
const BAND_OPACITY: f64 = 0.18;
/// Pixels that a tick's label needs along each axis.
const TICK_ROOM: [f64; 2] = [62.0, 34.0];
const NAME_HEIGHT: f64 = 12.0;
/// Joined series with more points than this have no forms at them.
const FEW_POINTS: usize = 40;

/// The picture's part for one panel, and where its axes are.
pub(super) struct Frame<'a> {
    panel: &'a Panel,
    x: Range,
    y: Range,
    y_ticks: Vec<Tick>,
    /// Left, top, right, bottom of the axes.
    plot: Rectangle,
}

impl<'a> Frame<'a> {
    /// Lays the panel out in `[left, top, right, bottom]`.
    pub(super) fn new(panel: &'a Panel, outer: Rectangle) -> Self {
        let points = || panel.series.iter().flat_map(|series| &series.points);
        let ends = |range: Option<[f64; 2]>| range.into_iter().flatten();
        let xs = points().flat_map(|p| std::iter::once(p.x).chain(ends(p.x_range)));
        let ys = points().flat_map(|p| std::iter::once(p.y).chain(ends(p.y_range)));
        let x = Range::around(panel.x.scale, xs);
        let y = Range::around(panel.y.scale, ys);
        let title = if panel.title.is_empty() { 0.0 } else { 18.0 };
        let (top, bottom) = (outer[1] + title + 22.0, outer[3] - 40.0);
        let y_ticks = y.ticks(((bottom - top) / TICK_ROOM[1]) as usize);
        let widest = |texts: &mut dyn Iterator<Item = f64>| texts.fold(0.0, f64::max);
        let tick_width = widest(&mut y_ticks.iter().map(|t| text_width(&t.label, TICK_SIZE)));
        let named = panel.series.iter().filter(|series| series.named_at_end);
        let name_width = widest(&mut named.map(|series| text_width(&series.label, NAME_SIZE)));
        let right = if name_width > 0.0 {
            name_width + 14.0
        } else {
            10.0
        };
        Self {
            panel,
            x,
            y,
            y_ticks,
            plot: [outer[0] + tick_width + 10.0, top, outer[2] - right, bottom],
        }
    }

    /// Adds everything.
    pub(super) fn draw(&self, shapes: &mut Vec<Shape>) {
        self.draw_axes(shapes);
        for front in &self.panel.fronts {
            let points = front.iter().filter_map(|&[x, y]| self.place(x, y));
            shapes.push(Shape::Line {
                points: points.collect(),
                ink: Ink::Muted,
                width: 1.2,
                dashed: true,
            });
        }
        for series in &self.panel.series {
            self.draw_spread(series, shapes);
        }
        for series in &self.panel.series {
            self.draw_series(series, shapes);
        }
        self.name_lines(shapes);
        self.name_points(shapes);
    }

    fn place(&self, x: f64, y: f64) -> Option<[f64; 2]> {
        let [left, top, right, bottom] = self.plot;
        Some([
            left + self.x.place(x)? * (right - left),
            bottom - self.y.place(y)? * (bottom - top),
        ])
    }

    fn draw_axes(&self, shapes: &mut Vec<Shape>) {
        self.draw_titles(shapes);
        self.draw_y_ticks(shapes);
        self.draw_x_ticks(shapes);
        let [left, _, right, bottom] = self.plot;
        shapes.push(line([[left, bottom], [right, bottom]], Ink::Muted));
        let at = [(left + right) / 2.0, bottom + 33.0];
        let label = &self.panel.x.label;
        shapes.push(text(at, label, Ink::Text, LABEL_SIZE, Anchor::Middle));
    }

    /// The title and the label of the vertical axis, which begin where its numbers do.
    fn draw_titles(&self, shapes: &mut Vec<Shape>) {
        let [left, top, ..] = self.plot;
        let widths = self.y_ticks.iter().map(|t| text_width(&t.label, TICK_SIZE));
        let edge = left - 10.0 - widths.fold(0.0, f64::max);
        if !self.panel.title.is_empty() {
            shapes.push(Shape::Text {
                at: [edge, top - 27.0],
                text: self.panel.title.clone(),
                ink: Ink::Text,
                size: TITLE_SIZE,
                anchor: Anchor::Start,
                bold: true,
            });
        }
        let (at, label) = ([edge, top - 9.0], &self.panel.y.label);
        shapes.push(text(at, label, Ink::Text, LABEL_SIZE, Anchor::Start));
    }

    fn draw_y_ticks(&self, shapes: &mut Vec<Shape>) {
        let [left, top, right, bottom] = self.plot;
        for tick in &self.y_ticks {
            let Some(share) = self.y.place(tick.value) else {
                continue;
            };
            let y = bottom - share * (bottom - top);
            shapes.push(line([[left, y], [right, y]], Ink::Grid));
            let at = [left - 6.0, y + 0.35 * TICK_SIZE];
            shapes.push(text(at, &tick.label, Ink::Muted, TICK_SIZE, Anchor::End));
        }
    }

    fn draw_x_ticks(&self, shapes: &mut Vec<Shape>) {
        let [left, _, right, bottom] = self.plot;
        let mut last_end = f64::NEG_INFINITY;
        for tick in &self.x.ticks(((right - left) / TICK_ROOM[0]) as usize) {
            let Some(share) = self.x.place(tick.value) else {
                continue;
            };
            let x = left + share * (right - left);
            shapes.push(line([[x, bottom], [x, bottom + 4.0]], Ink::Muted));
            let half = text_width(&tick.label, TICK_SIZE) / 2.0;
            // On a logarithmic axis round values crowd.
            if x - half > last_end + 4.0 {
                let at = [x, bottom + 16.0];
                shapes.push(text(at, &tick.label, Ink::Muted, TICK_SIZE, Anchor::Middle));
                last_end = x + half;
            }
        }
    }

    fn draw_spread(&self, series: &Series, shapes: &mut Vec<Shape>) {
        let ink = Ink::Series(series.color);
        if series.joined {
            let side = |end: usize| {
                let points = series.points.iter();
                points.filter_map(move |p| self.place(p.x, p.y_range?[end]))
            };
            let mut outline: Vec<[f64; 2]> = side(1).collect();
            let mut low: Vec<[f64; 2]> = side(0).collect();
            low.reverse();
            outline.extend(low);
            if outline.len() > 2 {
                shapes.push(Shape::Area {
                    points: outline,
                    ink,
                    opacity: BAND_OPACITY,
                });
            }
            return;
        }
        for point in &series.points {
            for ends in bars(point) {
                let placed: Vec<[f64; 2]> =
                    ends.iter().filter_map(|e| self.place(e[0], e[1])).collect();
                if placed.len() == 2 {
                    shapes.push(Shape::Line {
                        points: placed,
                        ink,
                        width: 1.0,
                        dashed: false,
                    });
                }
            }
        }
    }

    fn draw_series(&self, series: &Series, shapes: &mut Vec<Shape>) {
        let ink = Ink::Series(series.color);
        let placed = || {
            let points = series.points.iter();
            points.filter_map(|p| self.place(p.x, p.y).map(|at| (p, at)))
        };
        if series.joined {
            shapes.push(Shape::Line {
                points: placed().map(|(_, at)| at).collect(),
                ink,
                width: LINE_WIDTH,
                dashed: series.dashed,
            });
        }
        let crowded = series.joined && series.points.len() > FEW_POINTS;
        let radius = if series.joined {
            0.75 * POINT_RADIUS
        } else {
            POINT_RADIUS
        };
        for (point, at) in placed().filter(|_| !crowded) {
            if point.ringed {
                shapes.push(Shape::Ring {
                    at,
                    ink: Ink::Text,
                    radius: RING_RADIUS,
                });
            }
            let (x, y) = (number(point.x), number(point.y));
            let name = point
                .name
                .as_ref()
                .map(|n| format!(", {n}"))
                .unwrap_or_default();
            shapes.push(Shape::Point {
                at,
                mark: form(series.mark),
                ink,
                radius,
                tip: format!(
                    "{}{name}: {} {x}, {} {y}",
                    series.label, self.panel.x.label, self.panel.y.label
                ),
            });
        }
    }

    /// Names at the ends of lines.
    fn name_lines(&self, shapes: &mut Vec<Shape>) {
        let [_, top, right, bottom] = self.plot;
        let ends: Vec<(&Series, [f64; 2])> = self
            .panel
            .series
            .iter()
            .filter(|series| series.named_at_end)
            .filter_map(|series| {
                let mut points = series.points.iter().rev();
                Some((series, points.find_map(|p| self.place(p.x, p.y))?))
            })
            .collect();
        let wanted: Vec<f64> = ends.iter().map(|(_, at)| at[1]).collect();
        let heights = spread_heights(&wanted, NAME_HEIGHT, [top, bottom]);
        for ((series, at), height) in ends.iter().zip(heights) {
            let ink = Ink::Series(series.color);
            if right - at[0] > 12.0 || (height - at[1]).abs() > 3.0 {
                shapes.push(Shape::Line {
                    points: vec![[at[0] + 5.0, at[1]], [right + 3.0, height]],
                    ink,
                    width: 0.7,
                    dashed: true,
                });
            }
            shapes.push(Shape::Text {
                at: [right + 6.0, height + 0.35 * NAME_SIZE],
                text: series.label.clone(),
                ink,
                size: NAME_SIZE,
                anchor: Anchor::Start,
                bold: false,
            });
        }
    }

    /// Names beside points, where there is room.
    fn name_points(&self, shapes: &mut Vec<Shape>) {
        let points = || {
            let all = self.panel.series.iter();
            all.flat_map(|series| series.points.iter().map(move |p| (series, p)))
                .filter_map(|(series, p)| self.place(p.x, p.y).map(|at| (series, p, at)))
        };
        let around = |[x, y]: [f64; 2], r: f64| [x - r, y - r, x + r, y + r];
        let mut taken: Vec<Rectangle> = points()
            .map(|(_, p, at)| around(at, if p.ringed { RING_RADIUS } else { POINT_RADIUS }))
            .collect();
        for (_, point, _) in points().filter(|(series, ..)| !series.joined) {
            for ends in bars(point) {
                let placed = ends.map(|[x, y]| self.place(x, y));
                if let [Some(a), Some(b)] = placed {
                    let (left, right) = (a[0].min(b[0]), a[0].max(b[0]));
                    let (top, bottom) = (a[1].min(b[1]), a[1].max(b[1]));
                    taken.push([left - 1.0, top - 1.0, right + 1.0, bottom + 1.0]);
                }
            }
        }
        let [left, top, right, bottom] = self.plot;
        let bounds = [left, top - 4.0, right + 8.0, bottom];
        for (series, point, at) in points() {
            let Some(name) = &point.name else {
                continue;
            };
            let size = [text_width(name, NAME_SIZE), NAME_HEIGHT];
            let distance = if point.ringed { 9.0 } else { 6.0 };
            if let Some((at, own)) = place_beside(at, size, distance, bounds, &taken) {
                taken.push(own);
                shapes.push(Shape::Text {
                    at,
                    text: name.clone(),
                    ink: Ink::Series(series.color),
                    size: NAME_SIZE,
                    anchor: Anchor::Start,
                    bold: false,
                });
            }
        }
    }
}

/// The ends of the lines that show a point's ranges.
fn bars(point: &Point) -> impl Iterator<Item = [[f64; 2]; 2]> {
    let across = point.x_range.map(|[a, b]| [[a, point.y], [b, point.y]]);
    let along = point.y_range.map(|[a, b]| [[point.x, a], [point.x, b]]);
    [across, along].into_iter().flatten()
}

/// The form of points with this number.
pub(super) fn form(number: usize) -> Mark {
    Mark::ALL[number % Mark::ALL.len()]
}

/// A value with four digits that count.
fn number(value: f64) -> String {
    let size = value.abs();
    if value == 0.0 {
        "0".into()
    } else if !(1e-3..1e7).contains(&size) {
        format!("{value:.3e}")
    } else {
        let decimals = (3.0 - size.log10().floor()).clamp(0.0, 6.0) as usize;
        with_separators(value, decimals)
    }
}

fn text(at: [f64; 2], text: &str, ink: Ink, size: f64, anchor: Anchor) -> Shape {
    Shape::Text {
        at,
        text: text.into(),
        ink,
        size,
        anchor,
        bold: false,
    }
}

fn line(points: [[f64; 2]; 2], ink: Ink) -> Shape {
    Shape::Line {
        points: points.into(),
        ink,
        width: 1.0,
        dashed: false,
    }
}
