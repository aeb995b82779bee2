//! Trials when training is over: the scene without a part, on training views, against the scene with
//! it.

use burn::module::Module;
use dash_model::scene_file::{TablePrecision, parameter_bytes};
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

/// A trained scene from which parts are left out one after the other.
pub(super) struct Trials<'a> {
    trainer: &'a Trainer,
    /// What is left so far.
    pub(super) scene: DynamicScene,
    /// Its scores.
    scores: Vec<f64>,
    /// What was decided.
    pub(super) decisions: Vec<Decision>,
}

impl<'a> Trials<'a> {
    /// All of a trainer's scene.
    pub(super) fn new(trainer: &'a Trainer) -> Result<Self, TrainError> {
        // Without the graph that gradients need.
        let scene = trainer.scene.valid();
        Ok(Self {
            trainer,
            scores: scores(trainer, &scene)?,
            scene,
            decisions: Vec::new(),
        })
    }

    /// Goes on with `without`, if that loses nothing and saves enough; whether it does.
    fn judge(
        &mut self,
        part: &str,
        reason: String,
        (without, bytes): (DynamicScene, usize),
    ) -> Result<bool, TrainError> {
        let scores = scores(self.trainer, &without)?;
        Ok(self.judge_scored(part, reason, (without, bytes), scores))
    }

    /// The same where `without` has been scored.
    fn judge_scored(
        &mut self,
        part: &str,
        reason: String,
        (without, bytes): (DynamicScene, usize),
        scores: Vec<f64>,
    ) -> bool {
        let outcome = compare(&self.scores, &scores);
        let mut decision = Decision::new(self.trainer, part);
        let enough = MIN_SAVING * parameter_bytes(&self.scene) as f64;
        decision.left_out = outcome.is_harmless() && bytes as f64 >= enough;
        decision.reason = reason;
        decision.measured(&outcome);
        decision.bytes = Some(bytes as u64);
        let left_out = decision.left_out;
        if left_out {
            (self.scene, self.scores) = (without, scores);
        }
        self.decisions.push(decision);
        left_out
    }

    /// Gaussians that the pictures hardly show: as many as can go without harm.
    pub(super) fn gaussians(&mut self) -> Result<(), TrainError> {
        let views = spread(self.trainer, RANKING_VIEWS);
        let shares = largest_shares(self.trainer, views)?;
        // What no view shows may be shown by one that was not asked.
        let all_asked = self.trainer.train_views.len() <= RANKING_VIEWS;
        let mut order: Vec<usize> = (0..shares.len())
            .filter(|&row| all_asked || shares[row] > 0.0)
            .collect();
        order.sort_by(|&a, &b| shares[a].total_cmp(&shares[b]).then(a.cmp(&b)));
        let (mut low, mut high, mut share) = (0.0, MOST, MOST);
        // The largest share that is harmless; while none is, the last that was tried.
        let mut tried = None;
        for _ in 0..ROUNDS {
            let gone = (share * order.len() as f64) as usize;
            let mut stays = vec![true; shares.len()];
            for &row in &order[..gone] {
                stays[row] = false;
            }
            let without = reduced(&self.scene, &stays);
            let scored = scores(self.trainer, &without)?;
            let harmless = compare(&self.scores, &scored).is_harmless();
            if harmless || low == 0.0 {
                tried = Some((gone, without, scored));
            }
            if harmless {
                low = share;
            } else {
                high = share;
            }
            if low == MOST {
                break;
            }
            share = 0.5 * (low + high);
        }
        let Some((gone, without, scored)) = tried else {
            return Ok(());
        };
        let bytes = parameter_bytes(&self.scene) - parameter_bytes(&without);
        let reason = format!(
            "{gone} of {}, the least shown; they may cost at most {MAX_LOSS} dB",
            shares.len()
        );
        let part = "Gaussians that the pictures hardly show";
        self.judge_scored(part, reason, (without, bytes), scored);
        Ok(())
    }

    /// Colour that depends on the direction.
    pub(super) fn directions(&mut self) -> Result<(), TrainError> {
        if self.scene.static_set.sh_degree() == 0 {
            return Ok(());
        }
        let device = self.scene.static_set.means.device();
        let flatten = |set: &Gaussians| {
            let mut rows = set.to_rows();
            rows.sh_rest.clear();
            rows.sh_rest_width = 0;
            Gaussians::from_rows(&rows, &device)
        };
        let mut plain = self.scene.clone();
        plain.static_set = flatten(&plain.static_set);
        if let Some(dynamic) = &mut plain.dynamic {
            dynamic.gaussians = flatten(&dynamic.gaussians);
        }
        plain.settings.sh_degree = 0;
        let bytes = parameter_bytes(&self.scene) - parameter_bytes(&plain);
        let part = "colour that depends on the direction";
        self.judge(part, may_cost(), (plain, bytes))?;
        Ok(())
    }

    /// Half the bits of the field's tables: the scene is then rounded to them.
    pub(super) fn table_bits(&mut self) -> Result<TablePrecision, TrainError> {
        let Some(rounded) = self.scene.with_half_tables() else {
            return Ok(TablePrecision::Single);
        };
        let bytes = self.scene.table_bytes() as usize / 2;
        let part = "half the bits of the field's tables";
        Ok(match self.judge(part, may_cost(), (rounded, bytes))? {
            true => TablePrecision::Half,
            false => TablePrecision::Single,
        })
    }
}

fn may_cost() -> String {
    format!("may cost at most {MAX_LOSS} dB")
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
    // A field that moves nothing is not kept.
    scene.dynamic = scene.dynamic.filter(|d| !d.gaussians.is_empty());
    scene
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
