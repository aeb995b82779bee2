//! What is not finite is put into a run, and must be found, named and mended within a step.

use std::sync::{Arc, OnceLock};

use burn::tensor::Device;
use dash_kernels::testing::devices;
use dash_model::parameters::{named_parameters, with_parameters};
use dash_model::{GaussianRows, Gaussians};

use super::*;
use crate::dataset::Dataset;
use crate::synth;
use crate::train::config::tests::small;
use crate::train::core::ViewSums;
use crate::train::extensions::{Averaging, Floaters, FloatersConfig, RestCost, RestCostConfig};
use crate::train::paper::Decomposition;
use crate::train::{TrainConfig, Trainer};

/// The split of [`config`].
const SPLIT: usize = 12;

/// `bounce`, 4 cameras, 4 frames, 32x24 pixels.
fn dataset() -> Arc<Dataset> {
    static LOADED: OnceLock<Arc<Dataset>> = OnceLock::new();
    LOADED
        .get_or_init(|| Arc::new(synth::loaded(4, 4, [32, 24])))
        .clone()
}

fn config() -> TrainConfig {
    small(&[
        "iterations=40",
        "extensions.demotion=none",
        "densify.static.during=[0, 0]",
        "densify.dynamic.during=[0, 0]",
    ])
}

/// A run of which every step is read, as on a CPU.
fn read_at_once(config: TrainConfig, device: &Device) -> Trainer {
    let mut trainer = Trainer::new(config, dataset(), device).expect("valid");
    trainer.run.notes.every = 1;
    trainer
}

/// A run after `steps` steps, none of them skipped.
fn trained(steps: usize, device: &Device) -> Trainer {
    let mut trainer = read_at_once(config(), device);
    for _ in 0..steps {
        assert_eq!(trainer.step().expect("trains").n_skipped, 0);
    }
    trainer
}

/// The names and values of all parameters.
fn parameters(trainer: &Trainer) -> Vec<(String, Vec<u32>)> {
    let all = named_parameters(&trainer.run.scene).into_iter();
    all.map(|(name, tensor)| {
        let bits = tensor.values.iter().map(|value| value.to_bits()).collect();
        (name, bits)
    })
    .collect()
}

/// Steps that the mean of the parameters is of.
fn averaged(trainer: &Trainer) -> usize {
    trainer.hooks.get::<Averaging>().expect("on").n_steps()
}

fn floaters(trainer: &mut Trainer) -> &mut FloatersConfig {
    &mut trainer.hooks.get_mut::<Floaters>().expect("on").config
}

fn rest_cost(trainer: &mut Trainer) -> &mut RestCostConfig {
    &mut trainer.hooks.get_mut::<RestCost>().expect("on").0
}

fn edit_static(trainer: &mut Trainer, edit: impl FnOnce(&mut GaussianRows)) {
    let mut rows = trainer.run.scene.static_set.to_rows();
    edit(&mut rows);
    trainer.run.scene.static_set = Gaussians::from_rows(&rows, &trainer.run.device);
}

/// The one step that is skipped; the next one is not.
fn skipped_once(trainer: &mut Trainer) -> SkippedStep {
    let step = trainer.steps_done() + 1;
    assert_eq!(trainer.step().expect("goes on").n_skipped, 1);
    let mut skipped = trainer.take_skipped_steps();
    assert_eq!(skipped.len(), 1);
    assert_eq!(trainer.step().expect("goes on").n_skipped, 0, "mended");
    assert!(trainer.take_skipped_steps().is_empty(), "told once");
    let skipped = skipped.remove(0);
    assert_eq!(skipped.step, step);
    skipped
}

#[test]
fn colours_without_higher_coefficients_train() {
    for device in devices() {
        let mut config = config();
        config.set("sh_degree=0").expect("a known key");
        let mut trainer = read_at_once(config, &device);
        while !trainer.is_finished() {
            assert_eq!(trainer.step().expect("trains").n_skipped, 0);
        }
        assert_eq!(trainer.run.scene.static_set.sh_degree(), 0);
    }
}

