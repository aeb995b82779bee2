use std::sync::Arc;

use burn::tensor::Device;
use dash_kernels::counts;
use dash_kernels::limits::largest_buffer_bytes;
use dash_kernels::testing::devices;

use crate::dataset::Dataset;
use crate::synth;
use crate::train::config::tests::small;
use crate::train::core::densify::{reset_due, round_due, was_reset};
use crate::train::core::{DensityStatistics, Set};
use crate::train::{Keep, Preset, TrainConfig, Trainer};

#[test]
fn what_a_reset_hides_has_time_to_come_back_before_the_last_round() {
    for (iterations, expected) in [(3_428, vec![]), (6_000, vec![2_000])] {
        let mut config = TrainConfig::preset(Preset::Quick);
        config.iterations = iterations;
        let resets = "densify.opacity_reset_interval=2000";
        config.set(resets).expect("a known key");
        let schedule = config.schedule();
        let resets: Vec<usize> = (0..iterations)
            .filter(|&step| reset_due(&schedule, &schedule.densify.static_set, 0, step))
            .collect();
        assert_eq!(resets, expected, "{iterations} steps");
    }
}

#[test]
fn no_reset_comes_before_the_first_round() {
    let mut config = TrainConfig::preset(Preset::Quick);
    config.iterations = 1_000;
    for assignment in [
        "densify.dynamic.during=[0.5, 1]",
        "densify.opacity_reset_interval=150",
    ] {
        config.set(assignment).expect("a known key");
    }
    let (schedule, set) = (config.schedule(), &config.densify.dynamic);
    for (since, expected) in [(0, [600, 750, 900]), (80, [530, 680, 830])] {
        let resets: Vec<usize> = (0..1_000)
            .filter(|&step| reset_due(&schedule, set, since, step))
            .collect();
        assert_eq!(resets, expected, "since {since}");
        for step in 0..1_000 {
            let expected = step > resets[0];
            let found = was_reset(&schedule, set, since, step);
            assert_eq!(found, expected, "since {since}, step {step}");
        }
    }
}

#[test]
fn paper_controls_static_gaussians_as_3dgs_and_dynamic_ones_from_the_decomposition_on() {
    let config = TrainConfig::preset(Preset::Paper);
    let (schedule, end) = (config.schedule(), config.step_at(config.method.stages[1]));
    assert_eq!(end, 2_400);
    let due = |is_due: &dyn Fn(usize) -> bool| -> Vec<usize> {
        (0..=config.iterations)
            .filter(|&step| is_due(step))
            .collect()
    };
    let sets = [&config.densify.static_set, &config.densify.dynamic];
    for (set, first) in sets.into_iter().zip([600, end]) {
        let rounds = due(&|step| round_due(&schedule, set, step));
        let expected: Vec<usize> = (first..15_000).step_by(100).collect();
        assert_eq!(rounds, expected);
    }
    let resets = [(sets[0], 0), (sets[1], end)]
        .map(|(set, since)| due(&|step| reset_due(&schedule, set, since, step)));
    assert_eq!(resets[0], [3_000, 6_000, 9_000, 12_000]);
    assert_eq!(resets[1], [5_400, 8_400, 11_400]);
}

/// The largest ways that a mean and a log scale go in the first step, in units of their rates (and the extent).
fn first_steps(dataset: &Dataset, set: &[&str]) -> [f32; 2] {
    let mut config = TrainConfig::preset(Preset::Quick);
    config.keep(Keep::All);
    config.initial_points[0] = 50;
    for assignment in set {
        config.set(assignment).expect("a known key");
    }
    let units = [crate::train::core::rates::MEANS, 5e-3];
    let dataset = Arc::new(dataset.clone());
    let mut trainer = Trainer::new(config, dataset, &Device::flex()).expect("valid");
    let rows = |trainer: &Trainer| trainer.scene().static_set.to_rows();
    let before = rows(&trainer);
    trainer.step().expect("finite");
    let after = rows(&trainer);
    let longest = |before: &[[f32; 3]], after: &[[f32; 3]]| {
        let ways = before.iter().flatten().zip(after.iter().flatten());
        ways.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
    };
    [
        longest(&before.means, &after.means) / (units[0] * trainer.run.extent),
        longest(&before.log_scales, &after.log_scales) / units[1],
    ]
}

