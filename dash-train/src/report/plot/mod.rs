//! Figures: panels with axes, series and labels, laid out as a drawing.
//!
//! # Map
//! - this file: what a figure is made of.
//! - `axis`: ranges and ticks; `panel`: one panel; `labels`: names beside lines and points;
//!   `layout`: panels and legend on one picture.

mod axis;
mod labels;
mod layout;
mod panel;

pub(super) use axis::with_separators;
pub use axis::{Axis, Scale};

/// Series of a colour's number and a form's: whole cycles of colours take the next form.
pub(super) const N_COLORS: usize = crate::draw::N_SERIES_COLORS;

/// A measured point.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Point {
    /// Place along the x axis.
    pub x: f64,
    /// Place along the y axis.
    pub y: f64,
    /// Lowest and highest x, where it was measured several times.
    pub x_range: Option<[f64; 2]>,
    /// Lowest and highest y, where it was measured several times.
    pub y_range: Option<[f64; 2]>,
    /// A name to write beside it.
    pub name: Option<String>,
    /// Whether it is set apart by a ring.
    pub ringed: bool,
}

impl Point {
    /// A point without a spread.
    pub fn new(x: f64, y: f64) -> Self {
        Self {
            x,
            y,
            ..Self::default()
        }
    }
}

/// Points of one thing that was measured.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Series {
    /// Its name in the legend.
    pub label: String,
    /// Number of its colour; equal numbers are of one colour in every panel.
    pub color: usize,
    /// Number of the form of its points.
    pub mark: usize,
    /// Its points, in the order in which they are joined.
    pub points: Vec<Point>,
    /// Whether a line joins the points; y ranges are then a band, else bars.
    pub joined: bool,
    /// Whether that line is dashed.
    pub dashed: bool,
    /// Whether its name stands at the end of the line.
    pub named_at_end: bool,
}

/// One pair of axes.
#[derive(Debug, Clone, PartialEq)]
pub struct Panel {
    /// Above the axes; empty for none.
    pub title: String,
    /// The horizontal axis.
    pub x: Axis,
    /// The vertical axis.
    pub y: Axis,
    /// What is drawn; the last is on top.
    pub series: Vec<Series>,
    /// Pareto fronts: lines under the series.
    pub fronts: Vec<Vec<[f64; 2]>>,
}

impl Panel {
    /// Axes without series.
    pub fn new(title: impl Into<String>, x: Axis, y: Axis) -> Self {
        Self {
            title: title.into(),
            x,
            y,
            series: Vec::new(),
            fronts: Vec::new(),
        }
    }

    /// Points that are numbers but have no place on a logarithmic axis.
    pub fn n_without_place(&self) -> usize {
        let off = |scale: Scale, value: f64| value.is_finite() && !axis::shown(scale, value);
        let points = self.series.iter().flat_map(|series| &series.points);
        points
            .filter(|p| off(self.x.scale, p.x) || off(self.y.scale, p.y))
            .count()
    }
}

/// What a legend explains.
#[derive(Debug, Clone, PartialEq)]
pub struct LegendEntry {
    /// The name.
    pub label: String,
    /// The number of the colour that it explains; absent where it explains a form alone.
    pub color: Option<usize>,
    /// The number of the form.
    pub mark: usize,
    /// Whether a line goes with it.
    pub joined: bool,
    /// Whether that line is dashed.
    pub dashed: bool,
}

/// Panels with one legend and one caption.
#[derive(Debug, Clone, PartialEq)]
pub struct Figure {
    /// Name of its PNG, without extension.
    pub name: String,
    /// Its heading.
    pub title: String,
    /// What a reader must know to read it.
    pub caption: String,
    /// The legend; where it is empty, each series is explained.
    pub legend: Vec<LegendEntry>,
    /// The panels, rows first.
    pub panels: Vec<Panel>,
    /// Panels side by side.
    pub columns: usize,
}
