//! The parts that a trained scene may do without.

use std::collections::BTreeSet;

use dash_model::scene_file::TablePrecision;
use dash_model::{DynamicPart, DynamicScene, Gaussians, Head, Representation};

use super::trials::{Candidate, Trials};
use crate::Error;
use crate::train::core::Decision;
use crate::train::core::visibility::{largest_shares, spread};

/// Largest share of the Gaussians that is tried at once.
const MOST_GAUSSIANS: f64 = 0.6;
/// Largest share of the Gaussians that is tried without a colour that depends on the direction, when all
/// of them can't do without.
const MOST_PLAIN: f64 = 0.95;
/// Training views that are asked what they show of each Gaussian: one for so many steps.
const STEPS_PER_RANKING_VIEW: usize = 25;
/// Least and most of them.
const RANKING_VIEWS: (usize, usize) = (32, 256);
/// Most times at which a field is asked what it does on average.
const TIMES: usize = 32;

/// Gaussians that the pictures hardly show: as many as can go without harm. How much the pictures show of
/// each of the others, static ones first.
pub(super) fn gaussians(trials: &mut Trials) -> Result<Vec<f32>, Error> {
    let (least, most) = RANKING_VIEWS;
    let n_views = (trials.run.step / STEPS_PER_RANKING_VIEW).clamp(least, most);
    let views = spread(trials.run, n_views);
    let shares = largest_shares(trials.run, views)?;
    // What no view shows may be shown by one that was not asked.
    let all_asked = trials.run.train_views.len() <= n_views;
    let mut order: Vec<usize> = (0..shares.len())
        .filter(|&row| all_asked || shares[row] > 0.0)
        .collect();
    order.sort_by(|&a, &b| shares[a].total_cmp(&shares[b]).then(a.cmp(&b)));
    let all_but = |gone: usize| {
        let mut stays = vec![true; shares.len()];
        for &row in &order[..gone] {
            stays[row] = false;
        }
        stays
    };
    let without = |gone: usize| reduced(&trials.scene, &all_but(gone));
    let largest = trials.largest_share(MOST_GAUSSIANS, order.len(), without)?;
    let Some((gone, scene, scores)) = largest else {
        return Ok(shares);
    };
    let candidate = Candidate {
        part: "Gaussians that the pictures hardly show".into(),
        reason: format!(
            "{gone} of {}, the least shown; {}",
            shares.len(),
            trials.may_cost()
        ),
        scene,
        precision: trials.precision,
        arithmetic: 0.0,
    };
    Ok(match trials.judge_scored(candidate, scores) {
        true => {
            let kept = shares.iter().zip(all_but(gone));
            kept.filter(|(_, stays)| *stays).map(|(s, _)| *s).collect()
        }
        false => shares,
    })
}

/// The field's heads for rotations, scales, and opacities and colours.
pub(super) fn heads(trials: &mut Trials) -> Result<(), Error> {
    for (head, name) in [
        (Head::Rotation, "rotations"),
        (Head::Scale, "scales"),
        (Head::Appearance, "opacities and colours"),
    ] {
        let Some(dynamic) = &trials.scene.dynamic else {
            return Ok(());
        };
        let heads = dynamic.field.config().heads;
        if !(match head {
            Head::Rotation => heads.rotation,
            Head::Scale => heads.scale,
            // Higher coefficients go with the constant ones.
            Head::Appearance => heads.appearance && heads.sh_rest == 0,
        }) {
            continue;
        }
        let part = dynamic.without_head(&trials.scene.settings, head, &times(trials))?;
        let candidate = Candidate {
            part: format!("the field's head for {name}"),
            ..with_field(trials, part)
        };
        trials.judge(candidate)?;
    }
    Ok(())
}

