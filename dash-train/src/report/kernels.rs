//! Figures of kernels' errors and times.

use super::plot::{Axis, Figure, LegendEntry, N_COLORS, Panel, Point, Series, with_separators};
use super::statistics::names;
use super::{Block, growth, kernel_tables};
use crate::bench::{ErrorStats, KernelBench, Measurement, Norms, Pass, StiffnessPoint, Timing};

/// Errors that differ by less, relatively, are alike.
const ALIKE: f64 = 0.05;

/// Figures and tables of what `dash bench` measured; `prefix` begins the names of their files.
pub fn kernel_blocks(bench: &KernelBench, prefix: &str) -> Vec<Block> {
    let mut blocks = Vec::new();
    for (pass, name, title) in [
        (Pass::Forward, "forward", "Values: error against run time"),
        (
            Pass::Gradient,
            "gradient",
            "Gradients: error against run time",
        ),
    ] {
        let figure = error_against_time(bench, pass, &format!("{prefix}{name}"), title);
        blocks.extend(figure.map(Block::Figure));
    }
    let figure = error_against_stiffness(bench, &format!("{prefix}stiffness"));
    blocks.extend(figure.map(Block::Figure));
    let figure = growth::figure(bench, &format!("{prefix}growth"));
    blocks.extend(figure.map(Block::Figure));
    if !bench.left_out.is_empty() {
        blocks.push(Block::Text(format!(
            "Left out: {}.",
            bench.left_out.join("; ")
        )));
    }
    blocks.push(Block::Table(kernel_tables::measured(
        bench,
        &format!("{prefix}measurements"),
    )));
    blocks.push(Block::Table(kernel_tables::stiff(
        bench,
        &format!("{prefix}stiffness"),
    )));
    blocks
}

/// The look of each variant in a figure: a colour for its backend, the same in every figure, and a mark for its
/// variant.
struct Looks {
    backends: Vec<String>,
    variants: Vec<String>,
}

impl Looks {
    fn new<'a>(bench: &KernelBench, variants: impl Iterator<Item = &'a str>) -> Self {
        let measured = bench.measurements.iter().map(|m| m.backend.as_str());
        let stiff = bench.stiffness.iter().map(|p| p.backend.as_str());
        let owned = |names: Vec<&str>| names.into_iter().map(Into::into).collect();
        Self {
            backends: owned(names(measured.chain(stiff))),
            variants: owned(names(variants)),
        }
    }

    fn series(&self, backend: &str, variant: &str) -> Series {
        let place = |names: &[String], name: &str| names.iter().position(|n| n == name);
        let color = place(&self.backends, backend).unwrap_or(0);
        Series {
            label: format!("{backend}, {variant}"),
            color: color % N_COLORS,
            mark: place(&self.variants, variant).unwrap_or(0),
            ..Series::default()
        }
    }

    /// The colours of the backends and the forms of the variants that these panels have.
    fn legend(&self, panels: &[Panel]) -> Vec<LegendEntry> {
        let series = || panels.iter().flat_map(|panel| &panel.series);
        let entry = |label: &String, color, mark| LegendEntry {
            label: label.clone(),
            color,
            mark,
            joined: false,
            dashed: false,
        };
        // Backends that share every line share an entry: the shortest name is what all lines have.
        let shared = |color: usize| {
            let own = series().filter(move |s| s.color == color % N_COLORS);
            let backends = own.filter_map(|s| s.label.split(", ").next());
            backends.min_by_key(|name| name.len()).map(String::from)
        };
        let colors = (0..self.backends.len()).filter_map(|i| Some((i, shared(i)?)));
        let forms = self.variants.iter().enumerate();
        let forms = forms.filter(|(i, _)| series().any(|s| s.mark == *i));
        colors
            .map(|(i, name)| entry(&name, Some(i), 0))
            .chain(forms.map(|(i, name)| entry(name, None, i)))
            .collect()
    }
}

/// The error that figures show, and the range up to the largest.
fn shown(norms: &Norms) -> Option<(f64, Option<[f64; 2]>)> {
    let p99 = norms.p99?;
    Some((p99, norms.max.map(|max| [p99, max])))
}

/// A measurement with its time, its error and the range of the error.
type Timed<'a> = (&'a Measurement, Timing, (f64, Option<[f64; 2]>));

