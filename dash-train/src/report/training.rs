//! Figures and tables of training runs.

use super::groups::RunGroup;
use super::plot::{Axis, Figure, N_COLORS, Panel, Point, Scale, Series};
use super::runs::{End, RunRecord};
use super::settings::{pinned, rules};
use super::statistics::{seconds_to_best, spread};
use super::table::{Cell, Shown, Table};
use super::{Block, log};
use crate::evaluate::CurveLine;

const MEBIBYTE: f64 = (1 << 20) as f64;
/// How far from the best PSNR the times in the table are taken, dB.
const NEAR_BEST_DB: [f64; 2] = [0.5, 0.1];
/// Methods whose times differ by more than this are shown over the logarithm of seconds.
const DIFFERENT_TIMES: f64 = 5.0;

/// A score along a run and at its end.
struct Metric {
    label: &'static str,
    decimals: usize,
    along: fn(&CurveLine) -> Option<f64>,
    end: fn(&End) -> Option<f64>,
}

const METRICS: [Metric; 6] = [
    Metric {
        label: "PSNR (dB)",
        decimals: 2,
        along: |line| line.psnr,
        end: |end| end.psnr,
    },
    Metric {
        label: "PSNR, moving pixels (dB)",
        decimals: 2,
        along: |line| line.psnr_dynamic,
        end: |end| end.psnr_dynamic,
    },
    Metric {
        label: "SSIM",
        decimals: 4,
        along: |line| line.ssim,
        end: |end| end.ssim,
    },
    Metric {
        label: "MS-SSIM",
        decimals: 4,
        along: |line| line.ms_ssim,
        end: |end| end.ms_ssim,
    },
    Metric {
        label: "LPIPS, VGG (lower is better)",
        decimals: 4,
        along: |line| line.lpips_vgg,
        end: |end| end.lpips_vgg,
    },
    Metric {
        label: "LPIPS, Alex (lower is better)",
        decimals: 4,
        along: |line| line.lpips_alex,
        end: |end| end.lpips_alex,
    },
];

/// What a run costs at its end.
struct Cost {
    label: &'static str,
    scale: Scale,
    decimals: usize,
    end: fn(&End) -> Option<f64>,
}

const COSTS: [Cost; 4] = [
    Cost {
        label: "Gaussians",
        scale: Scale::Linear,
        decimals: 0,
        end: |end| Some((end.n_static + end.n_dynamic) as f64),
    },
    Cost {
        label: "pictures per second",
        scale: Scale::Linear,
        decimals: 1,
        end: |end| end.render_fps,
    },
    Cost {
        label: "scene on disk (MiB)",
        scale: Scale::Linear,
        decimals: 1,
        end: |end| Some(end.storage_bytes as f64 / MEBIBYTE),
    },
    Cost {
        label: "peak memory (MiB)",
        scale: Scale::Linear,
        decimals: 0,
        end: |end| Some(end.peak_memory_bytes? as f64 / MEBIBYTE),
    },
];

