//! Figures and captions about training runs.

use super::groups::{RunGroup, lines, series};
use super::plot::{Axis, Figure, Panel, Point, Series};
use super::quantities::{COSTS, METRICS};
use super::runs::RunRecord;
use super::settings::{pinned, rules};
use super::statistics::median_points;
use super::table::{Cell, Shown, Table};
use super::tables::{curves, ends, summary};
use super::{Block, log};
use crate::evaluate::CurveLine;
use crate::numbers::median_and_range;

/// Methods whose times differ by more than this are shown over the logarithm of seconds.
const DIFFERENT_TIMES: f64 = 5.0;

/// Figures and tables of groups of runs, in the groups' order; each group has a colour of its own.
/// `prefix` begins the names of their files.
pub fn training_blocks(groups: &[RunGroup], prefix: &str) -> Vec<Block> {
    let mut blocks = vec![Block::Table(summary(groups))];
    let caption = pinned(groups);
    let missing = missing(groups);
    if !missing.is_empty() {
        blocks.push(Block::Text(missing));
    }
    for (name, title, against) in [
        (
            "quality-seconds",
            "Quality against training time",
            Against::Seconds,
        ),
        ("quality-steps", "Quality against steps", Against::Steps),
    ] {
        let figure = along(groups, against, name, title, &caption);
        blocks.extend(figure.map(Block::Figure));
    }
    blocks.extend(at_end(groups, &caption).map(Block::Figure));
    blocks.extend(log::figure(groups).map(Block::Figure));
    let rules = rules(groups);
    blocks.push(Block::Table(Table {
        name: "measured".into(),
        title: "How it was measured".into(),
        columns: vec!["score".into(), "rule".into()],
        rows: rules
            .into_iter()
            .map(|(name, rule)| vec![Cell::Text(name), Cell::Text(rule)])
            .collect(),
        shown: Shown::Folded,
        ..Table::default()
    }));
    blocks.extend(ends(groups).map(Block::Table));
    blocks.extend(curves(groups).map(Block::Table));
    blocks.extend(log::table(groups).map(Block::Table));
    for block in &mut blocks {
        match block {
            Block::Figure(figure) => figure.name.insert_str(0, prefix),
            Block::Table(table) => table.name.insert_str(0, prefix),
            Block::Heading(_) | Block::Text(_) => {}
        }
    }
    blocks
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum Against {
    Seconds,
    Steps,
}

/// Scores along the runs that have them; `None` when none has.
fn along(
    groups: &[RunGroup],
    against: Against,
    name: &str,
    title: &str,
    pinned: &str,
) -> Option<Figure> {
    let x = match against {
        Against::Seconds if times_differ(groups) => Axis::log("seconds trained"),
        Against::Seconds => Axis::linear("seconds trained"),
        Against::Steps => Axis::linear("steps"),
    };
    let mut panels = Vec::new();
    for metric in &METRICS {
        let mut panel = Panel::new("", x.clone(), Axis::linear(metric.label));
        panel.series = lines(groups, |group| median_curve(group, against, metric.along));
        if !panel.series.is_empty() {
            panels.push(panel);
        }
    }
    (!panels.is_empty()).then(|| Figure {
        name: name.into(),
        title: title.into(),
        caption: format!(
            "Scores of held-out views that choose nothing. Evaluation and file writing are not in the \
             seconds. Before the decomposition into static and dynamic Gaussians, the scene is scored as it \
             would be stored: without coarse motion. Lines are medians over the runs of a group, bands lowest \
             to highest; thin dashes lead to names. {pinned}"
        ),
        legend: Vec::new(),
        panels,
        columns: 2,
    })
}

/// The medians at the steps that all measured runs of a group share.
fn median_curve(
    group: &RunGroup,
    against: Against,
    of: fn(&CurveLine) -> Option<f64>,
) -> Vec<Point> {
    let at = |lines: &[&CurveLine]| match against {
        Against::Steps => lines.first().map(|line| line.step as f64),
        Against::Seconds => Some(median_and_range(lines.iter().map(|line| line.seconds))?[0]),
    };
    let curves = group.runs.iter().map(|run| &run.curve);
    median_points(curves, |line| line.step, at, of)
}

fn times_differ(groups: &[RunGroup]) -> bool {
    let last = |run: &RunRecord| run.curve.last().map(|line| line.seconds);
    let ends = groups.iter().flat_map(|group| &group.runs).filter_map(last);
    median_and_range(ends).is_some_and(|[_, low, high]| low > 0.0 && high / low > DIFFERENT_TIMES)
}

/// Quality against what it costs, a point for each run.
fn at_end(groups: &[RunGroup], pinned: &str) -> Option<Figure> {
    let psnr = &METRICS[0];
    let mut panels = Vec::new();
    for cost in &COSTS {
        let x = Axis {
            label: cost.label.into(),
            scale: cost.scale,
        };
        let mut panel = Panel::new("", x, Axis::linear(psnr.label));
        for (i, group) in groups.iter().enumerate() {
            let ends = group.runs.iter().filter_map(RunRecord::end);
            let mut points: Vec<Point> = ends
                .filter_map(|end| Some(Point::new((cost.end)(&end)?, (psnr.end)(&end)?)))
                .collect();
            if let Some(point) = points.first_mut().filter(|_| groups.len() > 1) {
                point.name = Some(group.label.clone());
            }
            if !points.is_empty() {
                panel.series.push(Series {
                    points,
                    ..series(groups, i)
                });
            }
        }
        if !panel.series.is_empty() {
            panels.push(panel);
        }
    }
    (!panels.is_empty()).then(|| Figure {
        name: "quality-cost".into(),
        title: "Quality against size, speed and memory at the end of the runs".into(),
        caption: format!("One point a run. {pinned}"),
        legend: Vec::new(),
        panels,
        columns: 2,
    })
}

/// What could not be shown, and why.
fn missing(groups: &[RunGroup]) -> String {
    let runs = || groups.iter().flat_map(|group| &group.runs);
    let without: Vec<&str> = runs()
        .filter(|run| run.curve.is_empty())
        .map(|run| run.name.as_str())
        .collect();
    let mut out = String::new();
    if !without.is_empty() {
        let names = without.join(", ");
        out.push_str(&format!(
            "No curve.jsonl: made without --curve, and left out of the curves: {names}. "
        ));
    }
    for metric in &METRICS {
        let measured = |run: &RunRecord| {
            run.curve.iter().any(|line| (metric.along)(line).is_some())
                || run.end().is_some_and(|end| (metric.end)(&end).is_some())
        };
        if !runs().any(measured) {
            out.push_str(&format!("Not measured in any run: {}. ", metric.label));
        }
    }
    out
}