fn error_against_time(bench: &KernelBench, pass: Pass, name: &str, title: &str) -> Option<Figure> {
    let all = bench.measurements.iter().filter(|m| m.pass == pass);
    let timed: Vec<Timed<'_>> = all
        .filter_map(|m| Some((m, m.time?, shown(&m.error.relative)?)))
        .collect();
    let looks = Looks::new(bench, timed.iter().map(|(m, ..)| m.variant.as_str()));
    let panels: Vec<Panel> = names(timed.iter().map(|(m, ..)| m.op.as_str()))
        .into_iter()
        .map(|op| time_panel(op, &timed, &looks))
        .collect();
    let what = match pass {
        Pass::Forward => "",
        Pass::Gradient => " The time is that of values and gradients together.",
    };
    let notes = names(timed.iter().filter_map(|(m, ..)| m.note.as_deref()));
    let notes: String = notes.iter().map(|note| format!(" Note: {note}.")).collect();
    (!panels.is_empty()).then(|| Figure {
        name: name.into(),
        title: title.into(),
        caption: format!(
            "Left and low is better. Colours are backends, forms are variants. Numbers at points are sizes: \
             points, Gaussians, pixels or values. Rings: whatever of the same size is faster is less accurate \
             by more than {:.0} %; dashed lines join them. Horizontal lines: quartiles of the time.{what} Errors: {}. Times: \
             {}. {} CPU threads.{notes}{}",
            100.0 * ALIKE,
            bench.error_rule,
            bench.time_rule,
            bench.threads,
            without_place(&panels)
        ),
        legend: looks.legend(&panels),
        panels,
        columns: 2,
    })
}

/// The errors of an operation against its times, with a Pareto front for each size.
fn time_panel(op: &str, timed: &[Timed<'_>], looks: &Looks) -> Panel {
    let mut panel = Panel::new(
        op,
        Axis::log("median time (ms)"),
        Axis::log("relative error against f64: 99th percentile, line up to the largest"),
    );
    let of_op = || timed.iter().filter(|(m, ..)| m.op == op);
    let mut sizes: Vec<usize> = of_op().map(|(m, ..)| m.size).collect();
    sizes.sort_unstable();
    sizes.dedup();
    let mut on_front: Vec<(usize, [f64; 2])> = Vec::new();
    for &size in &sizes {
        let candidates = of_op().filter(|(m, ..)| m.size == size);
        let front = pareto(candidates.map(|(_, time, error)| [time.median_ms, error.0]));
        on_front.extend(front.iter().map(|&place| (size, place)));
        if front.len() > 1 {
            panel.fronts.push(front);
        }
    }
    for &(m, time, (error, range)) in of_op() {
        let series = looks.series(&m.backend, &m.variant);
        let place = [time.median_ms, error];
        let point = Point {
            x_range: Some([time.first_quartile_ms, time.third_quartile_ms]),
            y_range: range,
            name: Some(short(m.size)),
            ringed: on_front.contains(&(m.size, place)),
            ..Point::new(time.median_ms, error)
        };
        match panel.series.iter_mut().find(|s| s.label == series.label) {
            Some(known) => known.points.push(point),
            None => panel.series.push(Series {
                points: vec![point],
                ..series
            }),
        }
    }
    panel
}

fn without_place(panels: &[Panel]) -> String {
    match panels.iter().map(Panel::n_without_place).sum::<usize>() {
        0 => String::new(),
        n => format!(
            " {n} errors of exactly 0 have no place on these axes and are in the table only."
        ),
    }
}

/// The Pareto front, by rising x: each place is lower than all to its left.
fn pareto(places: impl Iterator<Item = [f64; 2]>) -> Vec<[f64; 2]> {
    let mut places: Vec<[f64; 2]> = places.filter(|p| p.iter().all(|v| v.is_finite())).collect();
    places.sort_by(|a, b| a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1])));
    let mut front: Vec<[f64; 2]> = Vec::new();
    for place in places {
        if front
            .last()
            .is_none_or(|last| place[1] * (1.0 + ALIKE) < last[1])
        {
            front.push(place);
        }
    }
    front
}

fn short(size: usize) -> String {
    match size {
        0..1_000 => size.to_string(),
        1_000..1_000_000 => format!("{}k", with_separators(size as f64 / 1e3, 0)),
        _ => format!("{}M", with_separators(size as f64 / 1e6, 0)),
    }
}