/// Levels of the field's hash grid: each is tried by itself, then those that can go are left out, the
/// least missed first.
pub(super) fn levels(trials: &mut Trials) -> Result<(), Error> {
    let Some(whole) = trials.scene.dynamic.clone() else {
        return Ok(());
    };
    let config = whole.field.config();
    if config.representation != Representation::Hash {
        return Ok(());
    }
    let layout = config.encoder.layout()?;
    if layout.n_levels() == 1 {
        return Ok(());
    }
    let typical = whole.mean_features(&times(trials))?;
    let mut effects = Vec::new();
    for level in 0..layout.n_levels() {
        let part = whole.without_levels(&[level], &typical)?;
        effects.push(trials.effect(&with_field(trials, part).scene)?);
    }
    let by_itself: Vec<String> = effects
        .iter()
        .map(|effect| format!("{:+.3}", effect.mean))
        .collect();
    let mut order: Vec<usize> = (0..effects.len())
        .filter(|&level| effects[level].is_harmless)
        .collect();
    order.sort_by(|&a, &b| effects[b].mean.total_cmp(&effects[a].mean));
    // One level has to stay.
    order.truncate(layout.n_levels() - 1);
    let mut left_out = Vec::new();
    for level in order {
        let tried: Vec<usize> = left_out.iter().copied().chain([level]).collect();
        let sizes = layout.levels()[level];
        let cells: Vec<String> = sizes.resolution[..layout.dims()]
            .iter()
            .map(|vertices| (vertices - 1).to_string())
            .collect();
        let part = whole.without_levels(&tried, &typical)?;
        let without = with_field(trials, part);
        let candidate = Candidate {
            part: format!("level {level} of the field's grid"),
            reason: format!(
                "{} cells, {} entries, {}",
                cells.join(" x "),
                sizes.size,
                without.reason
            ),
            ..without
        };
        let scores = match left_out.is_empty() {
            true => effects[level].scores.clone(),
            false => trials.score(&candidate.scene)?,
        };
        if trials.judge_scored(candidate, scores) {
            left_out.push(level);
        }
    }
    if left_out.is_empty() {
        trials.decisions.push(Decision {
            reason: format!(
                "without each by itself, coarse to fine: {} dB; {}",
                by_itself.join(", "),
                trials.may_cost()
            ),
            ..Decision::kept(trials.run.step, "levels of the field's grid")
        });
    }
    Ok(())
}

/// Colour that depends on the direction: of all Gaussians, or else of those where it shows least, given how
/// much the pictures show of each.
pub(super) fn directions(trials: &mut Trials, shares: &[f32]) -> Result<(), Error> {
    let width = 3 * trials.scene.static_set.sh_rest.dims()[1];
    if width == 0 {
        return Ok(());
    }
    let mut scene = trials.scene.clone();
    scene.settings.sh_degree = 0;
    for_each_set(&mut scene, |set, _| {
        let mut rows = set.to_rows();
        rows.sh_rest.clear();
        rows.sh_rest_width = 0;
        *set = Gaussians::from_rows(&rows, &set.means.device());
    });
    if let Some(dynamic) = &mut scene.dynamic {
        dynamic.field = dynamic.field.without_sh_rest();
    }
    let plain = Candidate {
        part: "colour that depends on the direction".into(),
        reason: trials.may_cost(),
        scene,
        precision: trials.precision,
        arithmetic: 0.0,
    };
    if trials.judge(plain)? {
        return Ok(());
    }
    let mut shown = shares.to_vec();
    let mut coefficients = Vec::new();
    for_each_set(&mut trials.scene.clone(), |set, _| {
        coefficients.extend(set.to_rows().sh_rest);
    });
    for (shown, row) in shown.iter_mut().zip(coefficients.chunks_exact(width)) {
        *shown *= row.iter().map(|c| c * c).sum::<f32>().sqrt();
    }
    let n = shown.len();
    let mut order: Vec<usize> = (0..n).collect();
    order.sort_by(|&a, &b| shown[a].total_cmp(&shown[b]).then(a.cmp(&b)));
    let without = |gone: usize| {
        let mut plain = vec![false; n];
        for &row in &order[..gone] {
            plain[row] = true;
        }
        let mut scene = trials.scene.clone();
        for_each_set(&mut scene, |set, first| {
            let mut rows = set.to_rows();
            for (row, plain) in rows.sh_rest.chunks_exact_mut(width).zip(&plain[first..]) {
                if *plain {
                    row.fill(0.0);
                }
            }
            *set = Gaussians::from_rows(&rows, &set.means.device());
        });
        scene
    };
    let Some((gone, scene, scores)) = trials.largest_share(MOST_PLAIN, n, without)? else {
        return Ok(());
    };
    let candidate = Candidate {
        part: "colour that depends on the direction, where it shows least".into(),
        reason: format!("{gone} of {n} Gaussians; {}", trials.may_cost()),
        scene,
        precision: trials.precision,
        arithmetic: 0.0,
    };
    trials.judge_scored(candidate, scores);
    Ok(())
}

