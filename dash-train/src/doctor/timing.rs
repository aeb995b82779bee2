//! Estimates how long training will take, from the first steps of shortened runs.
//!
//! A run's stages are shares of its steps, so a short run passes through all of them, too fast to learn anything.
//! Two such runs with different numbers of Gaussians give the cost of a Gaussian. The number of dynamic Gaussians
//! stays unknown, so the answer is a range.

use std::sync::Arc;
use std::time::{Duration, Instant};

use burn::tensor::Device;

use super::finding::Finding;
use crate::Error;
use crate::dataset::Dataset;
use crate::numbers::median;
use crate::train::core::is_synchronized;
use crate::train::extensions::stages_of_flow;
use crate::train::{Keep, Preset, TrainConfig, Trainer};

/// Gaussians of the two runs.
const SIZES: [usize; 2] = [3_000, 9_000];
/// Steps of a run, at most and at least.
const STEPS: [usize; 2] = [60, 20];
/// Steps at the beginning that don't count: memory is still being taken.
const COLD: usize = 1;
/// Seconds that a run should take: fewer steps where they are slow.
const RUN_SECS: f64 = 2.0;
/// Nothing more is timed after so long.
const LIMIT: Duration = Duration::from_secs(8);
/// Share of the Gaussians that is taken to move, at most.
const MOVING: f32 = 0.3;
/// Gaussians become this many times as many, at most.
const GROWTH: usize = 2;
/// Presets whose time is told.
const PRESETS: [Preset; 2] = [Preset::Quick, Preset::Default];

/// Warm-up, the coarse field, trajectories of each Gaussian's own, 4D.
const N_STAGES: usize = 4;

/// What training is to be timed on.
#[derive(Debug, Clone, Copy)]
pub struct TimedOn<'a> {
    /// The device.
    pub device: &'a Device,
    /// What it is called.
    pub name: &'a str,
}

/// Seconds per step of a run, by stage.
#[derive(Debug, Clone, PartialEq)]
struct Timed {
    gaussians: usize,
    steps: usize,
    secs: [Option<f64>; N_STAGES],
}

/// How long the presets take on a dataset.
pub(super) fn check(dataset: &Dataset, on: TimedOn) -> Finding {
    let dataset = Arc::new(dataset.clone());
    let start = Instant::now();
    let timed = time(&dataset, SIZES[1], on.device, LIMIT).and_then(|large| {
        let mut runs = vec![large];
        if start.elapsed() < LIMIT / 2 {
            runs.push(time(&dataset, SIZES[0], on.device, LIMIT / 2)?);
        }
        Ok(runs)
    });
    let runs = match timed {
        Ok(runs) => runs,
        Err(error) => return Finding::note("time", format!("not estimated: {error}")),
    };
    let steps: usize = runs.iter().map(|run| run.steps).sum();
    if steps == 0 {
        let limit = LIMIT.as_secs();
        let text = format!("not estimated: the first steps of training took over {limit} s");
        return Finding::note("time", text);
    }
    let whole = dataset.is_static() || runs[0].secs[N_STAGES - 1].is_some();
    let cut = match whole {
        true => "",
        false => " of the first stages, the last being slower",
    };
    let n_given = dataset.points.as_ref().map_or(0, |p| p.positions.len());
    let told = PRESETS.map(|preset| {
        let mut config = TrainConfig::preset(preset).for_capture(&dataset);
        config.iterations = config.steps_for(&dataset);
        let [low, high] = range(
            &runs,
            &config,
            n_given,
            dataset.is_static(),
            is_synchronized(&dataset).then_some(dataset.n_frames),
        );
        let name = format!("{preset:?}").to_lowercase();
        format!("{} with --preset {name}", in_words(low, high))
    });
    let threads = rayon::current_num_threads();
    Finding::ok(
        "time",
        format!(
            "about {} on {} ({threads} threads); from {steps} timed steps{cut}, under the machine's \
             present load",
            told.join(", "),
            on.name,
        ),
    )
}

