use std::fs;

use super::*;
use crate::published::ProtocolName;
use crate::synth::{self, SynthConfig, SynthLayout};
use crate::train::Preset;

/// A scene of synthetic pictures as the real one lies on a disk.
fn scene(root: &Path, name: &str, layout: SynthLayout, cameras: usize, size: [usize; 2]) {
    let config = SynthConfig {
        layout,
        cameras,
        frames: 3,
        width: size[0],
        height: size[1],
        ..SynthConfig::default()
    };
    synth::write(&root.join(name), &config).expect("writes");
}

fn benchmark(protocol: ProtocolName, data: &Path, iterations: usize) -> Benchmark {
    let mut train = TrainConfig::preset(Preset::Quick);
    train.iterations = iterations;
    train.visits = None;
    train.initial_points = [0, 200];
    train.checkpoint_interval = 2;
    Benchmark {
        protocol,
        data: data.to_path_buf(),
        device: "flex".into(),
        drop_cameras: Vec::new(),
        train,
    }
}

/// Counts runs and steps; asks to stop after so many steps.
#[derive(Default)]
struct Count {
    begun: Vec<(String, u64)>,
    first_steps: Vec<usize>,
    n_steps: std::cell::Cell<usize>,
    is_new: bool,
}

impl Observer for Count {
    fn scene(&mut self, _: &Scene, _: &Prepared) {}

    fn begin(&mut self, scene: &Scene, seed: u64, _: usize) {
        self.begun.push((scene.name.into(), seed));
        self.is_new = true;
    }

    fn step(&mut self, report: &StepReport, _: f64) {
        if std::mem::take(&mut self.is_new) {
            self.first_steps.push(report.step);
        }
        self.n_steps.set(self.n_steps.get() + 1);
    }
}

fn run(
    benchmark: &Benchmark,
    out: &Path,
    seeds: u64,
    stop: &dyn Fn() -> bool,
    count: &mut Count,
) -> Result<BenchmarkRows, Error> {
    let protocol = benchmark.protocol.protocol();
    let found = find_scenes(protocol, &benchmark.data, &[])?;
    let options = RunOptions {
        seeds,
        memory: None,
        perceptual: &Perceptual::default(),
        stop,
    };
    let runs = benchmark.run(&found, out, &Device::flex(), &options, count)?;
    let rows = BenchmarkRows::new(benchmark, &found, &runs);
    rows.write(out)?;
    page(benchmark, &rows, &runs).write(out)?;
    Ok(rows)
}

fn never() -> bool {
    false
}

#[test]
fn scenes_are_found_by_their_published_names() {
    let folder = tempfile::tempdir().expect("a scratch folder");
    let root = folder.path();
    let protocol = ProtocolName::N3dv.protocol();
    let refused = |wanted: &[&str]| {
        let wanted: Vec<String> = wanted.iter().map(ToString::to_string).collect();
        let error = find_scenes(protocol, root, &wanted).expect_err("refused");
        error.to_string()
    };
    let message = refused(&[]);
    for word in [
        "coffee_martini",
        "sear_steak",
        "an empty folder",
        "as it was published",
    ] {
        assert!(message.contains(word), "`{word}` is not in: {message}");
    }
    for name in ["Flame_Salmon", "sear_steak", "notes"] {
        fs::create_dir(root.join(name)).expect("a folder");
    }
    let found = find_scenes(protocol, root, &[]).expect("two are there");
    let names: Vec<&str> = found.scenes.iter().map(|(scene, _)| scene.name).collect();
    assert_eq!(names, ["flame_salmon_1", "sear_steak"]);
    assert_eq!(found.scenes[0].1, root.join("Flame_Salmon"));
    assert_eq!(found.missing.len(), 4);
    let message = refused(&["cook_spinach"]);
    assert!(
        message.contains("cook_spinach") && message.contains("notes"),
        "{message}"
    );
    let message = refused(&["basketball"]);
    assert!(
        message.contains("--scenes") && message.contains("cut_roasted_beef"),
        "{message}"
    );
    let one = find_scenes(protocol, root, &["sear_steak".into()]).expect("there");
    assert_eq!((one.scenes.len(), one.missing.len()), (1, 0));
    // A folder that is a scene itself.
    scene(root, "cook_spinach", SynthLayout::N3dv, 3, [16, 16]);
    let itself = find_scenes(protocol, &root.join("cook_spinach"), &[]).expect("itself");
    assert_eq!(itself.scenes[0].0.name, "cook_spinach");
    assert_eq!(itself.missing.len(), 5);
}