#[test]
fn a_lost_mean_costs_its_gaussian_and_one_step() {
    for device in devices() {
        let mut trainer = trained(3, &device);
        let n = trainer.run.scene.static_set.len();
        edit_static(&mut trainer, |rows| rows.means[17][1] = f32::NAN);
        let skipped = skipped_once(&mut trainer);
        assert!(skipped.loss_is_finite, "a lost Gaussian is not drawn");
        assert_eq!(
            skipped.found,
            [NonFinite {
                tensor: "scene.static_set.means".into(),
                place: Place::Values,
                n_rows: 1,
                of: n,
                rows: vec![17],
            }]
        );
        assert_eq!(trainer.run.scene.static_set.len(), n - 1);
        assert_eq!(skipped.remedies, ["1 static Gaussian removed"]);
        let text = skipped.to_string();
        assert!(
            text.contains("scene.static_set.means in 1 of") && text.contains("(17)"),
            "{text}"
        );
    }
}

#[test]
fn the_mean_of_the_last_steps_starts_anew_without_what_was_lost() {
    for device in devices() {
        let mut config = config();
        config.set("extensions.averaging.share=0.5").expect("a known key");
        let mut trainer = read_at_once(config, &device);
        while trainer.steps_done() < 31 {
            assert_eq!(trainer.step().expect("trains").n_skipped, 0);
        }
        assert_eq!(averaged(&trainer), 1);
        let n = trainer.run.scene.static_set.len();
        edit_static(&mut trainer, |rows| rows.means[0][0] = f32::NAN);
        skipped_once(&mut trainer);
        assert_eq!(averaged(&trainer), 0);
        while !trainer.is_finished() {
            trainer.step().expect("trains");
        }
        let means = named_parameters(&trainer.run.scene).remove("static_set.means");
        let means = means.expect("means").values;
        assert_eq!(means.len(), 3 * (n - 1));
        assert!(means.iter().all(|value| value.is_finite()));
    }
}

/// A NaN opacity makes the regulariser and with it the loss NaN: the cause is named, not what follows.
#[test]
fn a_lost_loss_is_traced_to_its_gaussians() {
    for device in devices() {
        let mut trainer = trained(3, &device);
        let n = trainer.run.scene.static_set.len();
        edit_static(&mut trainer, |rows| {
            rows.opacity_logits[5] = f32::NAN;
            rows.opacity_logits[9] = f32::NAN;
        });
        let skipped = skipped_once(&mut trainer);
        assert!(!skipped.loss_is_finite);
        let values: Vec<&NonFinite> = skipped
            .found
            .iter()
            .filter(|found| found.place == Place::Values)
            .collect();
        assert_eq!(values.len(), 1);
        assert_eq!(values[0].rows, [5, 9]);
        assert_eq!(trainer.run.scene.static_set.len(), n - 2);
    }
}

#[test]
fn the_skipped_step_changes_no_other_parameter_and_no_moment() {
    let device = Device::flex();
    let mut trainer = trained(SPLIT + 3, &device);
    let before = parameters(&trainer);
    let (moments, steps) = trainer.run.optimizer.to_tensors();
    let table = "scene.dynamic.field.encoder.table";
    spoil(&mut trainer, table, &[6], f32::INFINITY);
    assert_eq!(trainer.step().expect("goes on").n_skipped, 1);
    for ((name, before), (_, after)) in before.iter().zip(parameters(&trainer)) {
        for (i, (before, after)) in before.iter().zip(after).enumerate() {
            let expected = match format!("scene.{name}") == table && i == 6 {
                true => 0,
                false => *before,
            };
            assert_eq!(after, expected, "{name}[{i}]");
        }
    }
    let (moments_after, steps_after) = trainer.run.optimizer.to_tensors();
    let others = |name: &&String| !name.ends_with(table);
    assert!(moments_after.keys().eq(moments.keys().filter(others)));
    assert!(steps_after.keys().eq(steps.keys().filter(others)));
    for (name, after) in &moments_after {
        assert_eq!(after, &moments[name], "{name}");
    }
}

/// Puts `value` into places of a parameter of the scene.
fn spoil(trainer: &mut Trainer, tensor: &str, places: &[usize], value: f32) {
    let mut all = named_parameters(&trainer.run.scene);
    let name = tensor.strip_prefix("scene.").expect("of the scene");
    let parameter = all.get_mut(name).expect("a parameter's name");
    for &place in places {
        parameter.values[place] = value;
    }
    trainer.run.scene = with_parameters(trainer.run.scene.clone(), all).expect("its own parameters");
}

