//! Figures of `log.jsonl`, which every run has.

use super::groups::{RunGroup, lines, runs_of};
use super::plot::{Axis, Figure, Panel, Point};
use super::statistics::median_points;
use super::table::{Cell, Shown, Table};
use crate::numbers::median_and_range;
use crate::train::LogLine;

type Quantity = (&'static str, fn(&LogLine) -> Option<f64>);

const QUANTITIES: [Quantity; 4] = [
    ("PSNR of training views (dB)", |line| {
        Some(f64::from(line.train_psnr))
    }),
    ("PSNR of validation views (dB)", |line| line.validation_psnr),
    ("static Gaussians", |line| Some(line.n_static as f64)),
    ("dynamic Gaussians", |line| Some(line.n_dynamic as f64)),
];

/// The logs against seconds; `None` when no run has one.
pub(super) fn figure(groups: &[RunGroup]) -> Option<Figure> {
    let mut panels = Vec::new();
    for (label, of) in QUANTITIES {
        let mut panel = Panel::new("", Axis::linear("seconds trained"), Axis::linear(label));
        panel.series = lines(groups, |group| median_log(group, of));
        // A single measurement is no progress.
        if panel.series.iter().any(|series| series.points.len() > 1) {
            panels.push(panel);
        }
    }
    (!panels.is_empty()).then(|| Figure {
        name: "log".into(),
        title: "Progress as the runs logged it".into(),
        caption:
            "From log.jsonl. Training views are scored as they come, each in its own step, and \
                  not rounded; validation views are neither trained on nor tested. Lines are \
                  medians over the runs of a group, bands lowest to highest."
                .into(),
        legend: Vec::new(),
        panels,
        columns: 2,
    })
}

fn median_log(group: &RunGroup, of: fn(&LogLine) -> Option<f64>) -> Vec<Point> {
    let seconds =
        |lines: &[&LogLine]| Some(median_and_range(lines.iter().map(|line| line.seconds))?[0]);
    let logs = group.runs.iter().map(|run| &run.log);
    median_points(logs, |line| line.step, seconds, of)
}

/// Every line of the logs, for a file; `None` when no run has one.
pub(super) fn table(groups: &[RunGroup]) -> Option<Table> {
    let mut columns: Vec<String> = ["group", "run", "step", "seconds trained", "loss"]
        .map(ToString::to_string)
        .into();
    columns.extend(QUANTITIES.map(|(label, _)| label.to_string()));
    let logged =
        runs_of(groups).flat_map(|(label, run)| run.log.iter().map(move |line| (label, run, line)));
    let rows: Vec<Vec<Cell>> = logged
        .map(|(label, run, line)| {
            let mut row = vec![
                Cell::Text(label.into()),
                Cell::Text(run.name.clone()),
                Cell::Text(line.step.to_string()),
                Cell::Number(line.seconds, 2),
                Cell::number(Some(f64::from(line.loss)), 4),
            ];
            row.extend(QUANTITIES.map(|(_, of)| Cell::number(of(line), 2)));
            row
        })
        .collect();
    (!rows.is_empty()).then(|| Table {
        name: "log".into(),
        columns,
        rows,
        shown: Shown::File,
        ..Table::default()
    })
}
