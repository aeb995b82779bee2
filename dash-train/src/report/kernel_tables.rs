//! Tables of kernels' errors and times.

use super::table::{Cell, Shown, Table};
use crate::bench::{ErrorStats, KernelBench, Measurement, Pass, StiffnessPoint};

const ERROR_COLUMNS: [&str; 10] = [
    "values",
    "not finite",
    "relative max",
    "relative p99",
    "relative rms",
    "relative bias",
    "absolute max",
    "absolute p99",
    "absolute rms",
    "absolute bias",
];

fn error_cells(error: &ErrorStats) -> Vec<Cell> {
    let mut cells = vec![
        Cell::Number(error.n_values as f64, 0),
        Cell::Number(error.n_not_finite as f64, 0),
    ];
    for norms in [&error.relative, &error.absolute] {
        let values = [norms.max, norms.p99, norms.rms, norms.bias];
        cells.extend(values.map(|value| Cell::number(value, 2)));
    }
    cells
}

fn columns(first: &[&str], last: &[&str]) -> Vec<String> {
    let all = first.iter().chain(&ERROR_COLUMNS).chain(last);
    all.map(ToString::to_string).collect()
}

/// Every measurement.
pub(super) fn measured(bench: &KernelBench, name: &str) -> Table {
    let row = |m: &Measurement| {
        let pass = match m.pass {
            Pass::Forward => "values",
            Pass::Gradient => "gradients",
        };
        let text = [&m.op, pass, &m.backend, &m.variant];
        let mut row: Vec<Cell> = text.map(|t| Cell::Text(t.into())).into();
        row.push(Cell::Number(m.size as f64, 0));
        row.extend(error_cells(&m.error));
        let time = m.time;
        row.push(Cell::number(time.map(|t| t.median_ms), 3));
        row.push(Cell::number(time.map(|t| t.first_quartile_ms), 3));
        row.push(Cell::number(time.map(|t| t.third_quartile_ms), 3));
        row.push(Cell::number(time.map(|t| t.n_runs as f64), 0));
        row
    };
    Table {
        name: name.into(),
        title: "Every kernel that was measured".into(),
        caption: format!("Errors: {}. Times: {}.", bench.error_rule, bench.time_rule),
        columns: columns(
            &["operation", "of", "backend", "variant", "size"],
            &[
                "median (ms)",
                "first quartile (ms)",
                "third quartile (ms)",
                "runs",
            ],
        ),
        rows: bench.measurements.iter().map(row).collect(),
        shown: Shown::Folded,
        turned: false,
    }
}

/// Every point of the series of harder inputs.
pub(super) fn stiff(bench: &KernelBench, name: &str) -> Table {
    let row = |p: &StiffnessPoint| {
        let mut row = vec![Cell::Text(p.sweep.clone()), Cell::Number(p.value, 0)];
        row.extend([&p.op, &p.backend, &p.variant].map(|t| Cell::Text(t.clone())));
        row.extend(error_cells(&p.error));
        row
    };
    Table {
        name: name.into(),
        title: "Every harder input".into(),
        caption: format!("Errors: {}.", bench.error_rule),
        columns: columns(&["series", "at", "operation", "backend", "variant"], &[]),
        rows: bench.stiffness.iter().map(row).collect(),
        shown: Shown::Folded,
        turned: false,
    }
}
