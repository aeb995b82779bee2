//! The machine's speed, by steps of a reference run.
//!
//! Other load and the processor's clock change it by a factor of two within minutes. Methods that train one after
//! the other should not differ by that.

use std::sync::Arc;
use std::time::Instant;

use burn::tensor::Device;
use dash_model::DynamicScene;

use super::Method;
use crate::Error;
use crate::dataset::Dataset;
use crate::train::{Additions, FirstPoints, TrainConfig, Trainer};

/// Seconds of training between two measurements.
const INTERVAL: f64 = 2.0;
/// Reference steps of a measurement.
const STEPS: usize = 4;
/// Reference steps of the first measurement.
const FIRST_STEPS: usize = 32;
/// Untimed steps before it: they compile kernels and fill caches.
const COLD: usize = 10;
/// More steps than any comparison takes.
const ENDLESS: usize = 1 << 40;

/// Repeats one training step of a static 3DGS scene on the comparison's data, and times it.
pub(super) struct Gauge {
    reference: Trainer,
    scene: DynamicScene,
    /// Seconds of a reference step when the comparison began.
    first: f64,
    /// How many times as long one takes now.
    slowness: f64,
    /// Seconds since the last measurement.
    since: f64,
}

impl Gauge {
    /// `first`: [`Gauge::first`] of the comparison that this goes on with; `None` for the present speed.
    pub(super) fn new(
        preset: &TrainConfig,
        dataset: &Arc<Dataset>,
        device: &Device,
        first: Option<f64>,
        first_points: &FirstPoints,
    ) -> Result<Self, Error> {
        let mut config = Method::Static.of(preset);
        config.iterations = ENDLESS;
        config.densify.static_set.during = [0.0; 2];
        let additions = Additions {
            first_points: first_points.clone(),
            ..Default::default()
        };
        let mut reference = Trainer::with(config, dataset.clone(), device, additions)?;
        for _ in 0..COLD {
            reference.step()?;
        }
        let scene = reference.scene().clone();
        let mut gauge = Self {
            reference,
            scene,
            first: 1.0,
            slowness: 1.0,
            since: 0.0,
        };
        let now = gauge.step_seconds(FIRST_STEPS)?;
        gauge.first = first.unwrap_or(now);
        gauge.slowness = now / gauge.first;
        Ok(gauge)
    }

    /// Seconds of a reference step when the comparison began.
    pub(super) fn first(&self) -> f64 {
        self.first
    }

    /// Seconds of training, converted to the machine's speed when the comparison began.
    pub(super) fn paced(&mut self, seconds: f64) -> Result<f64, Error> {
        self.since += seconds;
        if self.since >= INTERVAL {
            self.since = 0.0;
            self.slowness = self.step_seconds(STEPS)? / self.first;
        }
        Ok(seconds / self.slowness)
    }

    /// Mean seconds of a reference step now.
    fn step_seconds(&mut self, steps: usize) -> Result<f64, Error> {
        let mut seconds = 0.0;
        for _ in 0..steps {
            self.reference.run.scene = self.scene.clone();
            let start = Instant::now();
            self.reference.step()?;
            seconds += start.elapsed().as_secs_f64();
        }
        Ok(seconds / steps as f64)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::synth;
    use crate::train::Preset;

    #[test]
    fn a_machine_that_has_become_slower_trains_for_longer() {
        let dataset = Arc::new(synth::loaded(4, 2, [32, 24]));
        let mut preset = TrainConfig::preset(Preset::Quick);
        preset.initial_points[0] = 200;
        let device = Device::flex();
        let points = FirstPoints::default();
        let gauge = |first| Gauge::new(&preset, &dataset, &device, first, &points).expect("trains");
        let mut begun = gauge(None);
        assert_eq!(begun.slowness, 1.0);
        assert_eq!(begun.paced(0.5).expect("trains"), 0.5);
        let sizes = begun.reference.scene().counts();
        begun.paced(INTERVAL).expect("looks");
        assert!(begun.slowness > 0.0 && begun.slowness.is_finite());
        assert_eq!(begun.reference.scene().counts(), sizes);
        // A step took a millionth of a second then: what takes one now would have been quick.
        let mut later = gauge(Some(1e-6));
        assert_eq!(later.first(), 1e-6);
        let paced = later.paced(0.5).expect("trains");
        assert!(paced > 0.0 && paced < 0.05, "{paced}");
    }
}
