//! How many steps of a method take a given time.

use std::sync::Arc;
use std::time::Instant;

use burn::tensor::Device;

use crate::TrainError;
use crate::dataset::Dataset;
use crate::train::{StepReport, TrainConfig, Trainer};

/// Steps of the first trial: enough for some rounds of density control.
const FIRST_TRIAL: usize = 300;
/// Steps of a trial that are not timed: they pay for what later ones find ready, such as kernels.
const COLD: usize = 10;
/// Share of the budget that the last trial should take at least: longer runs have more Gaussians, and
/// slower steps.
const TRIAL_SHARE: f64 = 0.2;
/// Most trials.
const MAX_TRIALS: usize = 3;

/// Training seconds to be spent.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Budget {
    /// Evaluation and file writing excluded.
    pub seconds: f64,
}

/// Told the steps of a trial that begins, and then each of them.
pub(super) type OnStep<'a> = &'a mut dyn FnMut(usize, Option<(&StepReport, f64)>);

impl Budget {
    /// Steps of `config` that take about these seconds here: found by short runs, each of which goes
    /// through all stages.
    pub(super) fn iterations(
        self,
        config: &TrainConfig,
        dataset: &Arc<Dataset>,
        device: &Device,
        on_step: OnStep<'_>,
    ) -> Result<usize, TrainError> {
        let mut iterations = FIRST_TRIAL;
        let mut points: Vec<(f64, f64)> = Vec::new();
        for _ in 0..MAX_TRIALS {
            let config = TrainConfig {
                iterations,
                ..config.clone()
            };
            on_step(iterations, None);
            let mut trainer = Trainer::new(config, dataset.clone(), device)?;
            let (mut start, mut seconds) = (Instant::now(), 0.0);
            while !trainer.is_finished() && seconds < self.seconds {
                let report = trainer.step()?;
                if report.step == COLD {
                    start = Instant::now();
                }
                seconds = start.elapsed().as_secs_f64();
                on_step(iterations, Some((&report, seconds)));
            }
            let warm = trainer.steps_done().saturating_sub(COLD).max(1) as f64;
            points.push((warm, seconds));
            if seconds >= TRIAL_SHARE * self.seconds {
                break;
            }
            let next = self.extrapolate(&points, TRIAL_SHARE * self.seconds);
            iterations = (next as usize).max(iterations + 1);
        }
        Ok((self.extrapolate(&points, self.seconds) as usize).max(1))
    }

    /// Steps that take `seconds`, along a power law through the last two trials.
    fn extrapolate(self, points: &[(f64, f64)], seconds: f64) -> f64 {
        /// Step time does not fall with the length of a run, nor grow faster than this power.
        const POWERS: (f64, f64) = (1.0, 1.5);
        let Some(&(n, secs)) = points.last() else {
            return 1.0;
        };
        let power = match points {
            [.., (before, secs_before), _] if n > *before && *secs_before > 0.0 => {
                (secs / secs_before).ln() / (n / before).ln()
            }
            _ => POWERS.0,
        };
        let power = if power.is_finite() { power } else { POWERS.0 };
        n * (seconds / secs.max(1e-9)).powf(1.0 / power.clamp(POWERS.0, POWERS.1))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_follow_the_power_law_of_the_trials() {
        let budget = Budget { seconds: 100.0 };
        assert!((budget.extrapolate(&[(300.0, 3.0)], 100.0) - 10_000.0).abs() < 1e-6);
        // Four times the steps took eight times as long: a power of 1.5.
        let steep = [(300.0, 3.0), (1200.0, 24.0)];
        assert!((budget.extrapolate(&steep, 192.0) - 4800.0).abs() < 1e-6);
        // Faster steps in the longer run are noise.
        let noise = [(300.0, 3.0), (600.0, 3.0)];
        assert!((budget.extrapolate(&noise, 30.0) - 6000.0).abs() < 1e-6);
        assert!(budget.extrapolate(&[(300.0, 0.0)], 1.0).is_finite());
    }
}
