//! What a comparison says: where `dash` stands, and what representation and decomposition bring.

use super::{ComparedRun, Lead, Method};
use crate::report::{Cell, Table};

/// Digits of decibels.
const DIGITS: usize = 2;

/// Representations by name, each with and without following and decomposition.
const PAIRS: [(&str, [Method; 2]); 3] = [
    ("4D hash", [Method::Dash, Method::Hash]),
    ("Grid4D", [Method::Grid4dDecomposed, Method::Grid4d]),
    ("planes", [Method::HexPlaneDecomposed, Method::HexPlane]),
];

/// Over which pixels PSNR is taken.
const PIXELS: [&str; 2] = ["moving", "all"];

/// A run's PSNR over [`PIXELS`], dB.
struct Scored {
    method: Method,
    psnr: [Option<f64>; 2],
}

/// The tables that there are enough methods for.
pub fn tables(runs: &[ComparedRun]) -> Vec<Table> {
    let scored: Vec<Scored> = runs
        .iter()
        .map(|run| {
            let scores = &run.results.evaluation;
            Scored {
                method: run.method,
                psnr: [scores.psnr_dynamic, scores.psnr],
            }
        })
        .collect();
    let factorials = (0..PIXELS.len()).filter_map(|pixels| factorial(&scored, pixels));
    standings(&scored).into_iter().chain(factorials).collect()
}

/// Where `dash` stands against every other method; `None` without it or without others.
fn standings(runs: &[Scored]) -> Option<Table> {
    let mut columns = vec!["dash against".to_string()];
    for pixels in PIXELS {
        columns.extend([format!("{pixels} (dB)"), "is".into()]);
    }
    let others = Method::ALL
        .into_iter()
        .filter(|&method| method != Method::Dash);
    let rows = others.filter_map(|method| {
        let leads = [0, 1].map(|pixels| lead(runs, pixels, [Method::Dash, method]));
        if leads == [None; 2] {
            return None;
        }
        let mut row = vec![Cell::Text(method.name().into())];
        for lead in leads {
            let word = lead.map_or("", |lead| lead.standing().word());
            row.extend([lead.map_or(Cell::Missing, cell), Cell::Text(word.into())]);
        }
        Some(row)
    });
    let rows: Vec<Vec<Cell>> = rows.collect();
    (!rows.is_empty()).then(|| Table {
        name: "standing".into(),
        title: "Where dash stands".into(),
        caption: "Mean PSNR of dash less the other method's, over their seeds; in brackets the 95 % confidence interval \
                  (Welch's t). Level: the interval holds 0."
            .into(),
        columns,
        rows,
        ..Table::default()
    })
}

/// Representation x (following and decomposition, or neither); `None` unless two representations have both.
fn factorial(runs: &[Scored], pixels: usize) -> Option<Table> {
    let mean = |method: Method| {
        let scores = by_seed(runs, pixels, method);
        let mean = scores.iter().sum::<f64>() / scores.len() as f64;
        Cell::number(Some(mean), DIGITS)
    };
    let measured: Vec<_> = PAIRS
        .into_iter()
        .filter_map(|(name, pair)| Some((name, pair, lead(runs, pixels, pair)?)))
        .collect();
    let [(first, of_first, _), others @ ..] = measured.as_slice() else {
        return None;
    };
    if others.is_empty() {
        return None;
    }
    let mut rows: Vec<Vec<Cell>> = measured
        .iter()
        .map(|&(name, [with, without], lead)| {
            vec![
                Cell::Text(name.into()),
                mean(with),
                mean(without),
                cell(lead),
            ]
        })
        .collect();
    for (name, pair, _) in others {
        let column = |k: usize| {
            let lead = lead(runs, pixels, [of_first[k], pair[k]]);
            lead.map_or(Cell::Missing, cell)
        };
        let name = Cell::Text(format!("{first} less {name}"));
        rows.push(vec![name, column(0), column(1), Cell::Missing]);
    }
    let pixels = PIXELS[pixels];
    let columns = ["representation", "with", "without", "difference"];
    Some(Table {
        name: format!("representation-and-decomposition-{pixels}"),
        title: format!("With and without following and decomposition: PSNR, {pixels} pixels (dB)"),
        caption: "Means over seeds. Differences have their 95 % confidence intervals (Welch's t) in brackets.".into(),
        columns: columns.map(Into::into).into(),
        rows,
        ..Table::default()
    })
}

