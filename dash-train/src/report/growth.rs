//! The figure of ever larger scenes' times.

use super::plot::{Axis, Figure, LegendEntry, N_COLORS, Panel, Point, Series};
use super::statistics::names;
use crate::bench::{KernelBench, Op, Pass};

/// What is timed.
const TIMED: [&str; 2] = ["a picture", "a training step"];

/// What a picture and a training step of ever larger scenes take.
pub(super) fn figure(bench: &KernelBench, name: &str) -> Option<Figure> {
    let own = || {
        let all = bench.measurements.iter();
        all.filter(|m| m.op == Op::Growth.name())
    };
    let backends = names(own().map(|m| m.backend.as_str()));
    let panel = |what: &str| {
        // A share may be 0.
        let x = match own().any(|m| m.variant == what && m.size == 0) {
            true => Axis::linear(what),
            false => Axis::log(what),
        };
        let mut panel = Panel::new(what, x, Axis::log("median time (ms)"));
        for (color, &backend) in backends.iter().enumerate() {
            for (mark, pass) in [Pass::Forward, Pass::Gradient].into_iter().enumerate() {
                let of_line =
                    own().filter(|m| m.variant == what && m.backend == backend && m.pass == pass);
                let points = of_line.filter_map(|m| {
                    let median = m.time?.median_ms;
                    Some(Point::new(m.size as f64, median))
                });
                panel.series.push(Series {
                    label: format!("{backend}, {}", TIMED[mark]),
                    color: color % N_COLORS,
                    mark,
                    points: points.collect(),
                    joined: true,
                    ..Series::default()
                });
            }
        }
        panel
    };
    let panels: Vec<Panel> = names(own().map(|m| m.variant.as_str()))
        .into_iter()
        .map(panel)
        .collect();
    let notes = names(own().filter_map(|m| m.note.as_deref()));
    (!panels.is_empty()).then(|| Figure {
        name: name.into(),
        title: "Time against what grows".into(),
        caption: format!(
            "One number of a scene grows from left to right. Colours are backends; forms are a picture and a training step. {}. \
             Times: {}. {} CPU threads.",
            notes.join(". "),
            bench.time_rule,
            bench.threads
        ),
        legend: legend(&backends),
        panels,
        columns: 2,
    })
}

/// Colours of backends, and forms of what is timed.
fn legend(backends: &[&str]) -> Vec<LegendEntry> {
    let entry = |label: &str, color, mark| LegendEntry {
        label: label.into(),
        color,
        mark,
        joined: false,
        dashed: false,
    };
    let colors = backends.iter().enumerate();
    let colors = colors.map(|(color, name)| entry(name, Some(color % N_COLORS), 0));
    let forms = TIMED.iter().enumerate();
    colors
        .chain(forms.map(|(mark, name)| entry(name, None, mark)))
        .collect()
}
