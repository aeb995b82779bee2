//! New Gaussians where pictures show what none of those that there are does. Density control copies and splits what is
//! there; a lamp in the dark that no first point stood for has nothing near it that could be copied.

use burn::module::Module;
use dash_model::{GaussianRows, Gaussians};

use super::coarse::Stages;
use super::initial::views_at_start;
use super::optimizer::to_host;
use super::sweep::missing_points;
use super::trainer::{STATIC, Trainer};
use crate::TrainError;

/// When, as shares of the warm-up: once the first Gaussians show what they can, and before motion is looked for.
const ROUNDS: [f32; 2] = [0.3, 0.9];
/// Share of the room that is left for static Gaussians that a round may take.
const OF_ROOM: f32 = 0.5;

/// Adds them, where a round is due with the trainer's step.
pub(crate) fn fill(trainer: &mut Trainer) -> Result<(), TrainError> {
    let share = trainer.config.missing_share;
    let warmup = Stages::of(trainer).warmup;
    let due = ROUNDS.map(|round| (round * warmup as f32) as usize);
    if share <= 0.0 || trainer.step == 0 || trainer.step >= warmup || !due.contains(&trainer.step) {
        return Ok(());
    }
    let (n_static, _) = trainer.scene.counts();
    let most = trainer.config.most_static(trainer.may_move());
    let room = OF_ROOM * most.saturating_sub(n_static) as f32;
    let n = room.min(share * most as f32) as usize;
    if n == 0 {
        return Ok(());
    }
    let dataset = trainer.dataset.clone();
    let views = views_at_start(&dataset, &trainer.train_views, trainer.start_part);
    let scene = trainer.scene.valid();
    let settings = &scene.settings;
    let missing = missing_points(
        &views,
        settings.background,
        n,
        settings.near_plane,
        &mut trainer.rng,
        |camera, time| Ok(to_host(scene.render(camera, time)?.image.narrow(2, 0, 3))),
    )?;
    if missing.is_empty() {
        return Ok(());
    }
    let positions: Vec<[f32; 3]> = missing.iter().map(|point| point.position).collect();
    let colors: Vec<[f32; 3]> = missing.iter().map(|point| point.color).collect();
    let mut more = GaussianRows::from_points(
        &positions,
        &colors,
        trainer.config.sh_degree,
        trainer.extent,
    );
    for (log_scales, point) in more.log_scales.iter_mut().zip(&missing) {
        *log_scales = [point.width.ln(); 3];
    }
    let mut rows = trainer.scene.static_set.to_rows();
    rows.append(&more);
    trainer.scene.static_set = Gaussians::from_rows(&rows, &trainer.device);
    trainer.optimizer.extend_rows(STATIC, n_static, more.len());
    trainer.density_static.grow(more.len());
    tracing::debug!("{} static Gaussians for what was missing", more.len());
    Ok(())
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use burn::tensor::Device;

    use super::*;
    use crate::synth;
    use crate::train::trainer::start_from;
    use crate::train::{Preset, TrainConfig};

    /// Numbers of Gaussians before and after each step of a warm-up that begins with one Gaussian out of sight.
    fn counts(missing_share: f32) -> Vec<usize> {
        let dataset = Arc::new(synth::loaded(6, 2, [32, 24]));
        let mut config = TrainConfig::preset(Preset::Quick);
        config.iterations = 300;
        config.stages.min_following = 0;
        config.missing_share = missing_share;
        let mut trainer = Trainer::new(config, dataset, &Device::flex()).expect("valid");
        let away = GaussianRows::from_points(&[[0.0, 0.0, 900.0]], &[[0.5; 3]], 1, 0.1);
        start_from(&mut trainer, &away);
        let count = |trainer: &Trainer| {
            let (n, _) = trainer.scene.counts();
            // It panics where there are fewer than Gaussians.
            trainer.density_static.gather(&[n - 1]);
            n
        };
        let mut counts = vec![count(&trainer)];
        for _ in 0..Stages::of(&trainer).warmup {
            trainer.step().expect("trains");
            counts.push(count(&trainer));
        }
        counts
    }

    #[test]
    fn what_is_missing_is_added_in_two_rounds() {
        let counts = counts(0.1);
        assert_eq!(counts.len(), 31);
        let grown: Vec<usize> = (1..31).filter(|&k| counts[k] > counts[k - 1]).collect();
        assert_eq!(grown, [10, 28], "{counts:?}");
        assert!(counts[10] > 200 && counts[30] <= 2_001, "{counts:?}");
    }

    #[test]
    fn nothing_is_added_without_a_share() {
        assert!(counts(0.0).iter().all(|&n| n == 1));
    }
}