/// Times the steps of a short run for at most `limit`. It starts from about `gaussians` Gaussians and takes some to move.
fn time(
    dataset: &Arc<Dataset>,
    gaussians: usize,
    device: &Device,
    limit: Duration,
) -> Result<Timed, Error> {
    let mut config = TrainConfig::preset(Preset::Quick);
    config.iterations = STEPS[0];
    config.initial_points = [gaussians; 2];
    config.method.static_quantile = 1.0 - MOVING;
    config.method.motion_floor = 0.0;
    config.extensions.demotion = None;
    config.keep(Keep::All);
    let mut trainer = Trainer::new(config, dataset.clone(), device)?;
    // What comes before the first step is no part of a step.
    let deadline = Instant::now() + limit;
    let mut secs: [Vec<f64>; N_STAGES] = Default::default();
    let mut n = 0;
    let mut is_shortened = false;
    while !trainer.is_finished() && Instant::now() < deadline {
        let step = trainer.steps_done();
        let start = Instant::now();
        trainer.step()?;
        let taken = start.elapsed().as_secs_f64();
        if step < COLD {
            continue;
        }
        if !is_shortened {
            // No stage has ended yet: all of them move together.
            let affordable = (RUN_SECS / taken.max(1e-9)) as usize;
            trainer.run.config.iterations = affordable.clamp(STEPS[1], STEPS[0]);
            is_shortened = true;
        }
        let stages = trainer.run.stages();
        let ends = [stages.warmup, stages.handover, stages.end];
        let stage = match trainer.run.may_move() {
            true => ends.iter().filter(|&&end| step >= end).count(),
            false => 0,
        };
        secs[stage].push(taken);
        n += 1;
    }
    let (n_static, n_dynamic) = trainer.scene().counts();
    Ok(Timed {
        gaussians: n_static + n_dynamic,
        steps: n,
        secs: secs.map(median),
    })
}

/// The least and the most seconds that a run takes; of a rig the number of times is known.
fn range(
    runs: &[Timed],
    config: &TrainConfig,
    n_given: usize,
    is_static: bool,
    rig: Option<usize>,
) -> [f64; 2] {
    let [fewest, most] = config.initial_points;
    let first = n_given.clamp(fewest.min(most), most);
    let [n_static, n_dynamic] = [
        config.densify.static_set.max_gaussians,
        config.densify.dynamic.max_gaussians,
    ];
    let few = first.min(n_static);
    let many = first.max((n_static + n_dynamic).min(GROWTH * first));
    let asked = config.method.stages;
    let following = config.extensions.following.as_ref();
    let handover = following.map_or(1.0, |following| following.handover_of(rig.is_some()));
    let ([warmup, decomposition], handover) = match rig {
        Some(n_times) if following.is_some() => {
            stages_of_flow(asked, handover, config.iterations, n_times)
        }
        _ => (asked, handover),
    };
    let handover = warmup + handover * (decomposition - warmup);
    let ends = [warmup, handover, decomposition, 1.0];
    let total = |n: usize, moves: bool| -> f64 {
        let mut start = 0.0;
        let mut secs = 0.0;
        for (stage, end) in ends.into_iter().enumerate() {
            // After the decomposition, a scene at rest is rendered as during the warm-up.
            let like = if is_static || (stage == N_STAGES - 1 && !moves) {
                0
            } else {
                stage
            };
            secs += f64::from(end - start) * step_secs(runs, like, n);
            start = end;
        }
        secs * config.iterations as f64
    };
    [total(few, false), total(many, !is_static)]
}

/// Seconds of a step of a stage with so many Gaussians: a part that is the same for any number, and one
/// in proportion to it, as two runs show; of one run, all in proportion to what is more.
fn step_secs(runs: &[Timed], stage: usize, n: usize) -> f64 {
    let at = |run: &Timed| {
        // Of a stage that was not reached, nothing is known but the one before.
        let timed = run.secs[..=stage].iter().rev();
        timed.flatten().next().copied().unwrap_or(0.0)
    };
    match runs {
        [large, small] if large.gaussians > small.gaussians => {
            let span = (large.gaussians - small.gaussians) as f64;
            let slope = ((at(large) - at(small)) / span).max(0.0);
            (at(large) + slope * (n as f64 - large.gaussians as f64)).max(0.0)
        }
        [run, ..] => at(run) * (n as f64 / run.gaussians.max(1) as f64).max(1.0),
        [] => 0.0,
    }
}

