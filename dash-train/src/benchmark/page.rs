//! A benchmark's page: our rows beside the published ones.

use super::{Benchmark, BenchmarkRows, SceneRuns, pinned};
use crate::report::{
    Beside, Block, Cell, Report, RunGroup, Shown, Table, beside, published_figures, training_blocks,
};

/// The name of our rows.
const OURS: &str = "dash (this benchmark)";

/// The page of a benchmark: `OUT/report.html` and its files.
pub fn page(benchmark: &Benchmark, rows: &BenchmarkRows, runs: &[SceneRuns]) -> Report {
    let protocol = benchmark.protocol.protocol();
    let mut blocks = vec![Block::Text(scope(benchmark, rows))];
    let table = mean_table(benchmark, rows);
    blocks.extend([
        Block::Heading("Mean over scenes".into()),
        Block::Table(table),
    ]);
    blocks.push(Block::Heading("Each scene".into()));
    for (row, own) in rows.scenes.iter().zip(runs) {
        let ours = Beside::ours(OURS.into(), &own.runs, row.differs.join("; "));
        let others = published_figures(protocol, &row.scene);
        let name = format!("scene-{}", row.scene);
        blocks.push(Block::Table(beside(
            &name,
            row.scene.clone(),
            &[ours],
            &others,
        )));
    }
    blocks.push(Block::Heading("Protocol".into()));
    blocks.push(Block::Table(Table {
        name: "protocol".into(),
        title: "What is pinned".into(),
        columns: vec!["what".into(), "value".into()],
        rows: pinned(benchmark)
            .into_iter()
            .map(|(name, value)| vec![Cell::Text(name.into()), Cell::Text(value)])
            .collect(),
        shown: Shown::Open,
        ..Table::default()
    }));
    blocks.push(Block::Heading("Runs".into()));
    let groups: Vec<RunGroup> = runs
        .iter()
        .map(|own| RunGroup {
            label: own.scene.name.into(),
            runs: own.runs.clone(),
        })
        .collect();
    blocks.extend(training_blocks(&groups, ""));
    Report {
        title: format!("{}: dash beside what is published", protocol.title),
        blocks,
    }
}

/// Which scenes the page is about, and in what they differ from the protocol.
fn scope(benchmark: &Benchmark, rows: &BenchmarkRows) -> String {
    let protocol = benchmark.protocol.protocol();
    let mut text = format!("Scored: {}.", rows.scene_names().join(", "));
    if !rows.missing.is_empty() {
        text += &format!(" Not there: {}.", rows.missing.join(", "));
    }
    if !rows.is_whole {
        text += &format!(
            " Published means are over all {} scenes and do not compare with a mean over {}; the table of means has, \
             instead, the means of published figures over the same scenes.",
            protocol.scenes.len(),
            rows.scenes.len()
        );
    }
    let differing = rows.scenes.iter().filter(|row| !row.differs.is_empty());
    let differing: Vec<String> = differing
        .map(|row| format!("{}: {}", row.scene, row.differs.join("; ")))
        .collect();
    if !differing.is_empty() {
        text += &format!(" Differs from the protocol: {}.", differing.join(" | "));
    }
    text
}

/// Our mean beside those that are over the same scenes.
fn mean_table(benchmark: &Benchmark, rows: &BenchmarkRows) -> Table {
    let differs = rows.scenes.iter().any(|row| !row.differs.is_empty());
    let note = if differs {
        "scenes differ from the protocol"
    } else {
        ""
    };
    let ours = Beside {
        system: OURS.into(),
        figures: rows.mean,
        hardware: benchmark.device.clone(),
        note: note.into(),
        source: "mean of the scenes' rows".into(),
    };
    let title = match rows.is_whole {
        true => "All scenes".into(),
        false => format!("Over {} alone", rows.scene_names().join(", ")),
    };
    beside("mean", title, &[ours], &rows.published_means())
}
