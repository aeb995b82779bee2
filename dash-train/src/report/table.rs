//! Tables: on the page for people, as CSV for programs.

use crate::draw::escaped;

/// Rows of text under named columns.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Table {
    /// Name of its CSV, without extension.
    pub name: String,
    /// Its heading.
    pub title: String,
    /// What a reader must know to read it; empty for nothing.
    pub caption: String,
    /// Names of the columns, with units.
    pub columns: Vec<String>,
    /// The cells.
    pub rows: Vec<Vec<Cell>>,
    /// Where it stands.
    pub shown: Shown,
    /// Whether the page shows its columns as rows, as suits a few rows of many columns.
    pub turned: bool,
}

/// Where a table stands beside its CSV.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Shown {
    /// On the page.
    #[default]
    Open,
    /// On the page, when the reader asks for it.
    Folded,
    /// In its file alone.
    File,
}

/// What stands in a table.
#[derive(Debug, Clone, PartialEq)]
pub enum Cell {
    /// A name.
    Text(String),
    /// A measured value, and the digits after the point that the page shows.
    Number(f64, usize),
    /// The value and its lowest and highest.
    Spread([f64; 3], usize),
    /// Not measured.
    Missing,
}

impl Cell {
    /// A number, where it was measured and is one.
    pub fn number(value: Option<f64>, decimals: usize) -> Self {
        match value {
            Some(value) if value.is_finite() => Self::Number(value, decimals),
            _ => Self::Missing,
        }
    }

    /// As the page shows it.
    pub(super) fn shown(&self) -> String {
        match self {
            Self::Text(text) => text.clone(),
            Self::Number(value, decimals) => rounded(*value, *decimals),
            Self::Spread([value, low, high], decimals) => {
                // Beside a minus a dash is hard to read.
                let to = if *low < 0.0 { " to " } else { "–" };
                let [value, low, high] = [value, low, high].map(|v| rounded(*v, *decimals));
                format!("{value} ({low}{to}{high})")
            }
            Self::Missing => "-".into(),
        }
    }

    fn class(&self) -> &'static str {
        match self {
            Self::Text(_) => "",
            _ => " class=\"number\"",
        }
    }

    /// The CSV fields: every digit of a value; its lowest and highest in fields of their own.
    fn fields(&self, spread: bool) -> Vec<String> {
        let mut fields = match self {
            Self::Text(text) => vec![quoted(text)],
            Self::Number(value, _) => vec![value.to_string()],
            Self::Spread(values, _) => values.iter().map(ToString::to_string).collect(),
            Self::Missing => vec![String::new()],
        };
        if spread {
            fields.resize(3, String::new());
        }
        fields
    }
}

fn rounded(value: f64, decimals: usize) -> String {
    if value != 0.0 && value.abs() < 0.5 * 10f64.powi(-(decimals as i32)) {
        return format!("{value:.2e}");
    }
    super::plot::with_separators(value, decimals)
}

impl Table {
    /// The table with RFC 4180's quoting; a column with spreads becomes three.
    pub fn csv(&self) -> String {
        let has_spread = |column: usize| {
            let cells = self.rows.iter().filter_map(|row| row.get(column));
            cells
                .into_iter()
                .any(|cell| matches!(cell, Cell::Spread(..)))
        };
        let spreads: Vec<bool> = (0..self.columns.len()).map(has_spread).collect();
        let mut header = Vec::new();
        for (name, &spread) in self.columns.iter().zip(&spreads) {
            header.push(quoted(name));
            if spread {
                header.extend(["lowest", "highest"].map(|end| quoted(&format!("{name} {end}"))));
            }
        }
        let mut lines = vec![header.join(",")];
        for row in &self.rows {
            let cells = row.iter().zip(&spreads);
            let fields: Vec<String> = cells
                .flat_map(|(cell, &spread)| cell.fields(spread))
                .collect();
            lines.push(fields.join(","));
        }
        lines.join("\r\n") + "\r\n"
    }

    /// The title and the rows for a terminal: columns aligned, numbers at their right, then the caption.
    pub fn text(&self) -> String {
        let header = self.columns.iter().map(|name| (name.clone(), false));
        let mut rows: Vec<Vec<(String, bool)>> = vec![header.collect()];
        for row in &self.rows {
            let cells = row
                .iter()
                .map(|cell| (cell.shown(), !matches!(cell, Cell::Text(_))));
            rows.push(cells.collect());
        }
        let width = |column: usize| {
            let cells = rows.iter().filter_map(|row| row.get(column));
            cells
                .map(|(text, _)| text.chars().count())
                .max()
                .unwrap_or(0)
        };
        let widths: Vec<usize> = (0..self.columns.len()).map(width).collect();
        let lines = rows.iter().map(|row| {
            let cells = row.iter().zip(&widths);
            let cells: Vec<String> = cells
                .map(|((text, is_number), &width)| match is_number {
                    true => format!("{text:>width$}"),
                    false => format!("{text:width$}"),
                })
                .collect();
            cells.join("  ").trim_end().to_string()
        });
        let mut lines: Vec<String> = std::iter::once(self.title.clone()).chain(lines).collect();
        if !self.caption.is_empty() {
            lines.push(self.caption.clone());
        }
        lines.join("\n")
    }

