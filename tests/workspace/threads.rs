//! Training gives the same bits whatever the number of threads, through all stages, density
//! control, opacity resets and the static/dynamic decomposition.

use std::path::Path;
use std::sync::Arc;

use burn::tensor::Device;
use dash_kernels::testing::{finite_values, named_devices};
use dash_model::Gaussians;
use dash_train::dataset::{self, Dataset, LoadOptions};
use dash_train::synth::{self, SynthConfig};
use dash_train::train::{Preset, TrainConfig, Trainer};

const STEPS: usize = 500;
/// Steps on a GPU, which may be emulated in software: past the decomposition.
#[cfg(feature = "wgpu")]
const WGPU_STEPS: usize = 240;
/// Steps that reset opacities of the static and of the dynamic set, as [`config`] has them: the decomposition waits until
/// step 216, so that each frame has 12 steps.
const RESETS: [usize; 2] = [255, 301];

/// `quick`, with every event of a run within [`STEPS`] steps.
fn config(seed: u64) -> TrainConfig {
    let mut config = TrainConfig::preset(Preset::Quick);
    for assignment in [
        "iterations=500",
        "initial_points=[0, 600]",
        "method.stages=[0.1, 0.35]",
        "extensions.following.min_steps=0",
        "densify.static.during=[0.033, 0.6]",
        "densify.interval=20",
        "densify.opacity_reset_interval=85",
        "densify.static.max_gaussians=6000",
        "densify.dynamic.during=[0.37, 0.7]",
        "densify.dynamic.max_gaussians=3000",
        "extensions.demotion.interval=150",
        "method.motion_field.log2_hashmap_size=10",
        "method.field.log2_hashmap_size=10",
        "method.field.hidden=16",
    ] {
        config.set(assignment).expect("a known key");
    }
    config.seed = seed;
    config
}

/// The dataset: `bounce`, 6 cameras, 8 frames, 64x48 pixels.
fn bounce(folder: &Path) -> Arc<Dataset> {
    let config = SynthConfig {
        cameras: 6,
        frames: 8,
        width: 64,
        height: 48,
        ..SynthConfig::default()
    };
    synth::write(folder, &config).expect("writes");
    Arc::new(dataset::load(folder, &LoadOptions::default()).expect("sound"))
}

/// A run's numbers of static and dynamic Gaussians after every step, and its scene's files.
struct Run {
    counts: Vec<(usize, usize)>,
    files: [Vec<u8>; 2],
}

fn run(threads: usize, seed: u64, steps: usize, dataset: &Arc<Dataset>, device: &Device) -> Run {
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(threads)
        .build()
        .expect("the machine can start a few threads");
    let folder = tempfile::tempdir().expect("a scratch folder");
    pool.install(|| {
        let mut trainer = Trainer::new(config(seed), dataset.clone(), device).expect("valid");
        let mut counts = Vec::new();
        for _ in 0..steps {
            let report = trainer.step().expect("trains");
            counts.push((report.n_static, report.n_dynamic));
            let dynamic = trainer.scene().dynamic.as_ref().map(|d| &d.gaussians);
            let sets = [Some(&trainer.scene().static_set), dynamic];
            for (set, reset) in sets.into_iter().zip(RESETS) {
                if report.step == reset {
                    assert_transparent(set.expect("decomposed by now"), reset);
                }
            }
        }
        trainer.scene().save(folder.path()).expect("writes");
        let read = |name: &str| std::fs::read(folder.path().join(name)).expect("written");
        Run {
            counts,
            files: [read("scene.safetensors"), read("scene.json")],
        }
    })
}

fn assert_transparent(set: &Gaussians, step: usize) {
    let logits = finite_values(set.opacity_logits.val());
    let most = logits.iter().copied().fold(f32::MIN, f32::max);
    let limit = dash_model::logit(0.01);
    assert!(
        !logits.is_empty() && most <= limit,
        "no reset at step {step}: logits up to {most}, not {limit}"
    );
}

/// Fails unless the counts show density control of all, of the static and of the dynamic set.
fn assert_eventful(name: &str, counts: &[(usize, usize)]) {
    let decomposed = counts.iter().position(|&(_, dynamic)| dynamic > 0);
    let decomposed = decomposed.unwrap_or_else(|| panic!("{name}: nothing was found to move"));
    let (before, after) = counts.split_at(decomposed);
    let unzipped =
        |counts: &[(usize, usize)]| -> (Vec<usize>, Vec<usize>) { counts.iter().copied().unzip() };
    let ((all, _), (static_set, dynamic)) = (unzipped(before), unzipped(after));
    for (set, counts) in [("all", all), ("static", static_set), ("dynamic", dynamic)] {
        let rounds = |changed: fn(usize, usize) -> bool| {
            let pairs = counts.windows(2);
            pairs.filter(|pair| changed(pair[0], pair[1])).count()
        };
        let (grew, shrank) = (rounds(|a, b| b > a), rounds(|a, b| b < a));
        let last = counts[counts.len() - 1];
        let found =
            format!("{name}, {set}: grew {grew} times, shrank {shrank} times, {last} at the end");
        eprintln!("{found}");
        assert!(grew > 0 && grew + shrank >= 3 && last > 0, "{found}");
    }
}