/// A method's scores by seed.
fn by_seed(runs: &[Scored], pixels: usize, method: Method) -> Vec<f64> {
    let of_method = runs.iter().filter(|run| run.method == method);
    let scores = of_method.filter_map(|run| run.psnr[pixels]);
    scores.filter(|score| score.is_finite()).collect()
}

/// How far a method is ahead of another.
fn lead(runs: &[Scored], pixels: usize, [first, second]: [Method; 2]) -> Option<Lead> {
    let [first, second] = [first, second].map(|method| by_seed(runs, pixels, method));
    Lead::of(&first, &second)
}

/// A lead with its interval, to hundredths of a decibel.
fn cell(lead: Lead) -> Cell {
    let rounded = |value: f64| (value * 100.0).round() / 100.0;
    match lead.margin {
        Some(margin) => {
            let ends = [lead.mean, lead.mean - margin, lead.mean + margin];
            Cell::Spread(ends.map(rounded), DIGITS)
        }
        None => Cell::Number(rounded(lead.mean), DIGITS),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Three seeds around a PSNR on moving pixels; nothing over all pixels.
    fn seeds(method: Method, psnr: f64) -> impl Iterator<Item = Scored> {
        [-0.1, 0.0, 0.1].into_iter().map(move |off| Scored {
            method,
            psnr: [Some(psnr + off), None],
        })
    }

    fn runs(methods: &[(Method, f64)]) -> Vec<Scored> {
        let methods = methods.iter();
        methods
            .flat_map(|&(method, psnr)| seeds(method, psnr))
            .collect()
    }

    #[test]
    fn the_table_says_where_dash_is_not_ahead() {
        let table = standings(&runs(&[
            (Method::Grid4d, 31.0),
            (Method::Dash, 30.0),
            (Method::Static, 20.0),
            (Method::Hash, 30.05),
        ]));
        let text = table.expect("dash and others").text();
        let line = |method: &str| {
            let line = text.lines().find(|line| line.starts_with(method));
            line.unwrap_or_else(|| panic!("no {method}:\n{text}"))
        };
        assert!(line("static").contains("10.00 (9.77–10.23)"), "{text}");
        for (method, word) in [("static", "ahead"), ("hash", "level"), ("grid4d", "behind")] {
            assert!(line(method).contains(word), "{text}");
        }
        assert!(standings(&runs(&[(Method::Dash, 30.0)])).is_none());
        assert!(standings(&runs(&[(Method::Static, 30.0)])).is_none());
    }

    #[test]
    fn the_2_x_2_says_what_each_brings() {
        let mut all = vec![
            (Method::Dash, 36.0),
            (Method::Hash, 26.0),
            (Method::Grid4dDecomposed, 35.0),
        ];
        assert!(factorial(&runs(&all), 0).is_none(), "three of four");
        all.push((Method::Grid4d, 29.0));
        let runs = runs(&all);
        let table = factorial(&runs, 0).expect("all four");
        let mean_of = |cell: &Cell| match cell {
            Cell::Spread([mean, ..], _) | Cell::Number(mean, _) => *mean,
            other => panic!("{other:?}"),
        };
        let means = |row: usize| {
            table.rows[row][1..3]
                .iter()
                .map(mean_of)
                .collect::<Vec<_>>()
        };
        assert_eq!(
            mean_of(&table.rows[0][3]),
            10.0,
            "what decomposition brings"
        );
        assert_eq!(mean_of(&table.rows[1][3]), 6.0);
        assert_eq!(means(2), [1.0, -3.0], "what the representation brings");
        assert!(factorial(&runs, 1).is_none(), "not measured");
    }
}
