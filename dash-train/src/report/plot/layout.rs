//! Panels and their legend on one picture.

use super::panel::{Frame, form};
use super::{Figure, LegendEntry};
use crate::draw::{Anchor, Drawing, Ink, Shape, text_width};

const WIDTH: f64 = 900.0;
const PANEL_HEIGHT: f64 = 262.0;
/// Widest that a panel gets.
const MAX_PANEL_WIDTH: f64 = 560.0;
const GAP: f64 = 26.0;
const MARGIN: f64 = 10.0;
const LEGEND_SIZE: f64 = 11.5;
const LEGEND_ROW: f64 = 19.0;
/// Length of a line's sample.
const SAMPLE: f64 = 20.0;

impl Figure {
    /// The picture.
    pub(in super::super) fn drawing(&self) -> Drawing {
        let columns = self.columns.clamp(1, self.panels.len().max(1));
        let of_width = (WIDTH - 2.0 * MARGIN - GAP * (columns - 1) as f64) / columns as f64;
        let panel_width = of_width.min(MAX_PANEL_WIDTH);
        let width = 2.0 * MARGIN + panel_width * columns as f64 + GAP * (columns - 1) as f64;
        let mut shapes = Vec::new();
        let legend = self.draw_legend(width, &mut shapes);
        let top = MARGIN + legend;
        for (i, panel) in self.panels.iter().enumerate() {
            let (row, column) = (i / columns, i % columns);
            let left = MARGIN + column as f64 * (panel_width + GAP);
            let top = top + row as f64 * (PANEL_HEIGHT + 0.4 * GAP);
            let outer = [left, top, left + panel_width, top + PANEL_HEIGHT];
            Frame::new(panel, outer).draw(&mut shapes);
        }
        let rows = self.panels.len().div_ceil(columns) as f64;
        Drawing {
            width,
            height: top + rows * PANEL_HEIGHT + (rows - 1.0).max(0.0) * 0.4 * GAP + MARGIN,
            shapes,
        }
    }

    fn legend_entries(&self) -> Vec<LegendEntry> {
        if !self.legend.is_empty() {
            return self.legend.clone();
        }
        let mut entries: Vec<LegendEntry> = Vec::new();
        for series in self.panels.iter().flat_map(|panel| &panel.series) {
            if !entries.iter().any(|entry| entry.label == series.label) {
                entries.push(LegendEntry {
                    label: series.label.clone(),
                    color: Some(series.color),
                    mark: series.mark,
                    joined: series.joined,
                    dashed: series.dashed,
                });
            }
        }
        entries
    }

    /// Adds a row or more with a sample of each entry, where there are several; its height.
    fn draw_legend(&self, width: f64, shapes: &mut Vec<Shape>) -> f64 {
        let entries = self.legend_entries();
        if entries.len() < 2 {
            return 0.0;
        }
        let (mut x, mut y) = (MARGIN, MARGIN + 10.0);
        for entry in entries {
            let sample = if entry.joined { SAMPLE } else { 10.0 };
            let needed = sample + 6.0 + text_width(&entry.label, LEGEND_SIZE);
            if x > MARGIN && x + needed > width - MARGIN {
                (x, y) = (MARGIN, y + LEGEND_ROW);
            }
            let ink = entry.color.map_or(Ink::Muted, Ink::Series);
            if entry.joined {
                shapes.push(Shape::Line {
                    points: vec![[x, y - 4.0], [x + sample, y - 4.0]],
                    ink,
                    width: 1.8,
                    dashed: entry.dashed,
                });
            }
            shapes.push(Shape::Point {
                at: [x + sample / 2.0, y - 4.0],
                mark: form(entry.mark),
                ink,
                radius: 3.4,
                tip: String::new(),
            });
            shapes.push(Shape::Text {
                at: [x + sample + 6.0, y],
                text: entry.label,
                ink: Ink::Text,
                size: LEGEND_SIZE,
                anchor: Anchor::Start,
                bold: false,
            });
            x += needed + 20.0;
        }
        y + 12.0 - MARGIN
    }
}