fn error_against_stiffness(bench: &KernelBench, name: &str) -> Option<Figure> {
    let looks = Looks::new(bench, bench.stiffness.iter().map(|p| p.variant.as_str()));
    let mut panels = Vec::new();
    for sweep in names(bench.stiffness.iter().map(|point| point.sweep.as_str())) {
        let points = || bench.stiffness.iter().filter(|point| point.sweep == sweep);
        for op in names(points().map(|point| point.op.as_str())) {
            let of_op = || points().filter(|point| point.op == op);
            let x = if of_op().any(|point| point.logarithmic) {
                Axis::log(sweep)
            } else {
                Axis::linear(sweep)
            };
            let y =
                Axis::log("relative error against f64: 99th percentile, band up to the largest");
            let mut panel = Panel::new(op, x, y);
            let variants = names(of_op().map(|point| point.variant.as_str()));
            for variant in variants {
                let of_variant = || of_op().filter(|point| point.variant == variant);
                for backends in alike(of_variant().collect()) {
                    let first = backends[0];
                    let points = of_variant().filter(|point| point.backend == first);
                    panel.series.push(Series {
                        label: format!("{}, {variant}", backends.join(" and ")),
                        points: points.filter_map(place).collect(),
                        joined: true,
                        ..looks.series(first, variant)
                    });
                }
            }
            panels.push(panel);
        }
    }
    (!panels.is_empty()).then(|| Figure {
        name: name.into(),
        title: "Error against stiffness".into(),
        caption: format!(
            "Inputs that are made harder from left to right. Colours are backends, forms are variants; backends \
             whose errors are the same are one line in the colour of the first. An error of 1 is a value \
             that only the reference has, such as a Gaussian that f32 cannot hold and that is not drawn. \
             Needles have an axis ratio of 1e8; at 65,000 px \
             the f64 reference of the projection is itself good to about 1e-6. Errors: {}.{}",
            bench.error_rule,
            without_place(&panels)
        ),
        legend: looks.legend(&panels),
        panels,
        columns: 2,
    })
}

/// The point's place on its panel.
fn place(point: &StiffnessPoint) -> Option<Point> {
    let (error, range) = shown(&point.error.relative)?;
    Some(Point {
        y_range: range,
        ..Point::new(point.value, error)
    })
}

/// Backends by their errors: those that run the same code are one line.
fn alike(points: Vec<&StiffnessPoint>) -> Vec<Vec<&str>> {
    let of = |backend: &str| -> Vec<(f64, ErrorStats)> {
        let own = points.iter().filter(|point| point.backend == backend);
        own.map(|point| (point.value, point.error)).collect()
    };
    let mut groups: Vec<Vec<&str>> = Vec::new();
    for backend in names(points.iter().map(|point| point.backend.as_str())) {
        match groups.iter_mut().find(|group| of(group[0]) == of(backend)) {
            Some(group) => group.push(backend),
            None => groups.push(vec![backend]),
        }
    }
    groups
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_front_is_what_nothing_beats() {
        let places = [
            [5.0, 0.99],
            [1.0, 5.0],
            [2.0, 3.0],
            [2.0, 4.0],
            [3.0, 3.0],
            [4.0, 1.0],
            [f64::NAN, 0.0],
        ];
        let front = pareto(places.into_iter());
        assert_eq!(front, [[1.0, 5.0], [2.0, 3.0], [4.0, 1.0]]);
        assert!(pareto([].into_iter()).is_empty());
    }

    #[test]
    fn backends_with_the_same_errors_are_one_line() {
        let point = |backend: &str, max: f64| StiffnessPoint {
            sweep: "length".into(),
            value: 1.0,
            logarithmic: true,
            op: "project".into(),
            backend: backend.into(),
            variant: "f32".into(),
            error: ErrorStats {
                relative: Norms {
                    max: Some(max),
                    ..Norms::default()
                },
                ..ErrorStats::default()
            },
        };
        let points = [
            point("ndarray", 1e-6),
            point("flex", 1e-6),
            point("wgpu", 2e-6),
        ];
        let groups = alike(points.iter().collect());
        assert_eq!(groups, [vec!["ndarray", "flex"], vec!["wgpu"]]);
    }

    #[test]
    fn sizes_are_short() {
        let got = [7, 999, 10_000, 2_000_000].map(short);
        assert_eq!(got, ["7", "999", "10k", "2M"]);
    }
}