fn assert_same_for_any_thread_count(name: &str, device: &Device) {
    let folder = tempfile::tempdir().expect("a scratch folder");
    let dataset = bounce(&folder.path().join("bounce"));
    let expected = run(1, 0, STEPS, &dataset, device);
    assert_eventful(name, &expected.counts);
    for threads in [2, 8] {
        let got = run(threads, 0, STEPS, &dataset, device);
        let step = got
            .counts
            .iter()
            .zip(&expected.counts)
            .position(|(got, expected)| got != expected);
        assert_eq!(step, None, "{name}: {threads} threads differ in the counts");
        for (got, expected) in got.files.iter().zip(&expected.files) {
            let differing = got.iter().zip(expected).filter(|(a, b)| a != b).count();
            assert!(
                got == expected,
                "{name}: with {threads} threads {differing} of {} bytes differ from one thread's",
                expected.len()
            );
        }
    }
}

#[test]
#[cfg(feature = "ndarray")]
fn ndarray_trains_to_the_same_bits_on_1_2_and_8_threads() {
    #[expect(
        deprecated,
        reason = "burn-ndarray gives way to burn-flex; users still ask for it"
    )]
    assert_same_for_any_thread_count("ndarray", &Device::ndarray());
}

#[test]
#[cfg(feature = "flex")]
fn flex_trains_to_the_same_bits_on_1_2_and_8_threads() {
    assert_same_for_any_thread_count("flex", &Device::flex());
}

/// A GPU gives the same bits when asked to, also after the decomposition, which adds the 4D field's tables.
#[test]
#[cfg(feature = "wgpu")]
fn wgpu_trains_to_the_same_bits_when_asked_to() {
    dash_kernels::set_deterministic(true);
    let folder = tempfile::tempdir().expect("a scratch folder");
    let dataset = bounce(&folder.path().join("bounce"));
    let device = Device::wgpu(burn::tensor::DeviceKind::DefaultDevice);
    let [a, b] = [0, 1].map(|_| run(2, 0, WGPU_STEPS, &dataset, &device));
    let n_dynamic = a.counts.last().expect("trained").1;
    assert!(n_dynamic > 0, "the run ends before the decomposition");
    assert_eq!(a.counts, b.counts);
    assert!(a.files == b.files, "two runs with the same seed differ");
}

/// Frames decoded on demand, from files and from videos, equal those held in memory.
#[test]
#[cfg(feature = "flex")]
fn frames_on_demand_train_to_the_same_bits() {
    /// Past the decomposition.
    const STEPS: usize = 200;
    for video in [false, true] {
        let folder = tempfile::tempdir().expect("a scratch folder");
        let folder = folder.path().join("bounce");
        let config = SynthConfig {
            cameras: 6,
            frames: 8,
            width: 64,
            height: 48,
            video,
            ..SynthConfig::default()
        };
        synth::write(&folder, &config).expect("writes");
        let load = |memory: u64| {
            let options = LoadOptions {
                memory: Some(memory),
                threads: Some(2),
                ..LoadOptions::default()
            };
            Arc::new(dataset::load(&folder, &options).expect("sound"))
        };
        let in_memory = load(1 << 30);
        assert_eq!(in_memory.frame_statistics(), None);
        let on_demand = load(in_memory.image_bytes() / 2);
        let device = Device::flex();
        let expected = run(2, 0, STEPS, &in_memory, &device);
        let got = run(2, 0, STEPS, &on_demand, &device);
        let statistics = on_demand.frame_statistics().expect("on demand");
        assert!(statistics.asked >= STEPS as u64 && statistics.decoded > 48);
        assert_eq!(got.counts, expected.counts, "video: {video}");
        assert!(got.files == expected.files, "video: {video}");
    }
}

/// The negative control: files of two seeds differ.
#[test]
fn another_seed_gives_other_bits() {
    let folder = tempfile::tempdir().expect("a scratch folder");
    let dataset = bounce(&folder.path().join("bounce"));
    for (name, device) in named_devices() {
        // Until density control begins, the seed decides the order of views and no more.
        let [a, b] = [0, 1].map(|seed| run(2, seed, 15, &dataset, &device));
        assert_eq!(a.counts, b.counts, "{name}");
        assert!(a.files[0] != b.files[0], "{name}: seeds 0 and 1 agree");
    }
}