#[test]
fn a_scene_is_loaded_as_its_protocol_says() {
    let folder = tempfile::tempdir().expect("a scratch folder");
    let root = folder.path();
    let prepare = |protocol: ProtocolName, name: &str, drops: &[&str]| {
        let mut benchmark = benchmark(protocol, root, 4);
        let drops = drops.iter().map(|drop| drop.parse().expect("a camera"));
        benchmark.drop_cameras = drops.collect();
        let scene = protocol.protocol().scene(name).expect("published");
        Prepared::of(&benchmark, scene, &root.join(name)).expect("prepared")
    };
    // Twice as large as published, but short.
    scene(root, "basketball", SynthLayout::N3dv, 17, [64, 36]);
    let prepared = prepare(ProtocolName::Panoptic, "basketball", &[]);
    assert_eq!(prepared.data.test_cameras, Some(vec![0, 10, 15]));
    assert_eq!(prepared.held_out, ["cam00", "cam10", "cam15"]);
    assert_eq!(
        prepared.differs,
        [
            "64x36 pixels instead of 640x360",
            "3 frames instead of 150",
            "held out cam00, cam10, cam15 instead of cameras 0, 10, 15, 30"
        ]
    );
    // Numbers are the cameras' own, whatever is left out before them.
    let prepared = prepare(
        ProtocolName::Panoptic,
        "basketball",
        &["cam03", "basketball:cam09"],
    );
    assert_eq!(prepared.held_out, ["cam00", "cam10", "cam15"]);
    assert_eq!(prepared.differs[3], "without cam03, cam09");
    // Larger pictures are made smaller, transparent ones lie over white.
    scene(root, "lego", SynthLayout::Blender, 3, [500, 500]);
    let prepared = prepare(ProtocolName::DNerf, "lego", &["hook:cam01"]);
    assert_eq!((prepared.size, prepared.data.downscale), ([400, 400], 1.25));
    assert_eq!((prepared.differs.len(), prepared.held_out.len()), (0, 1));
}

#[test]
fn a_longer_scene_is_cut_to_its_published_frames() {
    let folder = tempfile::tempdir().expect("a scratch folder");
    let root = folder.path();
    let config = SynthConfig {
        cameras: 2,
        frames: 302,
        width: 16,
        height: 16,
        ..SynthConfig::default()
    };
    synth::write(&root.join("flame_salmon_1"), &config).expect("writes");
    let protocol = ProtocolName::N3dv.protocol();
    let scene = protocol.scene("flame_salmon_1").expect("published");
    let benchmark = benchmark(ProtocolName::N3dv, root, 4);
    let prepared = Prepared::of(&benchmark, scene, &root.join(scene.name)).expect("prepared");
    let frames = prepared.data.frames.map(|frames| frames.to_string());
    assert_eq!((frames.as_deref(), prepared.n_frames), (Some("0-299"), 300));
    assert_eq!(prepared.differs, ["16x16 pixels instead of 1352x1014"]);
}

