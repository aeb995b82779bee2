//! Scores of held-out views while training goes on: `RUN/curve.jsonl`.
//!
//! Training never reads them: they choose no checkpoint and steer no step. Their time does not count as training
//! time.

use std::collections::BTreeMap;
use std::collections::btree_map::Entry;
use std::path::Path;
use std::sync::Arc;

use burn::module::Module;
use dash_model::scene_file::TablePrecision;
use dash_model::unfinished::Unfinished;
use dash_model::{DynamicScene, ModelError};
use serde::{Deserialize, Serialize};

use super::perceptual::Perceptual;
use super::scores::Evaluation;
use super::storage::storage_bytes;
use super::views::{camera_moving_pixels, evaluate_views};
use crate::Error;
use crate::dataset::{Dataset, Partition, View};
use crate::process::peak_memory_bytes;

/// Most test views that a measurement scores.
pub const MAX_CURVE_VIEWS: usize = 12;

/// One line of `curve.jsonl`: the scene as it would be stored then, whole but for the last line, which is
/// about what is left of it. A score is absent where it is not defined or not finite.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CurveLine {
    /// Steps done.
    pub step: usize,
    /// Seconds trained, evaluation and file writing excluded.
    pub seconds: f64,
    /// Test views scored, the same ones every time.
    pub n_views: usize,
    /// CPU threads of the process.
    pub threads: usize,
    /// Mean over views, dB.
    pub psnr: Option<f64>,
    /// Mean over the views of cameras in which something moves, dB.
    pub psnr_dynamic: Option<f64>,
    /// Mean over views.
    pub ssim: Option<f64>,
    /// Mean over views.
    pub ms_ssim: Option<f64>,
    /// Absent: it would take longer than the training between two lines.
    pub lpips_vgg: Option<f64>,
    /// As `lpips_vgg`.
    pub lpips_alex: Option<f64>,
    /// Static Gaussians.
    pub n_static: usize,
    /// Dynamic Gaussians.
    pub n_dynamic: usize,
    /// What the scene would take on disk.
    pub storage_bytes: u64,
    /// Pictures per second at the views' size.
    pub render_fps: Option<f64>,
    /// Most resident memory of the process so far, dataset and measurements included.
    pub peak_memory_bytes: Option<u64>,
}

/// Takes the same views' scores at steps spread evenly over a run.
pub struct CurveProbe {
    dataset: Arc<Dataset>,
    /// Indices of the views.
    views: Vec<usize>,
    /// Which pixels move, by camera.
    moving: BTreeMap<usize, Vec<bool>>,
    iterations: usize,
    n_measurements: usize,
}

impl CurveProbe {
    /// Whether the dataset has views to score.
    ///
    /// # Errors
    /// When it has no test views.
    pub fn check(dataset: &Dataset) -> Result<(), Error> {
        if dataset.views_of(Partition::Test).next().is_some() {
            return Ok(());
        }
        Err(Error::run(
            &dataset.root,
            "expected test views for --curve, found none; hold cameras out with --test-cameras, or \
             leave --curve out",
        ))
    }

    /// A probe for `n_measurements` over `iterations` steps, the last at the end. `background` is the
    /// scene's.
    ///
    /// Motion masks are computed here, before training asks for images of its own.
    ///
    /// # Errors
    /// When the dataset has no test views, or their images can't be read.
    pub fn new(
        dataset: Arc<Dataset>,
        background: [f32; 3],
        iterations: usize,
        n_measurements: usize,
    ) -> Result<Self, Error> {
        Self::check(&dataset)?;
        let all: Vec<usize> = (0..dataset.views.len())
            .filter(|&i| dataset.views[i].partition == Partition::Test)
            .collect();
        let views = spread(&all, MAX_CURVE_VIEWS);
        let mut moving = BTreeMap::new();
        for &index in &views {
            let view = &dataset.views[index];
            if let Entry::Vacant(new) = moving.entry(view.camera_index) {
                new.insert(camera_moving_pixels(&dataset, view, background)?);
            }
        }
        Ok(Self {
            dataset,
            views,
            moving,
            iterations,
            n_measurements,
        })
    }

    /// Whether a measurement falls on this step.
    pub fn is_due(&self, step: usize) -> bool {
        let n = self.n_measurements.min(self.iterations);
        if n == 0 || step == 0 {
            return false;
        }
        let ordinal = (step * n).div_ceil(self.iterations);
        step == ordinal * self.iterations / n
    }