/// A range of seconds, rounded outwards, as people say it.
fn in_words(low: f64, high: f64) -> String {
    let (unit, name) = match high {
        high if high < 100.0 => (10.0, "seconds"),
        high if high < 180.0 * 60.0 => (60.0, "minutes"),
        _ => (3600.0, "hours"),
    };
    let per = if name == "seconds" { 10.0 } else { 1.0 };
    let (low, high) = ((low / unit).floor() * per, (high / unit).ceil() * per);
    match low {
        low if low == high => format!("{high} {name}"),
        low if low < 1.0 => format!("up to {high} {name}"),
        low => format!("{low} to {high} {name}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn run(gaussians: usize, secs: [f64; N_STAGES]) -> Timed {
        Timed {
            gaussians,
            steps: 10,
            secs: secs.map(Some),
        }
    }

    #[test]
    fn times_of_steps_follow_from_two_runs() {
        let runs = [run(3000, [0.03; 4]), run(1000, [0.02; 4])];
        for (n, secs) in [(1000, 0.02), (3000, 0.03), (5000, 0.04), (0, 0.015)] {
            assert!((step_secs(&runs, 2, n) - secs).abs() < 1e-12, "{n}");
        }
        assert_eq!(step_secs(&runs[..1], 0, 6000), 0.06);
        assert_eq!(step_secs(&runs[..1], 0, 1000), 0.03);
        // Under a changing load the smaller run may be the slower one.
        let odd = [run(3000, [0.02; 4]), run(1000, [0.03; 4])];
        assert_eq!(step_secs(&odd, 0, 9000), 0.02);
    }

    #[test]
    fn a_stage_that_was_not_reached_is_taken_for_the_one_before() {
        let mut cut = run(1000, [0.01, 0.02, 0.04, 0.08]);
        cut.secs[3] = None;
        cut.secs[2] = None;
        assert_eq!(step_secs(&[cut], 3, 1000), 0.02);
    }

    #[test]
    fn a_run_is_its_stages_and_what_may_move() {
        // Of no slope, so that numbers of Gaussians don't matter.
        let secs = [0.01, 0.02, 0.04, 0.08];
        let runs = [run(3000, secs), run(1000, secs)];
        let mut config = TrainConfig::preset(Preset::Quick);
        config.iterations = 1000;
        config.method.stages = [0.1, 0.5];
        if let Some(following) = &mut config.extensions.following {
            following.handover = 0.5;
        }
        // 100, 200, 200 and 500 steps.
        let [low, high] = range(&runs, &config, 0, false, None);
        assert!((low - (1.0 + 4.0 + 8.0 + 5.0)).abs() < 1e-3, "{low}");
        assert!((high - (1.0 + 4.0 + 8.0 + 40.0)).abs() < 1e-3, "{high}");
        let [low, high] = range(&runs, &config, 0, true, None);
        assert!((low - 10.0).abs() < 1e-3 && (high - 10.0).abs() < 1e-3);
        // 12 steps for each of a rig's 20 frames put off the decomposition: 100, 240, 140 and 520 steps.
        config.method.stages = [0.1, 0.4];
        let [low, _] = range(&runs, &config, 0, false, Some(20));
        assert!((low - (1.0 + 4.8 + 5.6 + 5.2)).abs() < 1e-3, "{low}");
    }

    #[test]
    fn ranges_are_rounded_outwards() {
        for (low, high, words) in [
            (41.0, 79.0, "40 to 80 seconds"),
            (3.0, 9.0, "up to 10 seconds"),
            (65.0, 185.0, "1 to 4 minutes"),
            (60.0, 60.0 * 99.5, "1 to 100 minutes"),
            (1000.0, 7201.0, "16 to 121 minutes"),
            (14_400.0, 14_400.0, "4 hours"),
            (3000.0, 14_401.0, "up to 5 hours"),
        ] {
            assert_eq!(in_words(low, high), words);
        }
    }
}
