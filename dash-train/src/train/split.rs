//! Stage changes: motion field on, split into static and dynamic, and its review.

use dash_model::decomposition::MotionStatistics;
use dash_model::{DeformationField, DynamicPart, GaussianRows, Gaussians, MotionField, SpaceBox};

use super::coarse;
use super::config::SpaceRule;
use super::density::DensityStatistics;
use super::optimizer::to_host;
use super::statistics;
use super::trainer::{DYNAMIC, STATIC, Trainer};
use crate::TrainError;

/// Share of the points on either side that a field's box may leave out.
const BOX_TAIL: f32 = 0.01;
/// How much wider than its points a field's box is.
const BOX_MARGIN: f32 = 0.15;
/// Pixels' worth of a dynamic Gaussian that some picture must show.
const MIN_SHARE: f32 = 0.1;
/// Times at which a review looks where a Gaussian is.
const REVIEW_TIMES: usize = 12;

/// Starts the decomposition stage.
pub(crate) fn start_motion(trainer: &mut Trainer) -> Result<(), TrainError> {
    let rows = trainer.scene.static_set.to_rows();
    let config = &trainer.config.decomposition;
    let space = match trainer.config.field.space {
        SpaceRule::Fixed(bound) => SpaceBox::fixed(bound),
        SpaceRule::Scene => trainer.core.space,
    };
    trainer.motion = Some(MotionField::new(
        &config.encoder,
        config.hidden,
        config.basis,
        space,
        &mut trainer.rng,
        &trainer.device,
    )?);
    trainer.motion_space = Some(space);
    trainer.motion_statistics = MotionStatistics::new(rows.len());
    trainer.held_still = vec![true; rows.len()];
    Ok(())
}

/// Ends it: the Gaussians that move become the dynamic part.
pub(crate) fn split(trainer: &mut Trainer) -> Result<(), TrainError> {
    let Some(coefficients) = coarse::coefficients(trainer)? else {
        return Ok(());
    };
    let mask = statistics::moving(trainer)?;
    let width = coefficients.dims()[1];
    let coefficients = to_host(coefficients);
    trainer.motion = None;
    trainer.motion_space = None;
    trainer.optimizer.forget("motion.");
    let mut rows = trainer.scene.static_set.to_rows();
    rows.trajectory_width = 0;
    rows.trajectories.clear();
    let (moving, still): (Vec<usize>, Vec<usize>) = (0..rows.len()).partition(|&row| mask[row]);
    trainer.scene.static_set = Gaussians::from_rows(&rows.gather(&still), &trainer.device);
    if moving.is_empty() {
        trainer.optimizer.forget(&format!("{STATIC}trajectories"));
        return Ok(());
    }
    let mut dynamic_rows = rows.gather(&moving);
    if trainer.config.decomposition.keep_trajectories {
        dynamic_rows.trajectory_width = width;
        dynamic_rows.trajectories = dash_model::gather_rows(&coefficients, width, &moving);
    }
    trainer
        .optimizer
        .copy_rows(STATIC, DYNAMIC, &moving, rows.len());
    trainer
        .optimizer
        .edit_rows(STATIC, &still, &vec![false; still.len()], rows.len());
    trainer.optimizer.forget(&format!("{STATIC}trajectories"));
    let space = space_for(trainer.config.field.space, &dynamic_rows.means);
    let field = DeformationField::new(
        &trainer.config.field.deformation,
        space,
        &mut trainer.rng,
        &trainer.device,
    )?;
    trainer.scene.dynamic = Some(DynamicPart {
        gaussians: Gaussians::from_rows(&dynamic_rows, &trainer.device),
        field,
    });
    trainer.density_static = DensityStatistics::new(still.len());
    trainer.density_dynamic = DensityStatistics::new(moving.len());
    trainer.motion_statistics = MotionStatistics::default();
    trainer.held_still = Vec::new();
    if trainer.config.decomposition.review_interval > 0 {
        drop_hidden(trainer)?;
    }
    Ok(())
}

/// Removes dynamic Gaussians that no picture shows, such as those that strayed behind a wall.
pub(crate) fn drop_hidden(trainer: &mut Trainer) -> Result<(), TrainError> {
    let shares = statistics::largest_shares(trainer)?;
    let (shown, hidden): (Vec<usize>, Vec<usize>) =
        (0..shares.len()).partition(|&row| shares[row] >= MIN_SHARE);
    if !hidden.is_empty() {
        keep_dynamic(trainer, &shown);
    }
    Ok(())
}

