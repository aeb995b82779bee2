//! How many steps of a run fit into a time.
//!
//! Stages are shares of a run, so a short run passes through all of them. Two of them tell what a step costs and how that
//! grows with the steps, since a longer run has more Gaussians.

use std::sync::Arc;
use std::time::Instant;

use burn::tensor::Device;
use dash_model::DynamicScene;

use super::{Additions, FirstPoints, StepReport, TrainConfig, Trainer};
use crate::Error;
use crate::dataset::Dataset;

/// Untimed steps of a trial: they compile kernels and fill caches.
const COLD: usize = 10;
/// Steps of the first trial of a run's own budget.
const FIRST_STEPS: usize = 60;
/// Share of a budget that its trials may take.
const SHARE: f64 = 0.1;
/// Share of one run's time that the last trial may take, where the budget is that of many.
const SHARE_OF_RUN: f64 = 0.5;
/// Most trials.
const MAX_TRIALS: usize = 2;
/// Time grows with this power of the steps: there are more Gaussians in a longer run.
pub(crate) const TYPICAL_POWER: f64 = 1.2;
/// Trials are noisy: the least and the largest power that they may show.
const POWERS: [f64; 2] = [1.0, 1.5];

/// Told the steps of a trial that begins, and then each of them with the seconds so far.
pub type OnTrial<'a> = &'a mut dyn FnMut(usize, Option<(&StepReport, f64)>);

/// How trials are made.
pub(crate) struct Trials<'a> {
    /// Steps of the first.
    pub(crate) first: usize,
    /// Seconds that the last should take: longer runs have more Gaussians, and another share of dynamic ones.
    pub(crate) last_secs: f64,
    /// Seconds that none takes longer than.
    pub(crate) most_secs: f64,
    /// What the seconds of a step count for.
    pub(crate) pace: &'a mut dyn FnMut(f64) -> Result<f64, Error>,
    /// Who is told.
    pub(crate) on_step: OnTrial<'a>,
    /// The room of another run that is drawn with each.
    pub(crate) backdrop: Option<&'a DynamicScene>,
    /// What they start from, which is kept for the run itself.
    pub(crate) first_points: &'a FirstPoints,
}

/// What trials showed.
pub(crate) struct Tried {
    /// Steps and the seconds that they took.
    points: Vec<(f64, f64)>,
    /// Seconds in which first points were found.
    pub(crate) finding: f64,
    /// Seconds before the first step that is timed, once there are first points.
    pub(crate) before: f64,
    /// Seconds after the last: what is tried when training is over takes as long after any number of steps, nearly.
    pub(crate) after: f64,
}

impl Tried {
    /// Steps that take `secs`.
    pub(crate) fn steps(&self, secs: f64) -> usize {
        (extrapolate(&self.points, secs) as usize).max(1)
    }
}

impl Trials<'_> {
    /// Short runs through all stages of `config`.
    pub(crate) fn run(
        self,
        config: &TrainConfig,
        dataset: &Arc<Dataset>,
        device: &Device,
    ) -> Result<Tried, Error> {
        let mut tried = Tried {
            points: Vec::new(),
            finding: 0.0,
            before: 0.0,
            after: 0.0,
        };
        let mut iterations = self.first;
        for _ in 0..MAX_TRIALS {
            let config = TrainConfig {
                iterations,
                ..config.clone()
            };
            (self.on_step)(iterations, None);
            config.validate()?;
            let start = Instant::now();
            let schedule = config.for_capture(dataset).schedule();
            self.first_points.find(&schedule, dataset)?;
            // Later trials have them already.
            tried.finding = start.elapsed().as_secs_f64().max(tried.finding);
            let start = Instant::now();
            let additions = Additions {
                backdrop: self.backdrop.cloned(),
                first_points: self.first_points.clone(),
                ..Default::default()
            };
            let mut trainer = Trainer::with(config, dataset.clone(), device, additions)?;
            let mut secs = 0.0;
            while !trainer.is_finished() && secs < self.most_secs {
                let start_of_step = Instant::now();
                let report = trainer.step()?;
                if report.step > COLD {
                    secs += (self.pace)(start_of_step.elapsed().as_secs_f64())?;
                } else {
                    tried.before = start.elapsed().as_secs_f64();
                }
                (self.on_step)(iterations, Some((&report, secs)));
            }
            let warm = trainer.steps_done().saturating_sub(COLD).max(1) as f64;
            tried.points.push((warm, secs));
            let start = Instant::now();
            trainer.finished()?;
            tried.after = (self.pace)(start.elapsed().as_secs_f64())?;
            if secs >= self.last_secs {
                break;
            }
            let next = extrapolate(&tried.points, self.last_secs);
            iterations = (next as usize).max(iterations + 1);
        }
        Ok(tried)
    }
}