    /// The table for a page.
    pub(super) fn html(&self) -> String {
        let row = |cells: &mut dyn Iterator<Item = (String, &'static str)>| {
            let cells: String = cells
                .map(|(text, class)| format!("<td{class}>{}</td>", escaped(&text)))
                .collect();
            format!("<tr>{cells}</tr>\n")
        };
        let shown = |cell: &Cell| (cell.shown(), cell.class());
        let (header, rows): (Vec<String>, String) = if self.turned {
            let first = self.columns.iter().take(1).cloned();
            let others = self
                .rows
                .iter()
                .filter_map(|cells| Some(cells.first()?.shown()));
            let rows = self.columns.iter().enumerate().skip(1).map(|(i, name)| {
                let cells = self.rows.iter().filter_map(|cells| cells.get(i));
                row(&mut std::iter::once((name.clone(), "")).chain(cells.map(shown)))
            });
            (first.chain(others).collect(), rows.collect())
        } else {
            let rows = self
                .rows
                .iter()
                .map(|cells| row(&mut cells.iter().map(shown)));
            (self.columns.clone(), rows.collect())
        };
        let header: String = header
            .iter()
            .map(|name| format!("<th>{}</th>", escaped(name)))
            .collect();
        format!(
            "<div class=\"wide\"><table><thead><tr>{header}</tr></thead>\n<tbody>\n{rows}</tbody></table></div>"
        )
    }
}

fn quoted(text: &str) -> String {
    if text.contains([',', '"', '\n', '\r']) {
        format!("\"{}\"", text.replace('"', "\"\""))
    } else {
        text.into()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn csv_keeps_every_digit_and_quotes_what_needs_it() {
        let table = Table {
            columns: vec!["run, name".into(), "PSNR (dB)".into()],
            rows: vec![
                vec![
                    Cell::Text("a \"b\"".into()),
                    Cell::Spread([31.25, 30.123456789, 32.0], 2),
                ],
                vec![Cell::Text("c".into()), Cell::Number(0.1, 2)],
                vec![Cell::Text("d".into()), Cell::number(Some(f64::NAN), 2)],
            ],
            ..Table::default()
        };
        assert_eq!(
            table.csv(),
            "\"run, name\",PSNR (dB),PSNR (dB) lowest,PSNR (dB) highest\r\n\
             \"a \"\"b\"\"\",31.25,30.123456789,32\r\nc,0.1,,\r\nd,,,\r\n"
        );
        let page = table.html();
        assert!(
            page.contains("31.25 (30.12–32.00)") && page.contains("<td class=\"number\">-</td>")
        );
        assert!(page.contains("a &quot;b&quot;"));
    }

    #[test]
    fn on_a_terminal_columns_are_aligned() {
        let table = Table {
            title: "Scores".into(),
            caption: "Of one seed.".into(),
            columns: ["method", "PSNR", "is"].map(Into::into).into(),
            rows: vec![
                vec![
                    Cell::Text("a".into()),
                    Cell::Number(1.0, 1),
                    Cell::Text("low".into()),
                ],
                vec![Cell::Text("b".into()), Cell::Missing, Cell::Text("".into())],
            ],
            ..Table::default()
        };
        let lines = "Scores\nmethod  PSNR  is\na        1.0  low\nb          -\nOf one seed.";
        assert_eq!(table.text(), lines);
    }

    #[test]
    fn a_turned_table_has_its_columns_as_rows() {
        let table = Table {
            columns: ["group", "PSNR"].map(Into::into).into(),
            rows: vec![
                vec![Cell::Text("a".into()), Cell::Number(1.0, 1)],
                vec![Cell::Text("b".into()), Cell::Missing],
            ],
            turned: true,
            ..Table::default()
        };
        let page = table.html();
        assert!(
            page.contains("<th>group</th><th>a</th><th>b</th>"),
            "{page}"
        );
        let row = "<tr><td>PSNR</td><td class=\"number\">1.0</td><td class=\"number\">-</td></tr>";
        assert!(page.contains(row), "{page}");
        assert_eq!(table.csv(), "group,PSNR\r\na,1\r\nb,\r\n");
    }

    #[test]
    fn small_numbers_do_not_become_zero() {
        assert_eq!(Cell::Number(1.5e-7, 2).shown(), "1.50e-7");
        assert_eq!(Cell::Number(0.0, 2).shown(), "0.00");
        assert_eq!(Cell::Number(12345.6, 1).shown(), "12,345.6");
    }

    #[test]
    fn a_range_below_zero_is_told_in_words() {
        let shown = |low: f64| Cell::Spread([1.0, low, 2.0], 1).shown();
        assert_eq!(shown(0.5), "1.0 (0.5–2.0)");
        assert_eq!(shown(-0.5), "1.0 (−0.5 to 2.0)");
    }
}