/// Entries of the field's tables that no Gaussian reads, at whatever time: without them nothing changes.
pub(super) fn unread_entries(trials: &mut Trials) -> Result<(), Error> {
    let dynamic = trials.scene.dynamic.as_ref();
    let Some((part, [n_read, n_entries])) = dynamic.and_then(DynamicPart::without_unread) else {
        return Ok(());
    };
    let mut scene = trials.scene.clone();
    scene.dynamic = Some(part);
    let candidate = Candidate {
        part: "entries of the field's tables that no Gaussian reads".into(),
        reason: format!(
            "{n_read} of {n_entries} are read at some time; {}",
            trials.may_cost()
        ),
        scene,
        precision: trials.precision,
        arithmetic: 0.0,
    };
    trials.judge(candidate)?;
    Ok(())
}

/// Half the bits of the field's tables: the scene is then rounded to them.
pub(super) fn table_bits(trials: &mut Trials) -> Result<(), Error> {
    let Some(scene) = trials.scene.with_half_tables() else {
        return Ok(());
    };
    let candidate = Candidate {
        part: "half the bits of the field's tables".into(),
        reason: trials.may_cost(),
        scene,
        precision: TablePrecision::Half,
        arithmetic: 0.0,
    };
    trials.judge(candidate)?;
    Ok(())
}

/// Some of the times of training views, in order.
fn times(trials: &Trials) -> Vec<f32> {
    let run = trials.run;
    let views = run.train_views.iter().map(|&v| &run.dataset.views[v]);
    // Times are not negative, so that their bits are in their order.
    let times: BTreeSet<u32> = views.map(|view| view.time.to_bits()).collect();
    let times: Vec<f32> = times.into_iter().map(f32::from_bits).collect();
    let n = times.len().min(TIMES);
    (0..n).map(|k| times[k * times.len() / n]).collect()
}

/// The scene with another dynamic part, and what that saves.
fn with_field(trials: &Trials, part: DynamicPart) -> Candidate {
    let mut scene = trials.scene.clone();
    let before = scene.dynamic.replace(part);
    let arithmetic = |part: &DynamicPart| part.field.config().multiplications() as f64;
    let saved = match (&before, &scene.dynamic) {
        (Some(before), Some(after)) => 1.0 - arithmetic(after) / arithmetic(before).max(1.0),
        _ => 0.0,
    };
    Candidate {
        part: String::new(),
        reason: format!(
            "{:.1} % of the field's arithmetic; {}",
            1e2 * saved,
            trials.may_cost()
        ),
        scene,
        precision: trials.precision,
        arithmetic: saved,
    }
}

/// Goes through the sets of Gaussians, with the number of the first of each, as [`largest_shares`] counts
/// them.
fn for_each_set(scene: &mut DynamicScene, mut change: impl FnMut(&mut Gaussians, usize)) {
    let n_static = scene.static_set.len();
    change(&mut scene.static_set, 0);
    if let Some(dynamic) = &mut scene.dynamic {
        change(&mut dynamic.gaussians, n_static);
    }
}

/// The scene with some of its Gaussians, static rows first.
fn reduced(scene: &DynamicScene, stays: &[bool]) -> DynamicScene {
    let mut scene = scene.clone();
    for_each_set(&mut scene, |set, first| {
        let kept: Vec<usize> = (0..set.len()).filter(|row| stays[first + row]).collect();
        *set = Gaussians::from_rows(&set.to_rows().gather(&kept), &set.means.device());
    });
    // A field that moves nothing is not kept.
    scene.dynamic = scene.dynamic.filter(|d| !d.gaussians.is_empty());
    scene
}