/// Seconds for the training of one or more runs.
#[derive(Clone)]
pub struct Budget<'a> {
    /// Seconds from now, trials included; scores and files are written besides that.
    pub secs: f64,
    /// Runs that share them.
    pub runs: f64,
    /// The room of another run that each draws.
    pub backdrop: Option<&'a DynamicScene>,
    /// Where the run's own first points go, if it gets them in [`Additions::first_points`]; `None`: each run finds its own, which
    /// takes some of its time.
    pub first_points: Option<FirstPoints>,
}

impl Budget<'_> {
    /// Of a single run.
    pub fn of_one(secs: f64) -> Self {
        Self {
            secs,
            runs: 1.0,
            backdrop: None,
            first_points: None,
        }
    }

    /// Steps of each run that fit, by trials.
    ///
    /// # Errors
    /// What [`Trainer::new`] and [`Trainer::step`] refuse.
    pub fn steps(
        self,
        config: &TrainConfig,
        dataset: &Arc<Dataset>,
        device: &Device,
        on_step: OnTrial<'_>,
    ) -> Result<usize, Error> {
        let Self {
            secs,
            runs,
            backdrop,
            first_points,
        } = self;
        let begin = Instant::now();
        let last_secs = (SHARE * secs).min(SHARE_OF_RUN * secs / runs);
        let trials = Trials {
            first: FIRST_STEPS,
            last_secs,
            most_secs: 2.0 * last_secs,
            pace: &mut Ok,
            on_step,
            backdrop,
            first_points: &first_points.clone().unwrap_or_default(),
        };
        let tried = trials.run(config, dataset, device)?;
        let finding = match first_points {
            Some(_) => 0.0,
            None => tried.finding,
        };
        let besides = finding + tried.before + tried.after;
        let left = (secs - begin.elapsed().as_secs_f64()) / runs - besides;
        Ok(tried.steps(left.max(SHARE * secs / runs)))
    }
}

/// Steps that take `secs`, along a power law through the last two runs.
pub(crate) fn extrapolate(points: &[(f64, f64)], secs: f64) -> f64 {
    let Some(&(n, taken)) = points.last() else {
        return 1.0;
    };
    let power = match points {
        [.., (before, taken_before), _] if n != *before && *taken_before > 0.0 => {
            (taken / taken_before).ln() / (n / before).ln()
        }
        _ => TYPICAL_POWER,
    };
    let power = match power.is_finite() {
        true => power.clamp(POWERS[0], POWERS[1]),
        false => TYPICAL_POWER,
    };
    n * (secs / taken.max(1e-9)).powf(1.0 / power)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::synth;
    use crate::train::Preset;

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
    fn the_last_trial_takes_what_it_should_and_none_goes_on_past_the_most() {
        let dataset = Arc::new(synth::loaded(4, 2, [24, 18]));
        let config = crate::train::config::tests::small(&[]);
        // A clock by which every step takes a second.
        let trials = |last_secs: f64, most_secs: f64| {
            let mut lengths = Vec::new();
            let tried = Trials {
                first: 30,
                last_secs,
                most_secs,
                pace: &mut |_| Ok(1.0),
                on_step: &mut |steps, step| {
                    if step.is_none() {
                        lengths.push(steps);
                    }
                },
                backdrop: None,
                first_points: &FirstPoints::default(),
            };
            let tried = tried.run(&config, &dataset, &Device::flex());
            (lengths, tried.expect("trains"))
        };
        let (lengths, tried) = trials(40.0, 1e9);
        assert_eq!(lengths.len(), 2, "the first takes 20 s");
        assert!((35..=60).contains(&lengths[1]), "{lengths:?}");
        assert_eq!(tried.points[0], (20.0, 20.0));
        assert_eq!(tried.steps(1_000.0), 1_000);
        assert_eq!(tried.after, 1.0);
        assert!(tried.before > 0.0 && tried.finding > 0.0);

        let (lengths, tried) = trials(5.0, 10.0);
        assert_eq!(lengths, [30]);
        assert_eq!(tried.points, [(10.0, 10.0)]);
    }

    #[test]
    fn there_is_a_run_in_no_time() {
        let dataset = Arc::new(synth::loaded(4, 2, [24, 18]));
        let mut config = TrainConfig::preset(Preset::Quick);
        config.initial_points = [100, 200];
        let within = |secs: f64, runs: f64| {
            let budget = Budget {
                runs,
                ..Budget::of_one(secs)
            };
            let steps = budget.steps(&config, &dataset, &Device::flex(), &mut |_, _| {});
            steps.expect("trains")
        };
        assert!(within(1e-6, 1.0) >= 1);
        assert!(within(1e-6, 30.0) >= 1);
    }
}