#[test]
fn lost_entries_of_tables_and_networks_start_from_zero() {
    for device in devices() {
        let mut trainer = trained(SPLIT + 3, &device);
        for (tensor, row) in [
            ("scene.dynamic.field.encoder.table", 3),
            ("scene.dynamic.field.decoder.parameters", 0),
        ] {
            let width = match row {
                3 => 2,
                _ => 1,
            };
            spoil(&mut trainer, tensor, &[row * width], f32::INFINITY);
            let skipped = skipped_once(&mut trainer);
            let found = skipped
                .found
                .iter()
                .find(|found| found.place == Place::Values);
            let found = found.expect("named");
            assert_eq!((found.tensor.as_str(), found.rows[0]), (tensor, row));
            let all = named_parameters(&trainer.run.scene);
            let finite = |values: &[f32]| values.iter().all(|value| value.is_finite());
            assert!(all.values().all(|tensor| finite(&tensor.values)));
        }
    }
}

/// Nothing is lost yet, but one Gaussian's cost has grown beyond all numbers: its gradient tells.
#[test]
fn a_gradient_that_overflows_costs_its_gaussian() {
    for device in devices() {
        let mut trainer = trained(10, &device);
        let n = trainer.run.scene.static_set.len();
        let own = trainer.run.scene.static_set.trajectories.as_ref();
        let row = own.expect("settled").val().narrow(0, 7, 1);
        let cost = ((row + 1.0) * 1e30).powi_scalar(2).sum();
        assert_eq!(to_host(cost.clone()), [f32::INFINITY]);
        let losses = [cost.clone(), cost.clone()];
        let reading = look(&mut trainer.run, &cost.backward(), losses, "made");
        skip(&mut trainer.run, reading.expect("due")).expect("mends");
        let skipped = trainer.take_skipped_steps().remove(0);
        assert!(!skipped.loss_is_finite);
        let [found] = skipped.found.as_slice() else {
            panic!("{skipped}");
        };
        assert!(found.tensor.ends_with("trajectories"), "{skipped}");
        assert_eq!((found.place, &found.rows[..]), (Place::Gradient, &[7][..]));
        assert_eq!(trainer.run.scene.static_set.len(), n - 1);
        assert_eq!(trainer.step().expect("goes on").n_skipped, 0, "mended");
    }
}

/// What once overflowed so: a trajectory that leads out of all numbers costs no step.
#[test]
fn a_trajectory_of_any_length_trains() {
    for device in devices() {
        let mut trainer = trained(10, &device);
        rest_cost(&mut trainer).gaussians = 1.0;
        edit_static(&mut trainer, |rows| {
            let width = rows.trajectory_width;
            rows.trajectories[7 * width..8 * width].fill(1e30);
            rows.opacity_logits[7] = 2.0;
        });
        assert_eq!(trainer.step().expect("trains").n_skipped, 0);
    }
}

#[test]
fn a_lost_dynamic_gaussian_is_removed_and_a_lost_set_ends_the_run() {
    let device = Device::flex();
    let mut trainer = trained(SPLIT + 3, &device);
    let (_, n) = trainer.run.scene.counts();
    assert!(n > 1, "some move");
    let tensor = "scene.dynamic.gaussians.log_scales";
    spoil(&mut trainer, tensor, &[0], f32::NAN);
    assert_eq!(skipped_once(&mut trainer).found[0].rows, [0]);
    assert_eq!(trainer.run.scene.counts().1, n - 1);
    let all: Vec<usize> = (0..3 * (n - 1)).collect();
    spoil(&mut trainer, tensor, &all, f32::NEG_INFINITY);
    let error = trainer.step().expect_err("nothing is left to train");
    assert!(error.to_string().contains(tensor), "{error}");
    assert_eq!(
        trainer.run.scene.counts().1,
        n - 1,
        "nothing passes for the scene"
    );
}

#[test]
fn what_cannot_be_mended_ends_the_run_with_its_name() {
    let device = Device::flex();
    let mut trainer = trained(2, &device);
    // The regulariser's weight is at fault, which no parameter shows.
    floaters(&mut trainer).opacity = f32::INFINITY;
    let error = (0..MAX_SKIPPED_IN_A_ROW).find_map(|k| trainer.step().err().map(|e| (k, e)));
    let (steps, error) = error.expect("gives up");
    assert_eq!(steps, MAX_SKIPPED_IN_A_ROW - 1);
    let text = error.to_string();
    assert!(
        text.contains("20 in a row") && text.contains("the loss"),
        "{text}"
    );
}

