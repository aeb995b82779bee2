//! Tables of training runs.

use super::groups::{RunGroup, runs_of};
use super::quantities::{COSTS, METRICS};
use super::runs::{End, RunRecord};
use super::settings::pinned;
use super::statistics::seconds_to_best;
use super::table::{Cell, Shown, Table};
use crate::numbers::median_and_range;

/// How far from the best PSNR the times in the table are taken, dB.
const NEAR_BEST_DB: [f64; 2] = [0.5, 0.1];

/// Every group at the end of its runs.
pub(super) fn summary(groups: &[RunGroup]) -> Table {
    let mut columns = vec!["group".to_string(), "seeds".into(), "steps".into()];
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
        turned: true,
    }
}

fn cell_of(values: Vec<f64>, decimals: usize) -> Cell {
    match (median_and_range(values.iter().copied()), values.len()) {
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

/// Every run at its end; `None` when none was scored.
pub(super) fn ends(groups: &[RunGroup]) -> Option<Table> {
    let mut columns = vec![
        "group".to_string(),
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
    let rows: Vec<Vec<Cell>> = rows.collect();
    (!rows.is_empty()).then(|| Table {
        name: "runs".into(),
        title: "Every run at its end".into(),
        rows,
        columns,
        shown: Shown::Folded,
        ..Table::default()
    })
}

/// Every measurement along the runs; `None` when there is none.
pub(super) fn curves(groups: &[RunGroup]) -> Option<Table> {
    let mut columns: Vec<String> = ["group", "run", "seed", "step", "seconds trained"]
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
