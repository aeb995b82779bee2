//! What follows a backward pass: a step of Adam, then density control of both sets.

use burn::tensor::{Gradients, Tensor};
use dash_model::{Gaussians, HashEncoder};

use super::coarse::{Part, Stages, shown_at_once, teaches_gaussians};
use super::config::{DensityConfig, LearningRates, TrainConfig};
use super::density::{DensityStatistics, Measure, RESET_OPACITY, control_density};
use super::optimizer::Pace;
use super::oversized;
use super::trainer::{DYNAMIC, STATIC, Trainer};

/// Share of the static Gaussians that is not used before the split: without room, what the static set
/// still lacks would be filled by dynamic Gaussians.
const KEPT_BACK: f32 = 0.25;

/// One step of Adam on everything that has a gradient, at the rates of the trainer's step, after a
/// view at `time`.
pub(crate) fn parameters(trainer: &mut Trainer, time: f32, gradients: &mut Gradients) {
    let mut rates = trainer.config.learning_rates.clone();
    if trainer.start_part.is_some_and(Part::has_several_times) {
        rates.means *= rates.means_in_turns;
    }
    if shown_at_once(trainer.start_part) {
        rates.scales *= rates.at_once;
        rates.grid *= rates.at_once;
    }
    let progress = trainer.step as f32 / trainer.config.iterations as f32;
    let decay = |from: f32, to: f32| {
        if from <= 0.0 || to <= 0.0 {
            from
        } else {
            from * (to / from).powf(progress)
        }
    };
    let means_left = decay(rates.means, rates.means_final) / rates.means.max(1e-30);
    let means = rates.means * means_left * trainer.extent;
    let trajectories = rates.trajectories * means_left * trainer.extent;
    let field = decay(1.0, rates.field_final);
    let stages = Stages::of(trainer);
    let settling = stages.trajectory_rate(trainer.step);
    let scene_rate = |name: &str| match name.rsplit('.').next() {
        Some("means") => means,
        Some("quats") => rates.quats,
        Some("log_scales") => rates.scales,
        Some("opacity_logits") => rates.opacities,
        Some("sh_dc") => rates.sh_dc,
        Some("sh_rest") => rates.sh_rest,
        Some("trajectories") if name.starts_with(STATIC) => trajectories * settling,
        Some("trajectories") => trajectories,
        Some("embeddings") => rates.embeddings * field,
        _ if HashEncoder::is_table(name) => rates.grid * field,
        _ => rates.network * field,
    };
    let teaches_gaussians = teaches_gaussians(trainer, time);
    let optimizer = &mut trainer.optimizer;
    if teaches_gaussians {
        let pace = |name: &str| Pace::from(scene_rate(name));
        let scene = &mut trainer.scene;
        scene.static_set = optimizer.step(
            "scene.static_set",
            scene.static_set.clone(),
            gradients,
            pace,
        );
        // Taken, not cloned: what nobody else holds is changed in place.
        if let Some(dynamic) = scene.dynamic.take() {
            scene.dynamic = Some(optimizer.step("scene.dynamic", dynamic, gradients, pace));
        }
    }
    if let Some(motion) = trainer.motion.take() {
        let left = stages.field_rate(trainer.step);
        let pace = |name: &str| motion_pace(&rates, left, name);
        trainer.motion = Some(optimizer.step("motion", motion, gradients, pace));
    }
}

/// How a parameter of the coarse field learns, when so much is left of its rate.
pub(crate) fn motion_pace(rates: &LearningRates, left: f32, name: &str) -> Pace {
    if HashEncoder::is_table(name) {
        Pace::from(rates.motion_grid * left)
    } else {
        Pace {
            rate: rates.motion_network * left,
            damping: rates.motion_damping,
        }
    }
}

/// What limits sizes, rounds of density control and opacity resets that are due at the trainer's step.
pub(crate) fn densities(trainer: &mut Trainer) {
    let config = trainer.config.clone();
    let step = trainer.step;
    let (from_start, from_split) = (0, Stages::of(trainer).end);
    let core = trainer.core.space;
    let measure = Measure {
        centre: std::array::from_fn(|axis| 0.5 * (core.min[axis] + core.max[axis])),
        extent: trainer.extent,
    };
    oversized::shrink(trainer, measure);
    let control = |rows: &_, statistics: &_, density: &DensityConfig, since, rng: &mut _| {
        let interval = density.opacity_reset_interval;
        let was_reset = interval > 0 && step > since + interval;
        control_density(rows, statistics, density, measure, was_reset, rng)
    };
    let due = |density: &DensityConfig| {
        step >= config.step_at(density.from)
            && step < config.step_at(density.until)
            && step.is_multiple_of(density.interval)
    };
    if due(&config.density_static) {
        let mut density = config.density_static.clone();
        density.max_gaussians = config.most_static(trainer.may_move());
        if trainer.may_move() && step <= from_split {
            density.max_gaussians -= (KEPT_BACK * density.max_gaussians as f32) as usize;
        }
        let rows = trainer.scene.static_set.to_rows();
        let round = control(
            &rows,
            &trainer.density_static,
            &density,
            from_start,
            &mut trainer.rng,
        );
        trainer
            .optimizer
            .edit_rows(STATIC, &round.sources, &round.fresh, rows.len());
        trainer.scene.static_set = Gaussians::from_rows(&round.rows, &trainer.device);
        trainer.density_static = DensityStatistics::new(round.rows.len());
        if trainer.motion_space.is_some() {
            trainer.motion_statistics = trainer.motion_statistics.gather(&round.sources);
            let held_still = &trainer.held_still;
            trainer.held_still = round.sources.iter().map(|&row| held_still[row]).collect();
        }
    }
    if due(&config.density_dynamic)
        && let Some(dynamic) = &mut trainer.scene.dynamic
    {
        let rows = dynamic.gaussians.to_rows();
        let mut density = config.density_dynamic.clone();
        density.max_gaussians = config.most_dynamic(trainer.scene.static_set.len());
        let round = control(
            &rows,
            &trainer.density_dynamic,
            &density,
            from_split,
            &mut trainer.rng,
        );
        trainer
            .optimizer
            .edit_rows(DYNAMIC, &round.sources, &round.fresh, rows.len());
        dynamic.gaussians = Gaussians::from_rows(&round.rows, &trainer.device);
        trainer.density_dynamic = DensityStatistics::new(round.rows.len());
    }
    // While motion is being followed, what it follows must stay in sight.
    if trainer.motion_space.is_none()
        && reset_due(&config, &config.density_static, from_start, step)
    {
        trainer.scene.static_set = with_low_opacity(trainer.scene.static_set.clone());
        trainer.optimizer.reset(&format!("{STATIC}opacity_logits"));
    }
    if reset_due(&config, &config.density_dynamic, from_split, step)
        && let Some(dynamic) = &mut trainer.scene.dynamic
    {
        dynamic.gaussians = with_low_opacity(dynamic.gaussians.clone());
        trainer.optimizer.reset(&format!("{DYNAMIC}opacity_logits"));
    }
}