/// Before a background in which a static set finds nothing, density control may remove all of it.
#[test]
fn a_run_that_lost_all_its_gaussians_ends_with_an_empty_scene() {
    for moves in [false, true] {
        for device in devices() {
            let mut config = config();
            if !moves {
                config.method.decomposition = Decomposition::None;
            }
            let mut trainer = read_at_once(config, &device);
            for _ in 0..2 {
                trainer.step().expect("trains");
            }
            let n = trainer.run.scene.static_set.len();
            edit_static(&mut trainer, |rows| *rows = rows.gather(&[]));
            trainer.run.optimizer.edit_rows(Set::Static.prefix(), &[], &[], n);
            trainer.run.static_state.gathered = ViewSums::default();
            while !trainer.is_finished() {
                let report = trainer.step().expect("goes on");
                assert!(report.n_skipped == 0 && report.loss.is_finite());
                assert_eq!((report.n_static, report.n_dynamic), (0, 0));
            }
            let finished = trainer.finished().expect("nothing to leave out");
            assert_eq!(finished.scene.counts(), (0, 0));
        }
    }
}

/// As a GPU is read: nothing waits, and yet a fault costs no more than the steps in which it is there.
#[test]
fn a_fault_is_found_when_it_is_read_and_changes_nothing_before() {
    const EVERY: usize = 4;
    for device in devices() {
        let mut trainer = trained(SPLIT + 3, &device);
        trainer.run.notes.every = EVERY;
        let n = trainer.run.scene.static_set.len();
        edit_static(&mut trainer, |rows| rows.means[2][1] = f32::NAN);
        let before = parameters(&trainer);
        for _ in 1..EVERY {
            let report = trainer.step().expect("goes on");
            assert_eq!((report.n_read, report.n_skipped), (0, 0));
            assert!(report.loss.is_finite(), "the last one read");
        }
        assert!(parameters(&trainer) == before, "nothing changes");
        assert!(trainer.take_skipped_steps().is_empty(), "not known yet");
        let report = trainer.step().expect("goes on");
        assert_eq!((report.n_read, report.n_skipped), (EVERY, EVERY));
        let skipped = trainer.take_skipped_steps();
        let steps: Vec<usize> = skipped.iter().map(|skipped| skipped.step).collect();
        assert_eq!(steps, [16, 17, 18, 19]);
        for skipped in &skipped {
            assert_eq!(skipped.found.len(), 1, "{skipped}");
            assert_eq!(skipped.found[0].rows, [2]);
        }
        assert_eq!(trainer.run.scene.static_set.len(), n - 1);
        for _ in 0..EVERY {
            assert_eq!(trainer.step().expect("goes on").n_skipped, 0, "mended");
        }
        assert!(parameters(&trainer) != before, "it learns");
    }
}

/// A gradient that overflows is gone when it is looked for; its row's mark is not, and follows the rows.
#[test]
fn a_gradient_that_was_not_finite_is_known_by_its_mark() {
    for device in devices() {
        let mut trainer = trained(10, &device);
        trainer.run.notes.every = 3;
        let n = trainer.run.scene.static_set.len();
        let own = trainer.run.scene.static_set.trajectories.as_ref();
        let row = own.expect("settled").val().narrow(0, 7, 1);
        let cost = ((row + 1.0) * 1e30).powi_scalar(2).sum();
        let losses = || [cost.clone(), cost.clone()];
        let run = &mut trainer.run;
        assert!(look(run, &cost.clone().backward(), losses(), "made").is_none());
        assert!(run.optimizer.stop.is_some(), "the device stops the step");
        // The first two rows go, and with them two places.
        let stay: Vec<usize> = (2..n).collect();
        run.keep(Set::Static, &stay);
        run.step += 1;
        let quiet = (Tensor::<1>::ones([1], &run.device).require_grad() * 2.0).backward();
        let fine = || [(); 2].map(|()| Tensor::ones([1], &run.device.clone()));
        let losses = fine();
        assert!(look(run, &quiet, losses.clone(), "fine").is_none());
        let reading = look(run, &quiet, losses, "fine").expect("due");
        assert_eq!(reading.counts(), [3, 1]);
        skip(run, reading).expect("mends");
        let skipped = trainer.take_skipped_steps().remove(0);
        assert_eq!(skipped.view, "made");
        assert!(!skipped.loss_is_finite);
        let [found] = skipped.found.as_slice() else {
            panic!("{skipped}");
        };
        assert!(found.tensor.ends_with("trajectories"), "{skipped}");
        assert_eq!(found.rows, [5]);
        assert_eq!(trainer.run.scene.static_set.len(), n - 3);
    }
}