/// Figures and tables of groups of runs, in the groups' order; each group has a colour of its own.
/// `prefix` begins the names of their files.
pub fn training_blocks(groups: &[RunGroup], prefix: &str) -> Vec<Block> {
    let mut blocks = vec![Block::Table(summary(groups))];
    let caption = pinned(groups);
    let missing = missing(groups);
    for (name, title, against) in [
        (
            "quality-seconds",
            "Quality against training time",
            Against::Seconds,
        ),
        ("quality-steps", "Quality against steps", Against::Steps),
    ] {
        let figure = along(groups, against, name, title, &format!("{missing}{caption}"));
        blocks.extend(figure.map(Block::Figure));
    }
    blocks.extend(at_end(groups, &caption).map(Block::Figure));
    blocks.extend(log::figure(groups).map(Block::Figure));
    let rules = rules(groups);
    blocks.push(Block::Table(Table {
        name: "measured".into(),
        title: "How it was measured".into(),
        caption: String::new(),
        columns: vec!["score".into(), "rule".into()],
        rows: rules
            .into_iter()
            .map(|(name, rule)| vec![Cell::Text(name), Cell::Text(rule)])
            .collect(),
        shown: Shown::Folded,
    }));
    blocks.push(Block::Table(ends(groups)));
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

/// The series' look for a group.
pub(super) fn series(groups: &[RunGroup], group: usize) -> Series {
    Series {
        label: with_count(&groups[group]),
        color: group,
        mark: group,
        dashed: group >= N_COLORS,
        ..Series::default()
    }
}

fn with_count(group: &RunGroup) -> String {
    match group.runs.len() {
        1 => group.label.clone(),
        n => format!("{} ({n} runs)", group.label),
    }
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
        for (i, group) in groups.iter().enumerate() {
            let points = median_curve(group, against, metric.along);
            if !points.is_empty() {
                panel.series.push(Series {
                    points,
                    joined: true,
                    named_at_end: groups.len() > 1,
                    ..series(groups, i)
                });
            }
        }
        if !panel.series.is_empty() {
            panels.push(panel);
        }
    }
    (!panels.is_empty()).then(|| Figure {
        name: name.into(),
        title: title.into(),
        caption: format!(
            "Scores of held-out views that choose nothing. Evaluation and file writing are not in the \
             seconds. Before the split into static and dynamic Gaussians, the scene is scored as it would \
             be stored: without coarse motion. Lines are medians over the runs of a group, bands lowest \
             to highest. {pinned}"
        ),
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
    let curves: Vec<&[CurveLine]> = group
        .runs
        .iter()
        .map(|run| run.curve.as_slice())
        .filter(|curve| !curve.is_empty())
        .collect();
    let Some((first, others)) = curves.split_first() else {
        return Vec::new();
    };
    let at = |curve: &'_ [CurveLine], step| curve.iter().find(|l| l.step == step).cloned();
    first
        .iter()
        .filter_map(|line| {
            let mut lines = vec![line.clone()];
            for curve in others {
                lines.push(at(curve, line.step)?);
            }
            let [y, low, high] = spread(lines.iter().filter_map(of))?;
            let x = match against {
                Against::Steps => line.step as f64,
                Against::Seconds => spread(lines.iter().map(|l| l.seconds))?[0],
            };
            Some(Point {
                y_range: (lines.len() > 1).then_some([low, high]),
                ..Point::new(x, y)
            })
        })
        .collect()
}

fn times_differ(groups: &[RunGroup]) -> bool {
    let last = |run: &RunRecord| run.curve.last().map(|line| line.seconds);
    let ends = groups.iter().flat_map(|group| &group.runs).filter_map(last);
    spread(ends).is_some_and(|[_, low, high]| low > 0.0 && high / low > DIFFERENT_TIMES)
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
            "No curve.jsonl: made without --curve, and left out here: {names}. "
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

fn summary(groups: &[RunGroup]) -> Table {
    let mut columns = vec!["runs of".to_string(), "seeds".into(), "steps".into()];
    columns.extend(METRICS.iter().map(|metric| metric.label.to_string()));
    columns.push("seconds trained".into());
    columns.extend(NEAR_BEST_DB.map(|db| format!("seconds to best −{db} dB")));
    columns.extend(COSTS.iter().map(|cost| cost.label.to_string()));
    columns.push("dynamic Gaussians".into());
    let rows = groups.iter().map(|group| {
        let ends: Vec<End> = group.runs.iter().filter_map(RunRecord::end).collect();
        let cell = |values: Vec<Option<f64>>, decimals| {
            cell_of(values.into_iter().flatten().collect(), decimals)
        };
        let mut row = vec![
            Cell::Text(group.label.clone()),
            Cell::Text(list(
                group
                    .runs
                    .iter()
                    .map(|run| run.config.train.seed.to_string()),
            )),
            Cell::Text(list(
                group.runs.iter().map(|run| steps_done(run).to_string()),
            )),
        ];
        for metric in &METRICS {
            row.push(cell(ends.iter().map(metric.end).collect(), metric.decimals));
        }
        row.push(cell(ends.iter().map(|end| end.seconds).collect(), 1));
        for margin in NEAR_BEST_DB {
            let times = group.runs.iter().map(|run| {
                let curve = run.curve.iter().map(|line| (line.seconds, line.psnr));
                seconds_to_best(curve, margin)
            });
            row.push(cell(times.collect(), 1));
        }
        for cost in &COSTS {
            row.push(cell(ends.iter().map(cost.end).collect(), cost.decimals));
        }
        row.push(cell(
            ends.iter().map(|end| Some(end.n_dynamic as f64)).collect(),
            0,
        ));
        row
    });
    Table {
        name: "summary".into(),
        title: "At the end of the runs".into(),
        caption: format!(
            "Medians over the runs of a group, lowest to highest in brackets; - was not measured. Seconds \
             to best: the first measurement within so many dB of that run's own best PSNR along the way, \
             so they are as fine as its measurements are close. {}",
            pinned(groups)
        ),
        columns,
        rows: rows.collect(),
        shown: Shown::Open,
    }
}

fn cell_of(values: Vec<f64>, decimals: usize) -> Cell {
    match (spread(values.iter().copied()), values.len()) {
        (None, _) => Cell::Missing,
        (Some([value, ..]), 1) => Cell::Number(value, decimals),
        (Some(spread), _) => Cell::Spread(spread, decimals),
    }
}

/// Different values once each.
fn list(values: impl Iterator<Item = String>) -> String {
    let mut seen: Vec<String> = Vec::new();
    for value in values {
        if !seen.contains(&value) {
            seen.push(value);
        }
    }
    seen.join(", ")
}

fn steps_done(run: &RunRecord) -> usize {
    let last = run.log.last().map(|line| line.step);
    let measured = run.curve.last().map(|line| line.step);
    let scored = run.results.as_ref().map(|results| results.iterations);
    last.max(measured).max(scored).unwrap_or(0)
}

/// Every run at its end.
fn ends(groups: &[RunGroup]) -> Table {
    let mut columns = vec![
        "runs of".to_string(),
        "run".into(),
        "seed".into(),
        "steps".into(),
    ];
    columns.extend(METRICS.iter().map(|metric| metric.label.to_string()));
    columns.push("seconds trained".into());
    columns.extend(COSTS.iter().map(|cost| cost.label.to_string()));
    columns.push("dynamic Gaussians".into());
    let rows = runs_of(groups).filter_map(|(label, run)| {
        let end = run.end()?;
        let mut row = vec![
            Cell::Text(label.into()),
            Cell::Text(run.name.clone()),
            Cell::Text(run.config.train.seed.to_string()),
            Cell::Text(steps_done(run).to_string()),
        ];
        row.extend(
            METRICS
                .iter()
                .map(|m| Cell::number((m.end)(&end), m.decimals)),
        );
        row.push(Cell::number(end.seconds, 1));
        row.extend(
            COSTS
                .iter()
                .map(|c| Cell::number((c.end)(&end), c.decimals)),
        );
        row.push(Cell::Number(end.n_dynamic as f64, 0));
        Some(row)
    });
    Table {
        name: "runs".into(),
        title: "Every run at its end".into(),
        rows: rows.collect(),
        columns,
        shown: Shown::Folded,
        ..Table::default()
    }
}

/// Every measurement along the runs; `None` when there is none.
fn curves(groups: &[RunGroup]) -> Option<Table> {
    let mut columns: Vec<String> = ["runs of", "run", "seed", "step", "seconds trained"]
        .map(ToString::to_string)
        .into();
    columns.extend(METRICS.iter().map(|metric| metric.label.to_string()));
    columns.extend(
        [
            "static Gaussians",
            "dynamic Gaussians",
            "pictures per second",
            "scene on disk (bytes)",
            "peak memory (bytes)",
        ]
        .map(ToString::to_string),
    );
    let rows: Vec<Vec<Cell>> = runs_of(groups)
        .flat_map(|(label, run)| run.curve.iter().map(move |line| (label, run, line)))
        .map(|(label, run, line)| {
            let mut row = vec![
                Cell::Text(label.into()),
                Cell::Text(run.name.clone()),
                Cell::Text(run.config.train.seed.to_string()),
                Cell::Text(line.step.to_string()),
                Cell::Number(line.seconds, 2),
            ];
            row.extend(
                METRICS
                    .iter()
                    .map(|m| Cell::number((m.along)(line), m.decimals)),
            );
            row.extend([
                Cell::Number(line.n_static as f64, 0),
                Cell::Number(line.n_dynamic as f64, 0),
                Cell::number(line.render_fps, 1),
                Cell::Number(line.storage_bytes as f64, 0),
                Cell::number(line.peak_memory_bytes.map(|bytes| bytes as f64), 0),
            ]);
            row
        })
        .collect();
    (!rows.is_empty()).then(|| Table {
        name: "curves".into(),
        title: "Every measurement along the runs".into(),
        columns,
        rows,
        shown: Shown::Folded,
        ..Table::default()
    })
}

/// Every run with the name of its group.
pub(super) fn runs_of(groups: &[RunGroup]) -> impl Iterator<Item = (&str, &RunRecord)> {
    groups
        .iter()
        .flat_map(|group| group.runs.iter().map(|run| (group.label.as_str(), run)))
}
