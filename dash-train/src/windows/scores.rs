//! Scores of windows as one clip.

use std::path::Path;

use super::{ClipRun, WindowedClip};
use crate::Error;
use crate::dataset::{Dataset, Partition};
use crate::evaluate::{Perceptual, Scored, evaluate};
use crate::results::{Results, TRAINING_MEMORY, scored};
use crate::train::RunFolder;

impl WindowedClip {
    /// Scores the clip, faded as it is drawn, and writes `OUT/results.json` for its test views, `OUT/results_train.json` for its
    /// training views. Steps, seconds and bytes are sums over runs, Gaussians over windows; the memory is that of the largest.
    ///
    /// # Errors
    /// When a window is not trained and scored, there are no such views, or a file can't be read or written.
    pub fn evaluate(
        &self,
        dataset: &Dataset,
        partition: Partition,
        device: &str,
        perceptual: &Perceptual,
    ) -> Result<Results, Error> {
        let windows = self.windows();
        let (mut counts, mut sums) = ((0, 0), Sums::default());
        for run in windows.runs() {
            let of_run = sums.add(&self.out.join(run.run_name()))?;
            // Those of the room are among the windows' own.
            if run != ClipRun::Room {
                counts.0 += of_run.0;
                counts.1 += of_run.1;
            }
        }
        let clip = Scored {
            scene: self,
            counts,
            background: self.background()?,
        };
        let downscale = windows.data.downscale;
        let mut evaluation = evaluate(clip, dataset, partition, downscale, perceptual)?;
        evaluation.metric_settings.peak_memory =
            format!("of the windows, the largest: {TRAINING_MEMORY}");
        let results = Results {
            dataset: dataset.name.clone(),
            device: device.into(),
            preset: windows.train.preset,
            seed: windows.train.seed,
            iterations: sums.iterations,
            train_seconds: Some(sums.seconds),
            storage_bytes: sums.bytes,
            peak_memory_bytes: sums.peak,
            evaluation,
        };
        results.write(&self.out.join(RunFolder::scores_name(partition)))?;
        Ok(results)
    }
}

/// What windows took together.
#[derive(Default)]
struct Sums {
    iterations: usize,
    seconds: f64,
    bytes: u64,
    peak: Option<u64>,
}

impl Sums {
    /// Adds a window's run; its static and dynamic Gaussians.
    fn add(&mut self, root: &Path) -> Result<(usize, usize), Error> {
        let Some((_, results)) = scored(root)? else {
            return Err(Error::run(
                root,
                "expected a window that is trained and scored, found none; do it with `dash work`",
            ));
        };
        self.iterations += results.iterations;
        self.seconds += results.train_seconds.unwrap_or(0.0);
        self.bytes += results.storage_bytes;
        self.peak = self.peak.max(results.peak_memory_bytes);
        let evaluation = &results.evaluation;
        Ok((evaluation.n_static, evaluation.n_dynamic))
    }
}
