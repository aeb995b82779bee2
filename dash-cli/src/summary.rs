//! Tables of names and values for people.

use dash_train::results::Results;

/// Rows of a name and a value, the values aligned.
#[derive(Default)]
pub struct Table {
    rows: Vec<(String, String)>,
}

impl Table {
    /// Adds a row.
    pub fn row(&mut self, name: impl Into<String>, value: impl ToString) -> &mut Self {
        self.rows.push((name.into(), value.to_string()));
        self
    }

    /// The rows as text, one line each.
    pub fn text(&self) -> String {
        let width = self
            .rows
            .iter()
            .map(|(name, _)| name.len())
            .max()
            .unwrap_or(0);
        self.rows
            .iter()
            .map(|(name, value)| format!("{name:width$}  {value}\n"))
            .collect()
    }
}

/// The scores of a run.
pub fn results(results: &Results) -> String {
    let scores = &results.evaluation;
    let mut table = Table::default();
    table
        .row("dataset", &results.dataset)
        .row(
            "Gaussians",
            format!("{} static, {} dynamic", scores.n_static, scores.n_dynamic),
        )
        .row("scene on disk", bytes(results.storage_bytes));
    if let Some(secs) = results.train_seconds {
        table.row("training", duration(secs));
    }
    add_scores(&mut table, results);
    table.text()
}

/// Adds the scores of a run.
pub fn add_scores(table: &mut Table, results: &Results) {
    let scores = &results.evaluation;
    table
        .row(
            "scored on",
            format!("{} {} views", scores.per_view.len(), scores.partition),
        )
        .row("PSNR", decibels(scores.psnr))
        .row("PSNR, moving pixels", decibels(scores.psnr_dynamic))
        .row("SSIM", share(scores.ssim))
        .row("MS-SSIM", share(scores.ms_ssim));
    for (name, lpips) in [
        ("LPIPS, VGG16", scores.lpips_vgg),
        ("LPIPS, AlexNet", scores.lpips_alex),
    ] {
        if lpips.is_some() {
            table.row(name, share(lpips));
        }
    }
    if let Some(reason) = &scores.metric_settings.lpips_missing {
        table.row("LPIPS", reason);
    }
    if let Some(found) = &scores.decomposition {
        let is_right_at_rest = scores.n_dynamic == 0 && found.f1 == 1.0;
        let text = match is_right_at_rest {
            true => "nothing, which is right".into(),
            false => format!(
                "precision {:.3}, recall {:.3}, F1 {:.3}",
                found.precision, found.recall, found.f1
            ),
        };
        table.row("what moves", text);
    }
    if let Some(fps) = scores.render_fps {
        table.row(
            "rendering",
            format!("{fps:.1} pictures/s on {}", results.device),
        );
    }
    if let Some(peak) = results.peak_memory_bytes {
        table.row("peak memory", bytes(peak));
    }
}

/// At most a line's worth of names.
pub fn listed<T: AsRef<str>>(names: &[T]) -> String {
    const SHOWN: usize = 8;
    if names.is_empty() {
        return "none".into();
    }
    let mut text = names
        .iter()
        .take(SHOWN)
        .map(AsRef::as_ref)
        .collect::<Vec<_>>()
        .join(", ");
    if names.len() > SHOWN {
        text += &format!(", .. ({} in all)", names.len());
    }
    text
}

fn decibels(value: Option<f64>) -> String {
    value.map_or("not defined".into(), |value| format!("{value:.2} dB"))
}

fn share(value: Option<f64>) -> String {
    value.map_or("not defined".into(), |value| format!("{value:.4}"))
}

/// An amount of memory in a unit that leaves at most four digits.
pub fn bytes(bytes: u64) -> String {
    const UNITS: [&str; 4] = ["KiB", "MiB", "GiB", "TiB"];
    if bytes < 1024 {
        return format!("{bytes} bytes");
    }
    let mut value = bytes as f64 / 1024.0;
    let mut unit = 0;
    while value >= 1024.0 && unit + 1 < UNITS.len() {
        value /= 1024.0;
        unit += 1;
    }
    format!("{value:.1} {}", UNITS[unit])
}

/// Seconds, or minutes and seconds.
pub fn duration(secs: f64) -> String {
    if secs < 60.0 {
        return format!("{secs:.1} s");
    }
    let whole = secs.round() as u64;
    match whole / 3600 {
        0 => format!("{} min {:02} s", whole / 60, whole % 60),
        hours => format!("{hours} h {:02} min", whole / 60 % 60),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn amounts_have_units() {
        assert_eq!(bytes(12), "12 bytes");
        assert_eq!(bytes(1536), "1.5 KiB");
        assert_eq!(bytes(3 << 30), "3.0 GiB");
        assert_eq!(duration(3.21), "3.2 s");
        assert_eq!(duration(125.0), "2 min 05 s");
        assert_eq!(duration(7321.0), "2 h 02 min");
    }
}
