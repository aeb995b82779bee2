//! Trials once the sets have grown: the scene without a part, on training views, against the scene
//! with it.

use dash_model::scene_file::parameter_bytes;
use dash_model::{DynamicScene, GaussianRows, Gaussians};

use super::{Decision, MAX_LOSS, MIN_SAVING};
use crate::TrainError;
use crate::metrics::psnr;
use crate::train::optimizer::to_host;
use crate::train::split::keep_dynamic;
use crate::train::statistics::{largest_shares, witnesses};
use crate::train::trainer::{DYNAMIC, STATIC, Trainer};

/// Largest share of the Gaussians that is tried at once.
const MOST: f64 = 0.6;
/// Halvings of the range in which the share lies.
const ROUNDS: usize = 5;

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

/// Tries to leave out Gaussians, then colour that depends on the direction.
pub(super) fn run(trainer: &mut Trainer) -> Result<(), TrainError> {
    let decision = gaussians(trainer)?;
    trainer.decisions.push(decision);
    if trainer.scene.static_set.sh_degree() > 0 {
        let decision = directions(trainer)?;
        trainer.decisions.push(decision);
    }
    Ok(())
}

/// PSNR of a scene on the witnesses, dB.
fn scores(trainer: &Trainer, scene: &DynamicScene) -> Result<Vec<f64>, TrainError> {
    witnesses(trainer)
        .map(|view| {
            let image = to_host(scene.render(&view.camera, view.time)?.rgb().detach());
            Ok(psnr(&image, &view.rgb(scene.settings.background)?))
        })
        .collect()
}

/// Another scene against the trainer's.
pub(super) fn against(trainer: &Trainer, other: &DynamicScene) -> Result<Outcome, TrainError> {
    let with = scores(trainer, &trainer.scene)?;
    Ok(compare(&with, &scores(trainer, other)?))
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
fn gaussians(trainer: &mut Trainer) -> Result<Decision, TrainError> {
    let with = scores(trainer, &trainer.scene)?;
    let shares = largest_shares(trainer)?;
    let mut order: Vec<usize> = (0..shares.len()).collect();
    order.sort_by(|&a, &b| shares[a].total_cmp(&shares[b]).then(a.cmp(&b)));
    let (mut low, mut high) = (0.0, MOST);
    let mut best: Option<(Vec<bool>, Outcome)> = None;
    let mut last = None;
    for round in 0..ROUNDS {
        let share = if round == 0 { MOST } else { 0.5 * (low + high) };
        let mut stays = vec![true; order.len()];
        for &row in &order[..(share * order.len() as f64) as usize] {
            stays[row] = false;
        }
        let outcome = compare(&with, &scores(trainer, &reduced(&trainer.scene, &stays))?);
        if outcome.is_harmless() {
            low = share;
            best = Some((stays, outcome));
            if share == MOST {
                break;
            }
        } else {
            high = share;
            last = Some(outcome);
        }
    }
    let total = parameter_bytes(&trainer.scene) as u64;
    let mut decision = Decision {
        step: trainer.step,
        part: "Gaussians that the pictures hardly show".into(),
        left_out: false,
        reason: String::new(),
        db: None,
        db_lower: None,
        bytes: None,
    };
    let Some((stays, outcome)) = best else {
        decision.reason = format!(
            "without the least shown {:.0} % too much is lost",
            100.0 * high
        );
        (decision.db, decision.db_lower) =
            last.map_or((None, None), |o| (Some(o.mean), Some(o.lower)));
        return Ok(decision);
    };
    let saved = total - parameter_bytes(&reduced(&trainer.scene, &stays)) as u64;
    let gone = stays.iter().filter(|stays| !**stays).count();
    decision.left_out = gone as f64 >= MIN_SAVING * stays.len() as f64;
    decision.reason = format!(
        "{gone} of {} can go: the most that costs no more than {MAX_LOSS} dB",
        stays.len()
    );
    (decision.db, decision.db_lower) = (Some(outcome.mean), Some(outcome.lower));
    decision.bytes = Some(saved);
    if decision.left_out {
        remove(trainer, &stays);
    }
    Ok(decision)
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

fn remove(trainer: &mut Trainer, stays: &[bool]) {
    let n_static = trainer.scene.static_set.len();
    let (of_static, of_dynamic) = stays.split_at(n_static);
    let rows = rows_that(of_static);
    let kept: GaussianRows = trainer.scene.static_set.to_rows().gather(&rows);
    trainer.scene.static_set = Gaussians::from_rows(&kept, &trainer.device);
    trainer.density_static = trainer.density_static.gather(&rows);
    let fresh = vec![false; rows.len()];
    trainer.optimizer.edit_rows(STATIC, &rows, &fresh, n_static);
    if trainer.scene.dynamic.is_some() {
        keep_dynamic(trainer, &rows_that(of_dynamic));
    }
}

/// Colour that depends on the direction.
fn directions(trainer: &mut Trainer) -> Result<Decision, TrainError> {
    let mut plain = trainer.scene.clone();
    let device = trainer.device.clone();
    let flatten = |set: &Gaussians| {
        let mut rows = set.to_rows();
        rows.sh_rest.clear();
        rows.sh_rest_width = 0;
        Gaussians::from_rows(&rows, &device)
    };
    plain.static_set = flatten(&plain.static_set);
    if let Some(dynamic) = &mut plain.dynamic {
        dynamic.gaussians = flatten(&dynamic.gaussians);
    }
    plain.settings.sh_degree = 0;
    let outcome = against(trainer, &plain)?;
    let total = parameter_bytes(&trainer.scene);
    let saved = total - parameter_bytes(&plain);
    let left_out = outcome.is_harmless() && saved as f64 >= MIN_SAVING * total as f64;
    if left_out {
        trainer.scene = plain;
        trainer.config.sh_degree = 0;
        for set in [STATIC, DYNAMIC] {
            trainer.optimizer.forget(&format!("{set}sh_rest"));
        }
    }
    Ok(Decision {
        step: trainer.step,
        part: "colour that depends on the direction".into(),
        left_out,
        reason: format!("may cost at most {MAX_LOSS} dB"),
        db: Some(outcome.mean),
        db_lower: Some(outcome.lower),
        bytes: Some(saved as u64),
    })
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
        assert!(!compare(&with, &[29.97; 4]).is_harmless());
        assert!(compare(&with, &[29.99; 4]).is_harmless());
    }
}
