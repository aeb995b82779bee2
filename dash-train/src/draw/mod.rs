//! Shapes of a picture, and what writes them: SVG for the page, PNG for papers and slides.
//!
//! Both writers take the same [`Drawing`], so that a picture has one layout. Coordinates are in
//! pixels of the SVG, y down.

mod escape;
mod font;
mod ink;
mod raster;
mod svg;

pub(crate) use escape::escaped;
pub(crate) use font::text_width;
pub(crate) use ink::{N_SERIES_COLORS, dark_style};

/// What a shape is for, which decides its colour on light and on dark paper.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Ink {
    /// Titles and labels.
    Text,
    /// Tick labels, frames and what explains.
    Muted,
    /// Lines to read values by.
    Grid,
    /// The ground.
    Paper,
    /// A series, by its number.
    Series(usize),
    /// This colour on any paper.
    Rgb([u8; 3]),
}

/// Which side of a text stands at its place.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Anchor {
    Start,
    Middle,
    End,
}

/// The form of a measured point.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Mark {
    Circle,
    Square,
    Diamond,
    Triangle,
    Cross,
    DownTriangle,
    Plus,
    LeftTriangle,
    RightTriangle,
}

impl Mark {
    /// All forms, in the order in which series take them.
    pub(crate) const ALL: [Self; 9] = [
        Self::Circle,
        Self::Square,
        Self::Diamond,
        Self::Triangle,
        Self::Cross,
        Self::DownTriangle,
        Self::Plus,
        Self::LeftTriangle,
        Self::RightTriangle,
    ];

    /// The outlines of the form around `at`, closed; empty for the circle.
    fn outline(self, [x, y]: [f64; 2], radius: f64) -> Vec<[f64; 2]> {
        let around = |unit: &[[f64; 2]]| -> Vec<[f64; 2]> {
            unit.iter()
                .map(|[dx, dy]| [x + dx * radius, y + dy * radius])
                .collect()
        };
        match self {
            Self::Circle => Vec::new(),
            Self::Square => around(&[[-0.9, -0.9], [0.9, -0.9], [0.9, 0.9], [-0.9, 0.9]]),
            Self::Diamond => around(&[[0.0, -1.25], [1.25, 0.0], [0.0, 1.25], [-1.25, 0.0]]),
            Self::DownTriangle => around(&[[0.0, 1.2], [1.15, -0.85], [-1.15, -0.85]]),
            Self::LeftTriangle => around(&[[-1.2, 0.0], [0.85, -1.15], [0.85, 1.15]]),
            Self::RightTriangle => around(&[[1.2, 0.0], [-0.85, -1.15], [-0.85, 1.15]]),
            Self::Plus => around(&[
                [-0.4, -1.2],
                [0.4, -1.2],
                [0.4, -0.4],
                [1.2, -0.4],
                [1.2, 0.4],
                [0.4, 0.4],
                [0.4, 1.2],
                [-0.4, 1.2],
                [-0.4, 0.4],
                [-1.2, 0.4],
                [-1.2, -0.4],
                [-0.4, -0.4],
            ]),
            Self::Triangle => around(&[[0.0, -1.2], [1.15, 0.85], [-1.15, 0.85]]),
            Self::Cross => around(&[
                [-1.1, -0.6],
                [-0.6, -1.1],
                [0.0, -0.5],
                [0.6, -1.1],
                [1.1, -0.6],
                [0.5, 0.0],
                [1.1, 0.6],
                [0.6, 1.1],
                [0.0, 0.5],
                [-0.6, 1.1],
                [-1.1, 0.6],
                [-0.5, 0.0],
            ]),
        }
    }
}

/// One shape.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Shape {
    /// Joined line segments.
    Line {
        points: Vec<[f64; 2]>,
        ink: Ink,
        width: f64,
        dashed: bool,
    },
    /// A filled, partly transparent polygon.
    Area {
        points: Vec<[f64; 2]>,
        ink: Ink,
        opacity: f64,
    },
    /// A measured point; `tip` is shown where a pointer rests on it.
    Point {
        at: [f64; 2],
        mark: Mark,
        ink: Ink,
        radius: f64,
        tip: String,
    },
    /// An empty circle.
    Ring { at: [f64; 2], ink: Ink, radius: f64 },
    /// A line of text; `at` is on its base line.
    Text {
        at: [f64; 2],
        text: String,
        ink: Ink,
        size: f64,
        anchor: Anchor,
        bold: bool,
    },
}

/// A picture.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Drawing {
    pub(crate) width: f64,
    pub(crate) height: f64,
    pub(crate) shapes: Vec<Shape>,
}

impl Drawing {
    /// An `svg` element for a page.
    pub(crate) fn svg(&self, description: &str) -> String {
        svg::element(self, description)
    }

    /// The picture on light paper, at `scale` pixels a unit.
    pub(crate) fn raster(&self, scale: f64) -> image::RgbImage {
        raster::raster(self, scale)
    }
}