#[test]
fn means_are_faster_in_monocular_captures_and_scales_in_synchronised_ones() {
    let rig = synth::loaded(12, 96, [16, 16]);
    let mut monocular = rig.clone();
    let mut times: Vec<f32> = rig.views.iter().map(|view| view.time).collect();
    times.sort_by(f32::total_cmp);
    times.dedup();
    monocular.views.retain(|view| {
        let frame = times.iter().position(|time| *time == view.time);
        frame.is_some_and(|frame| view.camera_index == 7 * frame % 12)
    });
    // Adam's first step has the length of the rate.
    let none = [
        "extensions.capture_rates.monocular=1",
        "extensions.capture_rates.synchronized=1",
    ];
    let both = [
        "extensions.capture_rates.monocular=2.5",
        "extensions.capture_rates.synchronized=2",
    ];
    for (dataset, set, expected) in [
        (&rig, none, [1.0, 1.0]),
        (&rig, both, [1.0, 2.0]),
        (&monocular, none, [1.0, 1.0]),
        (&monocular, both, [2.5, 1.0]),
    ] {
        let found = first_steps(dataset, &set);
        for (found, expected) in found.into_iter().zip(expected) {
            assert!((found / expected - 1.0).abs() < 1e-2, "{found} {expected}");
        }
    }
}

#[test]
fn a_step_of_four_views_is_twice_as_long_and_sees_each_of_them() {
    let rig = synth::loaded(12, 8, [16, 16]);
    let [alone, four] = ["batch=1", "batch=4"].map(|batch| first_steps(&rig, &[batch]));
    for (four, alone) in four.into_iter().zip(alone) {
        assert!((four / alone - 2.0).abs() < 1e-2, "{four} {alone}");
    }
    let trained = |batch: &str| {
        let config = small(&[batch, "iterations=8"]);
        let dataset = Arc::new(rig.clone());
        let mut trainer = Trainer::new(config, dataset, &Device::flex()).expect("valid");
        let reports: Vec<_> = (0..4).map(|_| trainer.step().expect("finite")).collect();
        (trainer, reports)
    };
    let (mut one, _) = trained("batch=1");
    let (mut three, reports) = trained("batch=3");
    assert!(
        reports
            .iter()
            .all(|report| report.loss.is_finite() && report.n_read == 1)
    );
    // Every view counts in the statistics of density control.
    let seen = |trainer: &mut Trainer| {
        let gathered = &trainer.run.state(Set::Static).gathered;
        let statistics = DensityStatistics::of(gathered);
        statistics.totals().1.iter().max().copied()
    };
    assert_eq!((seen(&mut one), seen(&mut three)), (Some(4), Some(12)));
}

/// Launches of a step of the 4D stage, at most.
const STEP_LAUNCHES: usize = 100;
/// Launches of a picture, at most.
const PICTURE_LAUNCHES: usize = 30;

#[test]
fn a_step_of_a_gpu_reads_nothing_back_and_launches_few_kernels() {
    let is_gpu = |device: &Device| largest_buffer_bytes(device).is_some();
    for device in devices().into_iter().filter(is_gpu) {
        let config = small(&[
            "iterations=40",
            "extensions.demotion=none",
            "densify.static.during=[0, 0]",
            "densify.dynamic.during=[0, 0]",
        ]);
        let dataset = Arc::new(synth::loaded(4, 4, [32, 24]));
        let camera = dataset.views[0].camera.clone();
        let mut trainer = Trainer::new(config, dataset, &device).expect("valid");
        while trainer.steps_done() < 20 {
            trainer.step().expect("trains");
        }
        assert!(trainer.scene().dynamic.is_some());
        for _ in 0..16 {
            let (report, asked) = counts::of(|| trainer.step());
            assert_eq!(report.expect("trains").n_read, 0);
            assert_eq!(asked.reads, 0);
            let n = asked.launches();
            assert!((1..=STEP_LAUNCHES).contains(&n), "{n}: {asked:?}");
        }
        let scene = trainer.scene();
        let (picture, asked) = counts::of(|| scene.render(&camera, 0.4));
        picture.expect("renders");
        let n = asked.launches();
        assert!((1..=PICTURE_LAUNCHES).contains(&n), "{n}: {asked:?}");
    }
}