/// Whether opacities are reset at `step`, for rounds that began to count at `since`. Rounds go on for half
/// an interval at least: those that a reset makes transparent and that come back slowly are to be replaced,
/// not removed by the last round.
fn reset_due(config: &TrainConfig, density: &DensityConfig, since: usize, step: usize) -> bool {
    let interval = density.opacity_reset_interval;
    interval > 0
        && step > since
        && step + interval / 2 <= config.step_at(density.until)
        && (step - since).is_multiple_of(interval)
}

/// The same Gaussians, none more opaque than [`RESET_OPACITY`].
fn with_low_opacity(mut set: Gaussians) -> Gaussians {
    let limit = dash_model::logit(RESET_OPACITY);
    set.opacity_logits = set
        .opacity_logits
        .map(|logits| Tensor::from_inner(logits.inner().clamp_max(limit)).require_grad());
    set
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use burn::tensor::Device;

    use super::*;
    use crate::dataset::Dataset;
    use crate::synth;
    use crate::train::{Keep, Preset};

    #[test]
    fn what_a_reset_hides_has_time_to_come_back_before_the_last_round() {
        for (iterations, expected) in [(3_428, vec![]), (6_000, vec![2_000])] {
            let config = TrainConfig {
                iterations,
                ..TrainConfig::preset(Preset::Quick)
            };
            let density = &config.density_static;
            let resets: Vec<usize> = (0..iterations)
                .filter(|&step| reset_due(&config, density, 0, step))
                .collect();
            assert_eq!(resets, expected, "{iterations} steps");
        }
    }

    /// The largest ways that a mean and a log scale go in the first step, in units of their rates (and the extent).
    fn first_steps(dataset: &Dataset, set: [&str; 2]) -> [f32; 2] {
        let mut config = TrainConfig::preset(Preset::Quick);
        config.keep = Keep::All;
        config.min_initial_points = 50;
        for assignment in set {
            config.set(assignment).expect("a known key");
        }
        let units = [config.learning_rates.means, config.learning_rates.scales];
        let dataset = Arc::new(dataset.clone());
        let mut trainer = Trainer::new(config, dataset, &Device::flex()).expect("valid");
        let rows = |trainer: &Trainer| trainer.scene.static_set.to_rows();
        let before = rows(&trainer);
        trainer.step().expect("finite");
        let after = rows(&trainer);
        let longest = |before: &[[f32; 3]], after: &[[f32; 3]]| {
            let ways = before.iter().flatten().zip(after.iter().flatten());
            ways.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
        };
        [
            longest(&before.means, &after.means) / (units[0] * trainer.extent),
            longest(&before.log_scales, &after.log_scales) / units[1],
        ]
    }

    #[test]
    fn means_are_faster_where_cameras_take_turns_and_scales_where_they_do_not() {
        let rig = synth::loaded(12, 96, [16, 16]);
        let mut in_turns = rig.clone();
        let mut times: Vec<f32> = rig.views.iter().map(|view| view.time).collect();
        times.sort_by(f32::total_cmp);
        times.dedup();
        in_turns.views.retain(|view| {
            let frame = times.iter().position(|time| *time == view.time);
            frame.is_some_and(|frame| view.camera_index == 7 * frame % 12)
        });
        // Adam's first step has the length of the rate.
        let none = [
            "learning_rates.means_in_turns=1",
            "learning_rates.at_once=1",
        ];
        let both = [
            "learning_rates.means_in_turns=2.5",
            "learning_rates.at_once=2",
        ];
        for (dataset, set, expected) in [
            (&rig, none, [1.0, 1.0]),
            (&rig, both, [1.0, 2.0]),
            (&in_turns, none, [1.0, 1.0]),
            (&in_turns, both, [2.5, 1.0]),
        ] {
            let found = first_steps(dataset, set);
            for (found, expected) in found.into_iter().zip(expected) {
                assert!((found / expected - 1.0).abs() < 1e-2, "{found} {expected}");
            }
        }
    }
}
