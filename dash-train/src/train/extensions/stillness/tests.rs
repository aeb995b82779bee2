//! What changes, and what rests.

use std::sync::Arc;

use burn::tensor::Device;

use super::*;
use crate::synth;
use crate::train::{Preset, TrainConfig, Trainer};

/// Block means of `n` pictures of 6 x 4 blocks: grey with noise of one step of 255, and what `differs` adds.
fn pictures(n: usize, differs: impl Fn(usize, usize) -> f32) -> Vec<Vec<f32>> {
    let picture = |frame: usize| {
        let value = |k: usize| {
            let noise = ((k * 7919 + frame * 104_729) % 31) as f32 / 31.0 / 255.0;
            0.4 + noise + differs(frame, k / 3)
        };
        (0..6 * 4 * 3).map(value).collect()
    };
    (0..n).map(picture).collect()
}

fn changing(pictures: &[Vec<f32>]) -> Vec<usize> {
    let changes = changes(pictures);
    (0..changes.len()).filter(|&block| changes[block]).collect()
}

#[test]
fn a_change_is_above_noise_and_above_what_the_whole_picture_does() {
    assert_eq!(changing(&pictures(9, |_, _| 0.0)), [0usize; 0]);
    // Seen in one picture only: something fast.
    let fast = |frame: usize, block: usize| if frame == 5 && block == 9 { 0.2 } else { 0.0 };
    assert_eq!(changing(&pictures(9, fast)), [9]);
    // Exposure that varies, and something that moves before it.
    let flicker = |frame: usize, _: usize| 0.04 * (frame % 2) as f32;
    assert_eq!(changing(&pictures(9, flicker)), [0usize; 0]);
    let both = |frame: usize, block: usize| flicker(frame, block) + 3.0 * fast(frame, block);
    assert_eq!(changing(&pictures(9, both)), [9]);
    // Two pictures are enough.
    assert_eq!(changing(&pictures(6, fast)), [9]);
    assert_eq!(changing(&[]), [0usize; 0]);
}

#[test]
fn neighbours_of_what_changes_may_move() {
    let blocks = Blocks::of(12, 8);
    assert_eq!((blocks.rows, blocks.columns), (4, 6));
    let mut changes = vec![false; 24];
    changes[6] = true;
    let wide = widened(&changes, blocks);
    let found: Vec<usize> = (0..24).filter(|&block| wide[block]).collect();
    assert_eq!(found, [0, 1, 6, 7, 12, 13]);
}

#[test]
fn what_most_cameras_see_unchanged_rests() {
    // Cameras beside each other look along z; those of `changing` see all of their picture change.
    let seen = |changing: usize| -> Vec<Seen> {
        (0..4)
            .map(|k| {
                let camera = Camera::new(10.0, 10.0, 10.0, 10.0, 20, 20).placed(
                    [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
                    [k as f64, 0.0, 0.0],
                );
                let blocks = Blocks::of(20, 20);
                let changes = vec![k < changing; blocks.rows * blocks.columns];
                Seen {
                    camera,
                    blocks,
                    changes,
                }
            })
            .collect()
    };
    let at = |changing: usize, mean: [f32; 3]| rests(&seen(changing), mean, 0.5);
    let all = [1.5, 0.0, 9.0];
    assert_eq!([0, 1, 2, 4].map(|n| at(n, all)), [true, true, false, false]);
    // In sight of the first two only.
    let left = [-0.5, 0.0, 1.0];
    assert_eq!([0, 1, 2].map(|n| at(n, left)), [true, false, false]);
    // Behind all of them: nobody knows.
    assert!(!at(0, [0.0, 0.0, -3.0]));
}

#[test]
fn what_rests_has_no_motion_and_stays_static() {
    let dataset = Arc::new(synth::loaded(6, 8, [64, 48]));
    let mut config = TrainConfig::preset(Preset::Quick);
    config.iterations = 60;
    config.initial_points = [50, 2_000];
    let mut trainer = Trainer::new(config, dataset, &Device::flex()).expect("valid");
    let stages = trainer.run.stages();
    while trainer.run.step <= stages.warmup {
        trainer.step().expect("trains");
    }
    let rests = trainer.run.method.at_rest.clone();
    let n = trainer.run.scene.static_set.len();
    assert_eq!(rests.len(), n);
    let still = rests.iter().filter(|&&rests| rests).count();
    assert!(still > n / 2 && still < n, "{still} of {n}");

    // However the field shakes.
    let field = trainer.run.method.motion.take().expect("the coarse stage");
    let shaken = dash_model::parameters::named_parameters(&field).into_iter();
    let shaken = shaken.map(|(name, mut tensor)| {
        tensor.values.iter_mut().for_each(|v| *v += 0.5);
        (name, tensor)
    });
    let field = dash_model::parameters::with_parameters(field.clone(), shaken.collect());
    trainer.run.method.motion = Some(field.expect("its own"));
    let coefficients = trainer.run.coefficients().expect("valid").expect("moves");
    let width = coefficients.dims()[1];
    for (row, rests) in to_host(coefficients).chunks_exact(width).zip(&rests) {
        assert_eq!(row.iter().all(|v| *v == 0.0), *rests);
    }
    while trainer.run.step <= stages.end {
        trainer.step().expect("trains");
    }
    let (n_static, n_dynamic) = trainer.run.scene.counts();
    assert!(n_static >= still, "{n_static} {n_dynamic} {still}");
}
