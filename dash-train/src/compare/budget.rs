//! How many steps of a method take a given time.

use std::sync::Arc;

use burn::tensor::Device;

use super::gauge::Gauge;
use crate::Error;
use crate::dataset::Dataset;
use crate::train::budget::{OnTrial, Trials, extrapolate};
use crate::train::{FirstPoints, TrainConfig};

/// Steps of the first trial: enough for some rounds of density control.
const FIRST_TRIAL: usize = 300;
/// Least share of the budget for the last trial: longer runs have more Gaussians, and another share of
/// dynamic ones.
const TRIAL_SHARE: f64 = 0.35;
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
        (dataset, device): (&Arc<Dataset>, &Device),
        gauge: &mut Gauge,
        first_points: &FirstPoints,
        on_step: OnTrial<'_>,
    ) -> Result<usize, Error> {
        let trials = Trials {
            first: FIRST_TRIAL,
            last_secs: TRIAL_SHARE * self.seconds,
            most_secs: self.seconds,
            pace: &mut |secs| gauge.paced(secs),
            on_step,
            backdrop: None,
            first_points,
        };
        let tried = trials.run(config, dataset, device)?;
        Ok(tried.steps((self.seconds - tried.after).max(TRIAL_SHARE * self.seconds)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

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
