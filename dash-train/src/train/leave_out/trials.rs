//! Trials when training is over: the scene without a part, on training views, against the scene with
//! it.

use dash_model::scene_file::parameter_bytes;
use dash_model::{DynamicScene, Gaussians};

use super::{Decision, MAX_LOSS, MIN_SAVING};
use crate::TrainError;
use crate::metrics::{masked_psnr, psnr};
use crate::train::optimizer::to_host;
use crate::train::statistics::{largest_shares, spread};
use crate::train::trainer::Trainer;

/// Largest share of the Gaussians that is tried at once.
const MOST: f64 = 0.6;
/// Halvings of the range in which the share lies.
const ROUNDS: usize = 5;

/// Most training views that are asked what they show of each Gaussian.
const RANKING_VIEWS: usize = 256;
/// Most training views on which a scene is scored.
const SCORED_VIEWS: usize = 64;

/// How a scene without a part does, against the scene with it.
pub(super) struct Outcome {
    pub(super) mean: f64,
    pub(super) lower: f64,
}

impl Outcome {
    pub(super) fn is_harmless(&self) -> bool {
        self.lower > -MAX_LOSS
    }
}

/// PSNR of a scene on training views, over the pixels that count, dB.
fn scores(trainer: &Trainer, scene: &DynamicScene) -> Result<Vec<f64>, TrainError> {
    let mut scores = Vec::new();
    for view in spread(trainer, SCORED_VIEWS) {
        let image = to_host(scene.render(&view.camera, view.time)?.rgb().detach());
        let (truth, counted) = view.rgb_and_counted(scene.settings.background)?;
        scores.extend(match counted {
            None => Some(psnr(&image, &truth)),
            Some(counted) => {
                let counts: Vec<bool> = counted.iter().map(|&c| c > 0.0).collect();
                masked_psnr(&image, &truth, &counts)
            }
        });
    }
    Ok(scores)
}

/// A scene without a part against the scene with it.
pub(super) fn against(
    trainer: &Trainer,
    with: &DynamicScene,
    without: &DynamicScene,
) -> Result<Outcome, TrainError> {
    Ok(compare(&scores(trainer, with)?, &scores(trainer, without)?))
}

fn compare(with: &[f64], without: &[f64]) -> Outcome {
    let n = with.len().max(1) as f64;
    let changes = || {
        with.iter()
            .zip(without)
            .map(|(with, without)| without - with)
    };
    let mean = changes().sum::<f64>() / n;
    let variance = changes().map(|c| (c - mean).powi(2)).sum::<f64>() / (n - 1.0).max(1.0);
    Outcome {
        mean,
        lower: mean - 2.0 * (variance / n).sqrt(),
    }
}

/// Gaussians that the pictures hardly show: as many as can go without harm.
pub(super) fn gaussians(
    trainer: &Trainer,
    scene: DynamicScene,
) -> Result<(DynamicScene, Decision), TrainError> {
    let with = scores(trainer, &scene)?;
    let shares = largest_shares(trainer, spread(trainer, RANKING_VIEWS))?;
    // What no view shows may be shown by one that was not asked.
    let all_asked = trainer.train_views.len() <= RANKING_VIEWS;
    let mut order: Vec<usize> = (0..shares.len())
        .filter(|&row| all_asked || shares[row] > 0.0)
        .collect();
    order.sort_by(|&a, &b| shares[a].total_cmp(&shares[b]).then(a.cmp(&b)));
    let (mut low, mut high) = (0.0, MOST);
    let mut best: Option<(DynamicScene, usize, Outcome)> = None;
    let mut worst = None;
    for round in 0..ROUNDS {
        let share = if round == 0 { MOST } else { 0.5 * (low + high) };
        let gone = (share * order.len() as f64) as usize;
        let mut stays = vec![true; shares.len()];
        for &row in &order[..gone] {
            stays[row] = false;
        }
        let without = reduced(&scene, &stays);
        let outcome = compare(&with, &scores(trainer, &without)?);
        if outcome.is_harmless() {
            low = share;
            best = Some((without, gone, outcome));
            if share == MOST {
                break;
            }
        } else {
            high = share;
            worst = Some(outcome);
        }
    }
    let mut decision = Decision::new(trainer, "Gaussians that the pictures hardly show");
    let Some((without, gone, outcome)) = best else {
        decision.reason = format!(
            "even {:.0} % fewer cost more than {MAX_LOSS} dB",
            100.0 * high
        );
        if let Some(outcome) = worst {
            decision.measured(&outcome);
        }
        return Ok((scene, decision));
    };
    decision.left_out = gone as f64 >= MIN_SAVING * shares.len() as f64;
    decision.reason = format!("{gone} of {} can go for at most {MAX_LOSS} dB", order.len());
    decision.measured(&outcome);
    decision.bytes = Some((parameter_bytes(&scene) - parameter_bytes(&without)) as u64);
    let scene = if decision.left_out { without } else { scene };
    Ok((scene, decision))
}