#[test]
fn runs_are_made_once_taken_up_and_told_beside_what_is_published() {
    let folder = tempfile::tempdir().expect("a scratch folder");
    let (data, out) = (folder.path().join("data"), folder.path().join("out"));
    scene(&data, "coffee_martini", SynthLayout::N3dv, 4, [32, 24]);
    scene(&data, "sear_steak", SynthLayout::N3dv, 4, [32, 24]);
    let mut benchmark = benchmark(ProtocolName::N3dv, &data, 8);
    benchmark.drop_cameras = vec!["coffee_martini:cam03".parse().expect("a camera")];

    // Stopped in its first run.
    let mut count = Count::default();
    let steps = std::rc::Rc::new(std::cell::Cell::new(0));
    let asked = steps.clone();
    let stop = move || {
        asked.set(asked.get() + 1);
        asked.get() > 5
    };
    let stopped = run(&benchmark, &out, 2, &stop, &mut count).expect_err("stopped");
    assert!(
        matches!(stopped, Error::Stopped { step: 5, .. }),
        "{stopped}"
    );

    // Taken up where it was, then the other three.
    let mut count = Count::default();
    let rows = run(&benchmark, &out, 2, &never, &mut count).expect("runs");
    let begun: Vec<(&str, u64)> = count.begun.iter().map(|(s, n)| (s.as_str(), *n)).collect();
    let expected = [
        ("coffee_martini", 0),
        ("coffee_martini", 1),
        ("sear_steak", 0),
        ("sear_steak", 1),
    ];
    assert_eq!(begun, expected);
    assert_eq!(count.first_steps, [6, 1, 1, 1]);
    assert_eq!(count.n_steps.get(), 3 + 3 * 8);
    assert_eq!(rows.scene_names(), ["coffee_martini", "sear_steak"]);
    assert_eq!((rows.missing.len(), rows.is_whole), (4, false));
    let coffee = &rows.scenes[0];
    assert_eq!((coffee.seeds, coffee.iterations, coffee.n_views), (2, 8, 3));
    assert_eq!(coffee.differs[2], "without cam03");
    assert!(coffee.figures.psnr.is_some_and(|psnr| psnr > 3.0));
    let record = read_run(&out.join("coffee_martini/seed-1")).expect("a run");
    assert_eq!(record.config.data.drop_cameras, ["cam03"]);
    assert_eq!(record.config.train.seed, 1);

    // Nothing is left to do.
    let mut count = Count::default();
    assert_eq!(
        run(&benchmark, &out, 2, &never, &mut count).expect("unchanged"),
        rows
    );
    assert!(count.begun.is_empty());

    // What a reader sees.
    let json = fs::read_to_string(out.join("benchmark.json")).expect("written");
    assert!(
        json.contains("\"scene\": \"sear_steak\"") && json.contains("\"psnr\""),
        "{json}"
    );
    let page = fs::read_to_string(out.join("report.html")).expect("written");
    for word in [
        "NeRFPlayer",
        "arXiv 2312.16812, Tables 6 and 11",
        "RTX 4090",
        "32x24 pixels instead of 1352x1014",
        "Not there: cook_spinach",
        "do not compare",
        "scaled to [-1, 1]",
    ] {
        assert!(page.contains(word), "`{word}` is not on the page");
    }
    let csv = fs::read_to_string(out.join("mean.csv")).expect("written");
    assert!(
        csv.contains("Spacetime Gaussians,31.25,"),
        "the mean of 28.61 and 33.89: {csv}"
    );
    assert!(
        !csv.contains("E-D3DGS"),
        "it has no figures of these scenes: {csv}"
    );

    // Another benchmark does not go there.
    let mut other = benchmark.clone();
    other.train.iterations = 9;
    let error = run(&other, &out, 1, &never, &mut Count::default()).expect_err("another");
    assert!(
        error.to_string().contains("benchmark.toml differs"),
        "{error}"
    );
    let notes = folder.path().join("notes");
    fs::create_dir(&notes).expect("a folder");
    fs::write(notes.join("mine.txt"), "mine").expect("written");
    let error = run(&benchmark, &notes, 1, &never, &mut Count::default()).expect_err("occupied");
    assert!(
        error
            .to_string()
            .contains("new or empty folder for the benchmark"),
        "{error}"
    );
}

#[test]
fn technicolor_holds_out_its_tenth_camera() {
    let folder = tempfile::tempdir().expect("a scratch folder");
    let (data, out) = (folder.path().join("data"), folder.path().join("out"));
    scene(&data, "Fabien", SynthLayout::Technicolor, 16, [32, 17]);
    let benchmark = benchmark(ProtocolName::Technicolor, &data, 4);
    let rows = run(&benchmark, &out, 1, &never, &mut Count::default()).expect("runs");
    let fabien = &rows.scenes[0];
    assert_eq!(
        fabien.differs,
        [
            "32x17 pixels instead of 2048x1088",
            "3 frames instead of 50"
        ]
    );
    let results = crate::results::read_results(
        &crate::train::RunFolder::open(&out.join("Fabien/seed-0")).expect("a run"),
    );
    let results = results.expect("readable").expect("scored");
    assert!(
        results
            .evaluation
            .per_view
            .iter()
            .all(|view| view.camera == "cam10")
    );
    assert_eq!(results.evaluation.per_view.len(), 3);
    let page = fs::read_to_string(out.join("report.html")).expect("written");
    assert!(page.contains("arXiv 2312.16812, Table 13"));
}

#[test]
fn cameras_to_drop_are_of_a_scene_or_of_all() {
    let drop = |text: &str| text.parse::<DroppedCamera>();
    let of = |scene: &str| {
        let all = ["cam01", "hook:cam02"].map(|text| drop(text).expect("a camera"));
        DroppedCamera::of_scene(&all, scene)
    };
    assert_eq!(of("hook"), ["cam01", "cam02"]);
    assert_eq!(of("lego"), ["cam01"]);
    for text in ["cam01", "hook:cam02"] {
        assert_eq!(drop(text).expect("a camera").to_string(), text);
    }
    for bad in ["", ":cam01", "hook:"] {
        assert!(drop(bad).is_err(), "{bad}");
    }
    let protocol = ProtocolName::DNerf.protocol();
    let wrong = DroppedCamera::check(&[drop("hok:cam01").expect("parses")], protocol);
    let message = wrong.expect_err("no such scene").to_string();
    assert!(
        message.contains("`hok`") && message.contains("bouncingballs"),
        "{message}"
    );
}
