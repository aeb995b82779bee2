//! `dash train --tensorboard`: the lines of a run's logs as curves.

use std::fs;
use std::path::Path;

use dash_train::Error;
use dash_train::tensorboard::EventFile;
use dash_train::train::RunFolder;

/// Follows the logs of a run.
pub struct EventLog {
    events: EventFile,
    /// The last steps of `log.jsonl` and `curve.jsonl` that are written.
    last: Option<[usize; 2]>,
    /// The sizes of both files then.
    sizes: [u64; 2],
}

impl EventLog {
    /// Begins an event file in a folder.
    pub fn create(folder: &Path) -> Result<Self, Error> {
        Ok(Self {
            events: EventFile::create(folder)?,
            last: None,
            sizes: [0; 2],
        })
    }

    /// Takes over lines that are new, up to a step that was done. What a resumed run had before is left out.
    pub fn look(&mut self, run: &RunFolder, step: usize) -> Result<(), Error> {
        let size = |path: &Path| fs::metadata(path).map_or(0, |found| found.len());
        let sizes = [size(&run.log_path()), size(&run.curve_path())];
        let last = self.last.get_or_insert([step.saturating_sub(1); 2]);
        if sizes == self.sizes {
            return Ok(());
        }
        self.sizes = sizes;
        let (log, curve) = (run.log()?, run.curve()?);
        for line in log.iter().filter(|line| line.step > last[0]) {
            let mut values = vec![
                ("loss", f64::from(line.loss)),
                ("psnr/training", f64::from(line.train_psnr)),
                ("gaussians/static", line.n_static as f64),
                ("gaussians/dynamic", line.n_dynamic as f64),
                ("seconds", line.seconds),
            ];
            values.extend(line.validation_psnr.map(|psnr| ("psnr/validation", psnr)));
            self.events.scalars(line.step, &values)?;
        }
        for line in curve.iter().filter(|line| line.step > last[1]) {
            let scores = [
                ("psnr/test", line.psnr),
                ("psnr/test, moving pixels", line.psnr_dynamic),
                ("ssim/test", line.ssim),
            ];
            let found = scores
                .iter()
                .filter_map(|(tag, score)| Some((*tag, (*score)?)));
            self.events.scalars(line.step, &found.collect::<Vec<_>>())?;
        }
        last[0] = log.last().map_or(last[0], |line| line.step);
        last[1] = curve.last().map_or(last[1], |line| line.step);
        Ok(())
    }
}
