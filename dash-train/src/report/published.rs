//! What others have published, beside what was measured here.

use super::groups::RunGroup;
use super::runs::{End, RunRecord};
use super::table::{Cell, Table};
use crate::numbers::median_and_range;
use crate::published::{Figures, Protocol, Published, published, scene_called};

/// Bytes of a megabyte, as papers count them.
const MEGABYTE: f64 = 1e6;

/// A row of a table of systems.
#[derive(Debug, Clone, PartialEq)]
pub struct Beside {
    /// The system's name.
    pub system: String,
    /// What is known of it.
    pub figures: Figures,
    /// On which hardware times were taken; empty where that is not stated.
    pub hardware: String,
    /// What a reader must know to compare; empty for nothing.
    pub note: String,
    /// Where the figures are from.
    pub source: String,
}

/// A column of figures: its name, digits after the point, and value.
type Column = (&'static str, usize, fn(&Figures) -> Option<f64>);

const COLUMNS: [Column; 11] = [
    ("PSNR (dB)", 2, |f| f.psnr),
    ("SSIM", 4, |f| f.ssim),
    ("MS-SSIM", 4, |f| f.ms_ssim),
    ("D-SSIM", 4, |f| f.dssim),
    ("LPIPS, Alex", 4, |f| f.lpips_alex),
    ("LPIPS, VGG", 4, |f| f.lpips_vgg),
    ("LPIPS, network not stated", 4, |f| f.lpips),
    ("minutes of training", 1, |f| f.minutes),
    ("pictures per second", 1, |f| f.fps),
    ("size (MB)", 1, |f| f.megabytes),
    ("Gaussians", 0, |f| f.gaussians),
];

/// What a reader of such a table must know.
const CAPTION: &str = "Our rows stand first, then the others by PSNR; - was not measured or is not stated. Papers differ in \
    first points, in the window and data range of SSIM, and in LPIPS's network and range; times are of different \
    hardware. Sources say who measured.";

/// A table of our rows and then the others by falling PSNR; figures that no row has get no column.
pub fn beside(name: &str, title: String, ours: &[Beside], others: &[Beside]) -> Table {
    let mut others = others.to_vec();
    let psnr = |row: &Beside| row.figures.psnr.unwrap_or(f64::NEG_INFINITY);
    others.sort_by(|a, b| psnr(b).total_cmp(&psnr(a)));
    let rows: Vec<Beside> = ours.iter().cloned().chain(others).collect();
    let columns: Vec<Column> = COLUMNS
        .into_iter()
        .filter(|(_, _, of)| rows.iter().any(|row| of(&row.figures).is_some()))
        .collect();
    let mut names = vec!["system".to_string()];
    names.extend(columns.iter().map(|(name, ..)| name.to_string()));
    names.extend(["hardware", "note", "source"].map(ToString::to_string));
    let cells = rows.into_iter().map(|row| {
        let mut cells = vec![Cell::Text(row.system)];
        let figures = columns.iter();
        cells.extend(figures.map(|(_, digits, of)| Cell::number(of(&row.figures), *digits)));
        cells.extend([row.hardware, row.note, row.source].map(Cell::Text));
        cells
    });
    Table {
        name: name.into(),
        title,
        caption: CAPTION.into(),
        columns: names,
        rows: cells.collect(),
        ..Table::default()
    }
}

/// What is published under a key, a scene's name or [`MEAN`](crate::published::MEAN).
pub fn published_figures(protocol: &Protocol, key: &str) -> Vec<Beside> {
    let entries = published(protocol.name);
    let rows = entries.filter_map(|entry| Some(Beside::published(entry, *entry.scenes.get(key)?)));
    rows.collect()
}

impl Beside {
    /// Figures of a published system.
    pub fn published(entry: &Published, figures: Figures) -> Self {
        Self {
            system: entry.system.clone(),
            figures,
            hardware: entry.hardware.clone().unwrap_or_default(),
            note: entry.note.clone().unwrap_or_default(),
            source: entry.source.clone(),
        }
    }

    /// Medians over runs of several seeds.
    pub fn ours(system: String, runs: &[RunRecord], note: String) -> Self {
        let ends: Vec<Figures> = runs
            .iter()
            .filter_map(RunRecord::end)
            .map(figures)
            .collect();
        let median = |values: &[f64]| {
            let found = median_and_range(values.iter().copied());
            found.map_or(f64::NAN, |[median, ..]| median)
        };
        let device = runs.first().map(|run| run.config.data.device.clone());
        Self {
            system,
            figures: Figures::together(&ends, median),
            hardware: device.unwrap_or_default(),
            note,
            source: match runs.len() {
                1 => "this run".into(),
                n => format!("median of {n} runs"),
            },
        }
    }
}

fn figures(end: End) -> Figures {
    Figures {
        psnr: end.psnr,
        ssim: end.ssim,
        ms_ssim: end.ms_ssim,
        dssim: None,
        lpips_alex: end.lpips_alex,
        lpips_vgg: end.lpips_vgg,
        lpips: None,
        minutes: end.seconds.map(|seconds| seconds / 60.0),
        fps: end.render_fps,
        megabytes: Some(end.storage_bytes as f64 / MEGABYTE),
        gaussians: Some((end.n_static + end.n_dynamic) as f64),
    }
}

/// The published figures of the groups' dataset beside them, where its folder is called as a published scene's.
pub(super) fn published_beside(groups: &[RunGroup], prefix: &str) -> Option<Table> {
    let data = &groups.first()?.runs.first()?.config.data;
    let folder = data.dataset.file_name()?.to_string_lossy();
    let (protocol, scene) = scene_called(&folder)?;
    let ours: Vec<Beside> = groups
        .iter()
        .map(|group| Beside::ours(group.label.clone(), &group.runs, String::new()))
        .collect();
    let others = published_figures(protocol, scene.name);
    let title = format!("Published of {} ({})", scene.name, protocol.title);
    let mut table = beside(&format!("{prefix}published"), title, &ours, &others);
    let [width, height] = protocol.size;
    table.caption = format!(
        "These rows are of {} as published: pictures of {width}x{height}; what else is pinned, `dash benchmark {}` \
         says. {CAPTION}",
        protocol.title, protocol.name
    );
    Some(table)
}
