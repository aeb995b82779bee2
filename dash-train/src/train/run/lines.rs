//! Files of a run that grow by lines of JSON: `log.jsonl` and `curve.jsonl`.

use std::fs::{self, File, OpenOptions};
use std::io::Write;
use std::path::{Path, PathBuf};

use dash_model::scene_file::write_atomically;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use crate::Error;
use crate::evaluate::{CurveLine, CurveProbe};
use crate::train::core::{SkippedStep, StepReport};
use crate::train::trainer::Trainer;

/// Steps between two lines of `log.jsonl`.
const LOG_INTERVAL: usize = 50;
/// Steps between measurements on the validation views.
const VALIDATION_INTERVAL: usize = 500;

/// One line of `log.jsonl`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct LogLine {
    /// Steps done.
    pub step: usize,
    /// Seconds trained, evaluation and file writing excluded.
    pub seconds: f64,
    /// Mean loss since the last line.
    pub loss: f32,
    /// Mean PSNR of the training views since the last line, dB.
    pub train_psnr: f32,
    /// Static Gaussians.
    pub n_static: usize,
    /// Dynamic Gaussians.
    pub n_dynamic: usize,
    /// Seconds that steps have waited for images so far, where these are decoded on demand.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub waited_seconds: Option<f64>,
    /// PSNR of views that are neither trained on nor tested, dB, where measured.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub validation_psnr: Option<f64>,
    /// Steps since the last line that changed nothing because something was not finite; they do not count
    /// in the means.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub skipped_steps: Vec<SkippedStep>,
}

/// The lines of a file that are whole; none when there is no such file.
pub(super) fn read_lines<T: DeserializeOwned>(path: &Path) -> Result<Vec<T>, Error> {
    let text = match fs::read(path) {
        Ok(text) => text,
        Err(e) if e.kind() == std::io::ErrorKind::NotFound => return Ok(Vec::new()),
        Err(e) => return Err(Error::io(path, "read", e)),
    };
    // A line that was cut off need not even be UTF-8.
    let lines = text.split(|&byte| byte == b'\n');
    Ok(lines
        .filter_map(|line| serde_json::from_slice(line).ok())
        .collect())
}

/// Adds a line.
pub(super) fn append(file: &mut File, line: &impl Serialize, path: &Path) -> Result<(), Error> {
    let text = serde_json::to_string(line).map_err(|e| Error::Config(e.to_string()))?;
    writeln!(file, "{text}").map_err(|e| Error::io(path, "write", e))
}

/// `log.jsonl` while a run goes on, with what the next line is the mean of.
pub(super) struct Log {
    file: File,
    path: PathBuf,
    loss: f32,
    psnr: f32,
    count: usize,
}

impl Log {
    /// The file without lines that a resumed run will write again.
    pub(super) fn reopen(path: &Path, step: usize) -> Result<Self, Error> {
        let lines: Vec<LogLine> = read_lines(path)?;
        Ok(Self {
            file: reopen(path, lines.iter().filter(|line| line.step <= step))?,
            path: path.to_path_buf(),
            loss: 0.0,
            psnr: 0.0,
            count: 0,
        })
    }

    /// Takes in a step, and writes a line where one is due.
    pub(super) fn take(
        &mut self,
        report: &StepReport,
        trainer: &mut Trainer,
        seconds: f64,
    ) -> Result<(), Error> {
        let n = report.n_sound();
        if n > 0 {
            self.loss += n as f32 * report.loss;
            self.psnr += n as f32 * report.psnr;
            self.count += n;
        }
        let (step, last) = (report.step, trainer.is_finished());
        // A line of skipped steps alone has no means and waits for more.
        if !(step.is_multiple_of(LOG_INTERVAL) || last) || self.count == 0 {
            return Ok(());
        }
        let measured = step.is_multiple_of(VALIDATION_INTERVAL) || last;
        let validation_psnr = match measured {
            true => trainer.validation_psnr()?,
            false => None,
        };
        let n = std::mem::take(&mut self.count) as f32;
        let line = LogLine {
            step,
            seconds,
            loss: std::mem::take(&mut self.loss) / n,
            train_psnr: std::mem::take(&mut self.psnr) / n,
            n_static: report.n_static,
            n_dynamic: report.n_dynamic,
            waited_seconds: trainer.waited_seconds(),
            validation_psnr,
            skipped_steps: trainer.take_skipped_steps(),
        };
        append(&mut self.file, &line, &self.path)
    }
}

/// The curve without lines that a resumed run will write again, and what measures it; `None` when nothing is to be measured.
pub(super) fn reopen_curve(
    path: &Path,
    trainer: &Trainer,
    n_measurements: usize,
) -> Result<Option<(CurveProbe, File)>, Error> {
    let lines: Vec<CurveLine> = read_lines(path)?;
    if n_measurements == 0 && !path.is_file() {
        return Ok(None);
    }
    let done = trainer.steps_done();
    // The last line is written anew with the finished scene.
    let end = trainer.config().iterations;
    let stays = |line: &&CurveLine| line.step <= done && line.step < end;
    let file = reopen(path, lines.iter().filter(stays))?;
    if n_measurements == 0 {
        return Ok(None);
    }
    let background = trainer.scene().settings.background;
    let iterations = trainer.config().iterations;
    let dataset = trainer.run.dataset.clone();
    let probe = CurveProbe::new(dataset, background, iterations, n_measurements)?;
    Ok(Some((probe, file)))
}

/// The file with these lines alone, to be added to.
fn reopen<'a, T: Serialize + 'a>(
    path: &Path,
    kept: impl Iterator<Item = &'a T>,
) -> Result<File, Error> {
    write_atomically(path, |mut file| {
        for line in kept {
            writeln!(file, "{}", serde_json::to_string(line)?)?;
        }
        Ok(())
    })?;
    OpenOptions::new()
        .append(true)
        .open(path)
        .map_err(|e| Error::io(path, "open", e))
}