fn rows_that(stays: &[bool]) -> Vec<usize> {
    (0..stays.len()).filter(|&row| stays[row]).collect()
}

/// The scene with some of its Gaussians, static rows first.
fn reduced(scene: &DynamicScene, stays: &[bool]) -> DynamicScene {
    let device = scene.static_set.means.device();
    let (of_static, of_dynamic) = stays.split_at(scene.static_set.len());
    let mut scene = scene.clone();
    let gathered = |set: &Gaussians, stays: &[bool]| {
        Gaussians::from_rows(&set.to_rows().gather(&rows_that(stays)), &device)
    };
    scene.static_set = gathered(&scene.static_set, of_static);
    if let Some(dynamic) = &mut scene.dynamic {
        dynamic.gaussians = gathered(&dynamic.gaussians, of_dynamic);
    }
    scene
}

/// Colour that depends on the direction.
pub(super) fn directions(
    trainer: &Trainer,
    scene: DynamicScene,
) -> Result<(DynamicScene, Decision), TrainError> {
    let device = scene.static_set.means.device();
    let flatten = |set: &Gaussians| {
        let mut rows = set.to_rows();
        rows.sh_rest.clear();
        rows.sh_rest_width = 0;
        Gaussians::from_rows(&rows, &device)
    };
    let mut plain = scene.clone();
    plain.static_set = flatten(&plain.static_set);
    if let Some(dynamic) = &mut plain.dynamic {
        dynamic.gaussians = flatten(&dynamic.gaussians);
    }
    plain.settings.sh_degree = 0;
    let outcome = against(trainer, &scene, &plain)?;
    let total = parameter_bytes(&scene);
    let saved = total - parameter_bytes(&plain);
    let mut decision = Decision::new(trainer, "colour that depends on the direction");
    decision.left_out = outcome.is_harmless() && saved as f64 >= MIN_SAVING * total as f64;
    decision.reason = format!("may cost at most {MAX_LOSS} dB");
    decision.measured(&outcome);
    decision.bytes = Some(saved as u64);
    let scene = if decision.left_out { plain } else { scene };
    Ok((scene, decision))
}

/// The scene with its field's tables rounded to half their bits, and whether it may be; `None` without
/// tables.
pub(super) fn table_bits(
    trainer: &Trainer,
    scene: &DynamicScene,
) -> Result<Option<(DynamicScene, Decision)>, TrainError> {
    let Some(rounded) = scene.with_half_tables() else {
        return Ok(None);
    };
    let outcome = against(trainer, scene, &rounded)?;
    let saved = scene.table_bytes() / 2;
    let mut decision = Decision::new(trainer, "half the bits of the field's tables");
    decision.left_out =
        outcome.is_harmless() && saved as f64 >= MIN_SAVING * parameter_bytes(scene) as f64;
    decision.reason = format!("as 16-bit floats they may cost at most {MAX_LOSS} dB");
    decision.measured(&outcome);
    decision.bytes = Some(saved);
    Ok(Some((rounded, decision)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_loss_is_judged_by_its_lower_bound() {
        let with = [30.0; 4];
        let same = compare(&with, &with);
        assert_eq!((same.mean, same.lower), (0.0, 0.0));
        assert!(same.is_harmless());
        // A mean of no loss that one view in four pays for.
        let uneven = compare(&with, &[30.3, 30.3, 30.3, 29.1]);
        assert!(uneven.mean.abs() < 1e-9 && !uneven.is_harmless());
        assert!(!compare(&with, &[29.98; 4]).is_harmless());
        assert!(compare(&with, &[29.99; 4]).is_harmless());
    }
}
