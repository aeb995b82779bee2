use std::sync::Arc;

use burn::tensor::{Device, Tensor};
use dash_model::{DeformationField, DynamicPart, GaussianRows, Gaussians, SpaceBox};
use rand::SeedableRng;
use rand_pcg::Pcg64;

use super::*;
use crate::synth;
use crate::train::core::{Run, to_host};
use crate::train::extensions::Floaters;
use crate::train::paper::Dash;
use crate::train::{Preset, TrainConfig, Trainer};

/// At its first step, and a view of it.
fn trainer(config: TrainConfig) -> (Trainer, View) {
    let dataset = Arc::new(synth::loaded(4, 3, [32, 24]));
    let view = dataset.views[0].clone();
    let trainer = Trainer::new(config, dataset, &Device::flex()).expect("valid");
    (trainer, view)
}

/// Such dynamic Gaussians with a fresh field.
fn part(trainer: &Trainer, rows: &GaussianRows) -> DynamicPart {
    let deformation = &trainer.run.method.field;
    let (space, mut rng) = (SpaceBox::fixed(10.0), Pcg64::seed_from_u64(1));
    let field = DeformationField::new(deformation, space, &mut rng, &trainer.run.device);
    DynamicPart {
        gaussians: Gaussians::from_rows(rows, &trainer.run.device),
        field: field.expect("valid"),
    }
}

/// By the gradients of their opacities with the cost and without.
#[test]
fn dynamic_gaussians_pay_for_what_they_cover_from_near() {
    let mut config = TrainConfig::preset(Preset::Quick);
    config.method.smoothness = 0.0;
    config.extensions.gaps = None;
    let (mut trainer, view) = trainer(config);
    let (eye, forward_axis) = (view.camera.position(), view.camera.forward());
    let before_it = |away: f64| std::array::from_fn(|k| (eye[k] + away * forward_axis[k]) as f32);
    let places = [before_it(4.0), before_it(1.0)];
    let mut rows = GaussianRows::from_points(&places, &[[0.0; 3]; 2], 0, 0.1);
    rows.log_scales = vec![[0.5_f32.ln(); 3], [0.05_f32.ln(); 3]];
    rows.opacity_logits = vec![2.0, -2.0];
    trainer.run.scene.settings.near_plane = 0.1;
    trainer.run.scene.dynamic = Some(part(&trainer, &rows));
    let mut slopes = |weight: f32| {
        let Trainer { run, hooks, .. } = &mut trainer;
        hooks.get_mut::<Floaters>().expect("on").nearness = weight;
        let forward = forward(run, hooks, &view).expect("renders");
        let gradients = forward.loss.backward();
        let dynamic = run.scene.dynamic.as_ref().expect("given");
        let logits = dynamic.gaussians.opacity_logits.val();
        let slopes = logits.grad(&gradients).expect("of logits");
        to_host(Tensor::<1>::from_inner(slopes))
    };
    let (without, with) = (slopes(0.0), slopes(1.0));
    assert_eq!(with[0], without[0], "at the typical distance");
    assert!(with[1] > without[1] + 1e-4, "{with:?} {without:?}");
}

#[test]
fn smoothness_is_measured_at_one_step_of_its_interval_with_the_weight_of_all() {
    let mut config = TrainConfig::preset(Preset::Quick);
    config.extensions.gaps = None;
    config.method.smoothness = 500.0;
    config.method.smoothness_share = 1.0;
    let (mut trainer, view) = trainer(config);
    let rows = GaussianRows::from_points(&[[0.1; 3], [-0.2; 3]], &[[0.5; 3]; 2], 0, 0.1);
    trainer.run.scene.dynamic = Some(part(&trainer, &rows));
    let mut cost = |interval: usize, step: usize| {
        trainer.run.method.config.smoothness_interval = interval;
        trainer.run.step = step;
        trainer.run.rng = Pcg64::seed_from_u64(2);
        let run: &mut Run<Dash> = &mut trainer.run;
        let (splats, terms) = Dash::dynamic_splats(run, &view).expect("valid");
        assert!(splats.is_some());
        let terms = terms.into_iter().map(|term| to_host(term)[0]);
        terms.collect::<Vec<f32>>()
    };
    let [each] = cost(1, 3)[..] else {
        panic!("one term");
    };
    assert!(each > 0.0);
    assert!(cost(4, 3).is_empty());
    let [all] = cost(4, 8)[..] else {
        panic!("one term");
    };
    assert!((all / (4.0 * each) - 1.0).abs() < 1e-6, "{all} {each}");
}
