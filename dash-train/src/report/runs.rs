//! What a run's folder holds for a report.

use std::path::Path;

use crate::Error;
use crate::dataset::Partition;
use crate::evaluate::CurveLine;
use crate::results::{Results, read_results, read_scores};
use crate::train::{LogLine, RunConfig, RunFolder};
use crate::windows::Windows;

/// A run as far as it has got.
#[derive(Debug, Clone, PartialEq)]
pub struct RunRecord {
    /// The folder's name.
    pub name: String,
    /// What was run.
    pub config: RunConfig,
    /// `log.jsonl`.
    pub log: Vec<LogLine>,
    /// `curve.jsonl`; empty for a run without.
    pub curve: Vec<CurveLine>,
    /// `results.json`, where the run has been scored.
    pub results: Option<Results>,
}

impl RunRecord {
    /// The state of the run at its end, as far as it was measured: from `results.json` when this is of
    /// the test views, else from the last line of the curve.
    pub(super) fn end(&self) -> Option<End> {
        let results = self.results.as_ref();
        let of_test = results.filter(|r| r.evaluation.partition == Partition::Test);
        if let Some(results) = of_test {
            let scores = &results.evaluation;
            return Some(End {
                n_views: scores.per_view.len(),
                seconds: results.train_seconds,
                psnr: scores.psnr,
                psnr_dynamic: scores.psnr_dynamic,
                ssim: scores.ssim,
                ms_ssim: scores.ms_ssim,
                lpips_vgg: scores.lpips_vgg,
                lpips_alex: scores.lpips_alex,
                n_static: scores.n_static,
                n_dynamic: scores.n_dynamic,
                render_fps: scores.render_fps,
                storage_bytes: results.storage_bytes,
                peak_memory_bytes: results.peak_memory_bytes,
            });
        }
        let last = self.curve.last()?;
        Some(End {
            n_views: last.n_views,
            seconds: Some(last.seconds),
            psnr: last.psnr,
            psnr_dynamic: last.psnr_dynamic,
            ssim: last.ssim,
            ms_ssim: last.ms_ssim,
            lpips_vgg: last.lpips_vgg,
            lpips_alex: last.lpips_alex,
            n_static: last.n_static,
            n_dynamic: last.n_dynamic,
            render_fps: last.render_fps,
            storage_bytes: last.storage_bytes,
            peak_memory_bytes: last.peak_memory_bytes,
        })
    }
}

/// The folder's name; with its parent's where it says no more than the seed, as those of a comparison do.
fn name_of(folder: &Path) -> Result<String, Error> {
    let folder = folder
        .canonicalize()
        .map_err(|e| Error::io(folder, "open", e))?;
    let name = |path: &Path| {
        let name = path.file_name().unwrap_or_default();
        name.to_string_lossy().into_owned()
    };
    let (own, parent) = (name(&folder), folder.parent().map(name).unwrap_or_default());
    Ok(match own.strip_prefix("seed-") {
        Some(seed) if !parent.is_empty() && seed.parse::<u64>().is_ok() => {
            format!("{parent}/{own}")
        }
        _ => own,
    })
}

/// A run at its end.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct End {
    pub(super) n_views: usize,
    pub(super) seconds: Option<f64>,
    pub(super) psnr: Option<f64>,
    pub(super) psnr_dynamic: Option<f64>,
    pub(super) ssim: Option<f64>,
    pub(super) ms_ssim: Option<f64>,
    pub(super) lpips_vgg: Option<f64>,
    pub(super) lpips_alex: Option<f64>,
    pub(super) n_static: usize,
    pub(super) n_dynamic: usize,
    pub(super) render_fps: Option<f64>,
    pub(super) storage_bytes: u64,
    pub(super) peak_memory_bytes: Option<u64>,
}

/// Reads a run's folder, or that of a clip in windows of time. Lines that were cut off while being written do not count, and a run that has
/// not been scored has no results.
///
/// # Errors
/// When the folder is no run's, or holds nothing that was measured, or a file can't be read.
pub fn read_run(folder: &Path) -> Result<RunRecord, Error> {
    if Windows::are_in(folder) {
        return read_windows(folder);
    }
    let run = RunFolder::open(folder)?;
    let record = RunRecord {
        name: name_of(folder)?,
        config: run.config()?,
        log: run.log()?,
        curve: run.curve()?,
        results: read_results(&run)?,
    };
    if record.log.is_empty() && record.curve.is_empty() && record.results.is_none() {
        return Err(Error::run(
            folder,
            "expected a run that has been measured, found no whole line in log.jsonl or curve.jsonl and no \
             results.json; let it train for a while with `dash train DATASET --out RUN --resume`",
        ));
    }
    Ok(record)
}

/// A clip in windows of time: one run, with the steps of all windows together.
fn read_windows(folder: &Path) -> Result<RunRecord, Error> {
    let Windows { data, train, .. } = Windows::read(folder)?;
    let scores = folder.join(RunFolder::scores_name(Partition::Test));
    let Some(results) = read_scores(&scores)? else {
        return Err(Error::run(
            folder,
            "expected a clip that is scored, found none; do it with `dash eval`",
        ));
    };
    Ok(RunRecord {
        name: name_of(folder)?,
        config: RunConfig::new(data, train),
        log: Vec::new(),
        curve: Vec::new(),
        results: Some(results),
    })
}
