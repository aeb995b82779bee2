//! Stage changes: motion field on, split into static and dynamic.

use std::sync::Arc;

use dash_model::decomposition::MotionStatistics;
use dash_model::{
    DeformationField, DynamicPart, DynamicScene, GaussianRows, Gaussians, MotionField, SpaceBox,
};

use super::coarse;
use super::config::{Selection, SpaceRule};
use super::density::DensityStatistics;
use super::optimizer::to_host;
use super::statistics;
use super::trainer::{DYNAMIC, STATIC, Trainer};
use crate::Error;
use crate::dataset::Dataset;

/// Share of the points on either side that a field's box may leave out.
const BOX_TAIL: f32 = 0.01;
/// How much wider than its points a field's box is.
const BOX_MARGIN: f32 = 0.15;
/// Pixels' worth of a dynamic Gaussian that some picture must show.
const MIN_SHARE: f32 = 0.1;

/// Starts the decomposition stage.
pub(crate) fn start_motion(trainer: &mut Trainer) -> Result<(), Error> {
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

/// Ends it: the Gaussians that move, or all, become the dynamic part.
pub(crate) fn split(trainer: &mut Trainer) -> Result<(), Error> {
    let coefficients = coarse::coefficients(trainer)?;
    let mask = match (trainer.config.decomposition.select, &coefficients) {
        (Selection::All, _) => vec![true; trainer.scene.static_set.len()],
        (Selection::Moving, None) => return Ok(()),
        (Selection::Moving, Some(_)) => statistics::moving(trainer)?,
    };
    trainer.motion = None;
    trainer.found_places.clear();
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
    if let Some(coefficients) = coefficients
        && trainer.config.decomposition.keep_trajectories
    {
        let width = coefficients.dims()[1];
        let coefficients = to_host(coefficients);
        dynamic_rows.trajectory_width = width;
        dynamic_rows.trajectories = dash_model::gather_rows(&coefficients, width, &moving);
    }
    let deformation = &trainer.config.field.deformation;
    dynamic_rows.embedding_width = deformation.embedding_width();
    dynamic_rows.embeddings = vec![0.0; moving.len() * dynamic_rows.embedding_width];
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
    let (_, n) = trainer.scene.counts();
    let shown_at_once = coarse::shown_at_once(trainer.start_part);
    let density = &mut trainer.config.density_dynamic;
    density.after_split(n, shown_at_once);
    Ok(())
}

/// Puts a run that has not begun right behind the split, with this scene and with pictures of the same views, which
/// may be of another size.
pub(crate) fn continue_with(trainer: &mut Trainer, scene: DynamicScene, dataset: Arc<Dataset>) {
    let (n_static, n_dynamic) = scene.counts();
    trainer.density_static = DensityStatistics::new(n_static);
    trainer.density_dynamic = DensityStatistics::new(n_dynamic);
    trainer.step = coarse::Stages::of(trainer).end + 1;
    trainer.scene = scene;
    trainer.dataset = dataset;
}

/// Removes dynamic Gaussians that no picture shows, such as those that strayed behind a wall.
pub(crate) fn drop_hidden(trainer: &mut Trainer) -> Result<(), Error> {
    let (n_static, n_dynamic) = trainer.scene.counts();
    if n_dynamic == 0 {
        return Ok(());
    }
    let shares =
        statistics::largest_shares(trainer, statistics::witnesses(trainer))?.split_off(n_static);
    let (shown, hidden): (Vec<usize>, Vec<usize>) =
        (0..shares.len()).partition(|&row| shares[row] >= MIN_SHARE);
    if !hidden.is_empty() {
        keep_dynamic(trainer, &shown);
    }
    Ok(())
}

/// Keeps these dynamic Gaussians only; without any, no dynamic part.
pub(crate) fn keep_dynamic(trainer: &mut Trainer, stay: &[usize]) {
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

/// Keeps these static Gaussians only.
pub(crate) fn keep_static(trainer: &mut Trainer, stay: &[usize]) {
    let n = trainer.scene.static_set.len();
    let rows = trainer.scene.static_set.to_rows().gather(stay);
    trainer.scene.static_set = Gaussians::from_rows(&rows, &trainer.device);
    trainer.density_static = trainer.density_static.gather(stay);
    trainer
        .optimizer
        .edit_rows(STATIC, stay, &vec![false; stay.len()], n);
}

fn space_for(rule: SpaceRule, means: &[[f32; 3]]) -> SpaceBox {
    match rule {
        SpaceRule::Fixed(bound) => SpaceBox::fixed(bound),
        SpaceRule::Scene => SpaceBox::around(means, BOX_TAIL, BOX_MARGIN),
    }
}