    /// Scores the scene as it would be stored now. `scratch` is a folder in which it is written once
    /// for its size, and removed again.
    ///
    /// # Errors
    /// When a kernel refuses its input or the scratch files can't be written.
    pub fn measure(
        &mut self,
        (scene, precision): (&DynamicScene, TablePrecision),
        step: usize,
        seconds: f64,
        scratch: &Path,
    ) -> Result<CurveLine, Error> {
        // Without the graph that gradients need, as the scene is rendered when it is done.
        let scene = scene.valid();
        let views: Vec<&View> = self.views.iter().map(|&i| &self.dataset.views[i]).collect();
        let scores = evaluate_views(
            (&scene).into(),
            &self.dataset,
            (Partition::Test, &views),
            &mut self.moving,
            // The factor is for the record, which a line does not keep; LPIPS takes too long for this.
            (1.0, &Perceptual::default()),
        )?;
        let storage = stored_size(&scene, precision, scratch)?;
        Ok(line(step, seconds, storage, &scores))
    }
}

fn line(step: usize, seconds: f64, storage_bytes: u64, scores: &Evaluation) -> CurveLine {
    CurveLine {
        step,
        seconds,
        n_views: scores.per_view.len(),
        threads: rayon::current_num_threads(),
        psnr: scores.psnr,
        psnr_dynamic: scores.psnr_dynamic,
        ssim: scores.ssim,
        ms_ssim: scores.ms_ssim,
        lpips_vgg: scores.lpips_vgg,
        lpips_alex: scores.lpips_alex,
        n_static: scores.n_static,
        n_dynamic: scores.n_dynamic,
        storage_bytes,
        render_fps: scores.render_fps,
        peak_memory_bytes: peak_memory_bytes(),
    }
}

fn stored_size(
    scene: &DynamicScene,
    precision: TablePrecision,
    scratch: &Path,
) -> Result<u64, Error> {
    let folder = Unfinished::folder(&scratch.join("curve"))
        .map_err(|e| ModelError::io(scratch, "write", e))?;
    scene.save_with(folder.path(), precision)?;
    storage_bytes(folder.path())
}

/// At most `most` of the indices, evenly spread.
fn spread(all: &[usize], most: usize) -> Vec<usize> {
    let count = all.len().min(most);
    (0..count)
        .map(|k| all[(2 * k + 1) * all.len() / (2 * count)])
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn probe(iterations: usize, n_measurements: usize) -> CurveProbe {
        let dataset = Dataset {
            name: String::new(),
            root: Default::default(),
            layout: crate::dataset::Layout::N3dv,
            views: Vec::new(),
            points: None,
            n_frames: 0,
            n_cameras: 0,
            stated_span: None,
            frame_rate: None,
            background: None,
        };
        CurveProbe {
            dataset: Arc::new(dataset),
            views: Vec::new(),
            moving: BTreeMap::new(),
            iterations,
            n_measurements,
        }
    }

    #[test]
    fn measurements_are_spread_evenly_and_the_last_is_at_the_end() {
        for (iterations, n, expected) in [
            (300, 6, vec![50, 100, 150, 200, 250, 300]),
            (10, 3, vec![3, 6, 10]),
            (4, 9, vec![1, 2, 3, 4]),
            (5, 1, vec![5]),
            (5, 0, vec![]),
        ] {
            let probe = probe(iterations, n);
            let due: Vec<usize> = (0..=iterations).filter(|&s| probe.is_due(s)).collect();
            assert_eq!(due, expected, "{n} over {iterations}");
        }
    }

    #[test]
    fn views_are_spread_over_all_of_them() {
        let all: Vec<usize> = (100..124).collect();
        let views = spread(&all, 12);
        assert_eq!(views.len(), 12);
        assert_eq!((views[0], views[11]), (101, 123));
        assert_eq!(spread(&all[..3], 12), [100, 101, 102]);
        assert_eq!(spread(&[], 12), [0; 0]);
    }

    #[test]
    fn without_test_views_the_error_says_what_to_do() {
        let dataset = probe(1, 1).dataset;
        let error = CurveProbe::new(dataset, [0.0; 3], 10, 2)
            .err()
            .expect("nothing to score");
        assert!(error.to_string().contains("--test-cameras"), "{error}");
    }
}
