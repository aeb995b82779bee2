//! How many steps of a method take a given time.

use std::sync::Arc;
use std::time::Instant;

use burn::tensor::Device;

use super::gauge::Gauge;
use crate::Error;
use crate::dataset::Dataset;
use crate::train::{StepReport, TrainConfig, Trainer};

/// Steps of the first trial: enough for some rounds of density control.
const FIRST_TRIAL: usize = 300;
/// Untimed steps of a trial: they compile kernels and fill caches.
const COLD: usize = 10;
/// Least share of the budget for the last trial: longer runs have more Gaussians, and another share of
/// dynamic ones.
const TRIAL_SHARE: f64 = 0.35;
/// Most trials.
const MAX_TRIALS: usize = 2;
/// Time grows with this power of the steps: there are more Gaussians in a longer run.
const TYPICAL_POWER: f64 = 1.2;
/// Trials are noisy: the least and the largest power that they may show.
const POWERS: (f64, f64) = (1.0, 1.5);
/// A run may be so much shorter or longer than the budget, as a share of it.
const TOLERANCE: f64 = 0.05;
/// Most runs whose steps are corrected after them.
const MAX_CORRECTIONS: usize = 3;

/// Seconds to train for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Budget {
    /// Evaluation and file writing excluded, at the speed that the machine had when the comparison began.
    pub seconds: f64,
}

/// Told the steps of a trial that begins, and then each of them.
pub(super) type OnStep<'a> = &'a mut dyn FnMut(usize, Option<(&StepReport, f64)>);

impl Budget {
    /// Steps for another run, after runs of so many steps that took so many seconds; `None` if the last is
    /// near enough, or no more are to be tried.
    pub(super) fn corrected(self, runs: &[(usize, f64)]) -> Option<usize> {
        let &(_, seconds) = runs.last()?;
        let near = (seconds / self.seconds - 1.0).abs() <= TOLERANCE;
        if near || runs.len() > MAX_CORRECTIONS {
            return None;
        }
        let points: Vec<(f64, f64)> = runs.iter().map(|&(n, secs)| (n as f64, secs)).collect();
        Some((extrapolate(&points, self.seconds) as usize).max(1))
    }

    /// Steps of `config` that take about these seconds, estimated by short runs through all stages.
    pub(super) fn iterations(
        self,
        config: &TrainConfig,
        dataset: &Arc<Dataset>,
        device: &Device,
        gauge: &mut Gauge,
        on_step: OnStep<'_>,
    ) -> Result<usize, Error> {
        let mut iterations = FIRST_TRIAL;
        let mut points: Vec<(f64, f64)> = Vec::new();
        let mut at_the_end = 0.0;
        for _ in 0..MAX_TRIALS {
            let config = TrainConfig {
                iterations,
                ..config.clone()
            };
            on_step(iterations, None);
            let mut trainer = Trainer::new(config, dataset.clone(), device)?;
            let mut seconds = 0.0;
            while !trainer.is_finished() && seconds < self.seconds {
                let start = Instant::now();
                let report = trainer.step()?;
                if report.step > COLD {
                    seconds += gauge.paced(start.elapsed().as_secs_f64())?;
                }
                on_step(iterations, Some((&report, seconds)));
            }
            let warm = trainer.steps_done().saturating_sub(COLD).max(1) as f64;
            points.push((warm, seconds));
            let start = Instant::now();
            trainer.finished()?;
            at_the_end = gauge.paced(start.elapsed().as_secs_f64())?;
            if seconds >= TRIAL_SHARE * self.seconds {
                break;
            }
            let next = extrapolate(&points, TRIAL_SHARE * self.seconds);
            iterations = (next as usize).max(iterations + 1);
        }
        // What is tried when training is over takes as long after any number of steps, nearly.
        let of_steps = (self.seconds - at_the_end).max(TRIAL_SHARE * self.seconds);
        Ok((extrapolate(&points, of_steps) as usize).max(1))
    }
}

/// Steps that take `seconds`, along a power law through the last two runs.
fn extrapolate(points: &[(f64, f64)], seconds: f64) -> f64 {
    let Some(&(n, secs)) = points.last() else {
        return 1.0;
    };
    let power = match points {
        [.., (before, secs_before), _] if n != *before && *secs_before > 0.0 => {
            (secs / secs_before).ln() / (n / before).ln()
        }
        _ => TYPICAL_POWER,
    };
    let power = if power.is_finite() {
        power.clamp(POWERS.0, POWERS.1)
    } else {
        TYPICAL_POWER
    };
    n * (seconds / secs.max(1e-9)).powf(1.0 / power)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_follow_the_power_law_of_the_trials() {
        // One trial alone: thirty-three times the seconds are not quite nineteen times the steps.
        let alone = extrapolate(&[(300.0, 3.0)], 100.0);
        assert!((alone - 5574.26).abs() < 0.01, "{alone}");
        // Four times the steps took eight times as long: a power of 1.5.
        let steep = [(300.0, 3.0), (1200.0, 24.0)];
        assert!((extrapolate(&steep, 192.0) - 4800.0).abs() < 1e-6);
        // Steps that are faster in the longer run are noise.
        let noise = [(300.0, 3.0), (600.0, 3.0)];
        assert!((extrapolate(&noise, 30.0) - 6000.0).abs() < 1e-6);
        assert!(extrapolate(&[(300.0, 0.0)], 1.0).is_finite());
    }

    #[test]
    fn a_run_far_from_the_budget_is_corrected() {
        let budget = Budget { seconds: 60.0 };
        let once = |seconds: f64| budget.corrected(&[(1000, seconds)]);
        assert_eq!(once(60.0), None);
        assert_eq!(once(58.0), None);
        assert!(once(55.0).is_some(), "methods differ by less");
        let fewer = once(120.0).expect("twice too long");
        assert!((500..1000).contains(&fewer), "{fewer}");
        let more = once(30.0).expect("too short by half");
        assert!((1000..2000).contains(&more), "{more}");
        assert_eq!(budget.corrected(&[]), None);
    }

    #[test]
    fn corrections_go_on_until_the_budget_is_met() {
        let budget = Budget { seconds: 60.0 };
        for power in [1.0, 1.2, 1.5, 1.8] {
            for first in [800, 1500, 4000] {
                let seconds = |steps: usize| 60.0 * (steps as f64 / 2000.0).powf(power);
                let mut runs = vec![(first, seconds(first))];
                while let Some(steps) = budget.corrected(&runs) {
                    runs.push((steps, seconds(steps)));
                }
                let last = runs[runs.len() - 1].1;
                assert!((last / 60.0 - 1.0).abs() <= TOLERANCE, "{power}: {runs:?}");
            }
        }
        let runs = [(1000, 30.0); MAX_CORRECTIONS + 1];
        assert_eq!(budget.corrected(&runs), None, "enough tried");
    }
}