/// Keeps these dynamic Gaussians only; without any, no dynamic part.
fn keep_dynamic(trainer: &mut Trainer, stay: &[usize]) {
    let (_, n) = trainer.scene.counts();
    if stay.is_empty() {
        trainer.optimizer.forget("scene.dynamic.");
        trainer.scene.dynamic = None;
        trainer.density_dynamic = DensityStatistics::new(0);
    } else if let Some(dynamic) = &mut trainer.scene.dynamic {
        let rows: GaussianRows = dynamic.gaussians.to_rows().gather(stay);
        dynamic.gaussians = Gaussians::from_rows(&rows, &trainer.device);
        trainer.density_dynamic = trainer.density_dynamic.gather(stay);
        trainer
            .optimizer
            .edit_rows(DYNAMIC, stay, &vec![false; stay.len()], n);
    }
}

/// Removes dynamic Gaussians that no picture shows, and moves those that stay in place over the clip to the static set, as they look in the
/// middle of it.
pub(crate) fn review(trainer: &mut Trainer) -> Result<(), TrainError> {
    drop_hidden(trainer)?;
    let Some(dynamic) = trainer
        .scene
        .dynamic
        .as_ref()
        .filter(|d| !d.gaussians.is_empty())
    else {
        return Ok(());
    };
    let n = dynamic.gaussians.len();
    let settings = &trainer.scene.settings;
    let mut low = vec![[f32::INFINITY; 3]; n];
    let mut high = vec![[f32::NEG_INFINITY; 3]; n];
    for k in 0..REVIEW_TIMES {
        let time = k as f32 / (REVIEW_TIMES - 1) as f32;
        let means = to_host(dynamic.deform(settings, time)?.means.detach());
        for (row, mean) in means.chunks_exact(3).enumerate() {
            for axis in 0..3 {
                low[row][axis] = low[row][axis].min(mean[axis]);
                high[row][axis] = high[row][axis].max(mean[axis]);
            }
        }
    }
    let centres: Vec<[f32; 3]> = low
        .iter()
        .zip(&high)
        .map(|(l, h)| std::array::from_fn(|axis| 0.5 * (l[axis] + h[axis])))
        .collect();
    let screen = screen_scale(trainer, &centres);
    let floor = trainer.config.decomposition.review_floor;
    let moves = |row: usize| {
        let range = (0..3)
            .map(|a| (high[row][a] - low[row][a]).powi(2))
            .sum::<f32>()
            .sqrt();
        // What is not finite is left to density control, which removes it.
        !range.is_finite() || range * screen[row] >= floor
    };
    let (stay, leave): (Vec<usize>, Vec<usize>) = (0..n).partition(|&row| moves(row));
    if leave.is_empty() {
        return Ok(());
    }
    let frozen = trainer.scene.at(0.5)?;
    let n_static = trainer.scene.static_set.len();
    let mut leaving = frozen.gather(&leave.iter().map(|&row| n_static + row).collect::<Vec<_>>());
    for (mean, &row) in leaving.means.iter_mut().zip(&leave) {
        *mean = centres[row];
    }
    let mut static_rows = trainer.scene.static_set.to_rows();
    static_rows.append(&leaving);
    trainer.optimizer.extend_rows(STATIC, n_static, leave.len());
    trainer.scene.static_set = Gaussians::from_rows(&static_rows, &trainer.device);
    trainer.density_static.grow(leave.len());
    keep_dynamic(trainer, &stay);
    Ok(())
}

/// Shares of the image's width that a world unit takes at each point, median over the training
/// views that have it in front of them.
fn screen_scale(trainer: &Trainer, points: &[[f32; 3]]) -> Vec<f32> {
    const VIEWS: usize = 16;
    let stride = trainer.train_views.len().div_ceil(VIEWS).max(1);
    let cameras: Vec<_> = trainer
        .train_views
        .iter()
        .step_by(stride)
        .map(|&view| &trainer.dataset.views[view].camera)
        .collect();
    points
        .iter()
        .map(|point| {
            let mut scales: Vec<f32> = cameras
                .iter()
                .filter_map(|camera| {
                    let depth = camera.transform(point.map(f64::from))[2];
                    (depth > 1e-6).then(|| (camera.fx / (depth * camera.width as f64)) as f32)
                })
                .collect();
            scales.sort_by(f32::total_cmp);
            scales
                .get(scales.len() / 2)
                .copied()
                .unwrap_or(f32::INFINITY)
        })
        .collect()
}

fn space_for(rule: SpaceRule, means: &[[f32; 3]]) -> SpaceBox {
    match rule {
        SpaceRule::Fixed(bound) => SpaceBox::fixed(bound),
        SpaceRule::Scene => SpaceBox::around(means, BOX_TAIL, BOX_MARGIN),
    }
}
