//! The commands on a tiny scene, from nothing to pictures.

use crate::common::{Scratch, TINY, text};
use serde_json::Value;

const KEYS: [&str; 22] = [
    "dataset",
    "split",
    "device",
    "preset",
    "seed",
    "iterations",
    "n_static",
    "n_dynamic",
    "psnr",
    "psnr_dynamic",
    "ssim",
    "ms_ssim",
    "lpips_vgg",
    "lpips_alex",
    "storage_bytes",
    "train_seconds",
    "render_fps",
    "peak_memory_bytes",
    "metric_settings",
    "per_view",
    "decomposition",
    "split",
];

fn results(scratch: &Scratch, run: &str) -> Value {
    serde_json::from_slice(&scratch.read(&format!("{run}/results.json"))).expect("JSON")
}

#[test]
fn a_run_holds_what_the_design_says_and_eval_finds_it_again() {
    let scratch = Scratch::with_room("n3dv");
    let about = scratch.ok(&["info", "room"]);
    for part in ["n3dv", "32x24", "9 to train on, 3 to test", "cam00"] {
        assert!(about.contains(part), "{part} in {about}");
    }
    scratch.train("run");
    for file in [
        "config.toml",
        "log.jsonl",
        "scene/scene.json",
        "scene/scene.safetensors",
    ] {
        assert!(scratch.path("run").join(file).is_file(), "{file}");
    }
    assert!(scratch.path("run/checkpoints/000030/state.json").is_file());
    let trained = results(&scratch, "run");
    for key in KEYS {
        assert!(trained.get(key).is_some(), "{key} in {trained}");
    }
    assert_eq!(trained["split"], "test");
    assert_eq!(trained["preset"], "quick");
    assert!(
        trained["n_dynamic"].as_u64() > Some(0),
        "the 4D stage is part of this test"
    );
    assert_eq!(trained["lpips_vgg"], Value::Null);
    assert_eq!(trained["per_view"].as_array().map(Vec::len), Some(3));
    assert_eq!(trained["per_view"][1]["camera"], "cam00");
    let psnr = trained["psnr"].as_f64().expect("a number");
    assert!((5.0..60.0).contains(&psnr), "{psnr}");
    assert!(
        trained["train_seconds"]
            .as_f64()
            .is_some_and(|secs| secs > 0.0)
    );
    assert!(trained["decomposition"]["recall"].as_f64().is_some());

    scratch.ok(&["eval", "run"]);
    let evaluated = results(&scratch, "run");
    for key in [
        "psnr",
        "psnr_dynamic",
        "ssim",
        "peak_memory_bytes",
        "storage_bytes",
        "per_view",
    ] {
        assert_eq!(evaluated[key], trained[key], "{key}");
    }
    let said = scratch.ok(&["eval", "run", "--split", "train"]);
    assert!(said.contains("results_train.json"), "{said}");
    let of_training: Value =
        serde_json::from_slice(&scratch.read("run/results_train.json")).expect("JSON");
    assert_eq!(of_training["split"], "train");
    assert_eq!(of_training["per_view"].as_array().map(Vec::len), Some(9));
    assert_eq!(
        results(&scratch, "run"),
        evaluated,
        "the test views' scores"
    );
    let about = scratch.ok(&["info", "run"]);
    for part in ["quick", "30 of 30 steps", "warm-up to step 3", "PSNR"] {
        assert!(about.contains(part), "{part} in {about}");
    }
}

#[test]
fn every_layer_is_rendered_and_an_exported_instant_looks_the_same() {
    let scratch = Scratch::with_room("n3dv");
    scratch.train("run");
    scratch.ok(&[
        "render",
        "run",
        "--cameras",
        "test",
        "--layers",
        "full,static,dynamic,depth,alpha",
        "--out",
        "out",
    ]);
    for layer in ["full", "static", "dynamic", "depth", "alpha"] {
        for frame in 0..3 {
            let path = scratch.path(&format!("out/{layer}/{frame:04}_cam00.png"));
            let size = image::image_dimensions(&path).expect("a picture");
            assert_eq!(size, (32, 24), "{}", path.display());
        }
    }
    scratch.ok(&[
        "render",
        "run",
        "--format",
        "exr",
        "--layers",
        "full,depth",
        "--out",
        "exr",
    ]);
    let depth = image::open(scratch.path("exr/depth/0000_cam00.exr"))
        .expect("a picture")
        .to_rgb32f();
    assert!(depth.pixels().any(|p| p[0] > 1.0), "metres, not shares");
    scratch.ok(&["render", "run", "--cameras", "spiral", "--frames", "2"]);
    assert_eq!(
        std::fs::read_dir(scratch.path("run/renders/full"))
            .expect("listed")
            .count(),
        2
    );

    scratch.write("cameras.json", cameras_json());
    let shot = [
        "--cameras",
        "cameras.json",
        "--time",
        "0.5",
        "--background",
        "0.2,0.4,0.6",
    ];
    scratch.ok(&[&["render", "run", "--out", "from_run"], &shot[..]].concat());
    scratch.ok(&["export", "run", "--time", "0.5", "--out", "half.ply"]);
    scratch.ok(&[&["render", "half.ply", "--out", "from_ply"], &shot[..]].concat());
    let open = |path: &str| {
        image::open(scratch.path(path))
            .expect("a picture")
            .to_rgb8()
    };
    let (run, ply) = (
        open("from_run/full/0000_front.png"),
        open("from_ply/full/0000_front.png"),
    );
    assert_eq!(run.dimensions(), (40, 30));
    let worst = run
        .iter()
        .zip(ply.iter())
        .map(|(a, b)| a.abs_diff(*b))
        .max();
    assert!(worst <= Some(1), "{worst:?} of 255");
    assert!(
        run.pixels().any(|p| p[0].abs_diff(51) > 20),
        "more than background"
    );
    let about = scratch.ok(&["info", "half.ply"]);
    assert!(about.contains("Gaussians"), "{about}");
    scratch.ok(&["export", "run", "--time", "0.5", "--out", "CAPITALS.PLY"]);
    assert!(scratch.read("CAPITALS.PLY") == scratch.read("half.ply"));
    scratch.ok(&[
        &["render", "CAPITALS.PLY", "--out", "from_capitals"],
        &shot[..],
    ]
    .concat());
    assert_eq!(open("from_capitals/full/0000_front.png"), ply);
    assert_eq!(
        scratch.ok(&["info", "CAPITALS.PLY"]),
        about.replace("half.ply", "CAPITALS.PLY")
    );

    // A file for each frame, and a clip in one file: the second of three frames is that instant.
    for clip in ["plys", "clip.4dgs"] {
        scratch.ok(&["export", "run", "--frames", "3", "--out", clip]);
        let out = format!("from_{clip}");
        scratch.ok(&[&["render", clip, "--out", &out], &shot[..]].concat());
        let picture = open(&format!("{out}/full/0000_front.png"));
        let off = picture.iter().zip(ply.iter()).map(|(a, b)| a.abs_diff(*b));
        let mean = off.clone().map(f64::from).sum::<f64>() / off.len() as f64;
        assert!(
            mean <= if clip == "plys" { 0.0 } else { 2.0 },
            "{clip}: {mean}"
        );
        let about = scratch.ok(&["info", clip]);
        assert!(
            about.contains("frames") && about.contains("Gaussians"),
            "{about}"
        );
    }

    let export = [
        "export",
        "run",
        "--time",
        "0.5",
        "--out",
        "wide.ply",
        "--sh-degree",
    ];
    scratch.ok(&[&export[..], &["3"]].concat());
    scratch.ok(&[&["render", "wide.ply", "--out", "from_wide"], &shot[..]].concat());
    assert_eq!(open("from_wide/full/0000_front.png"), ply);
    let header = |path: &str| {
        let bytes = std::fs::read(scratch.path(path)).expect("a file");
        String::from_utf8_lossy(&bytes[..4_000.min(bytes.len())]).into_owned()
    };
    let is_wide = |path: &str| header(path).contains("f_rest_44");
    assert!(is_wide("wide.ply") && !is_wide("half.ply"));
    let said = scratch.is_wrong_usage(&[&export[..], &["0"]].concat());
    assert!(said.contains("expected 1 to 3"), "{said}");
}

/// One camera in front of the synthetic room, as 3DGS writes them.
fn cameras_json() -> String {
    r#"[{"id": 0, "img_name": "front", "width": 40, "height": 30, "position": [0.0, 1.2, 4.0],
        "rotation": [[1, 0, 0], [0, -1, 0], [0, 0, -1]], "fx": 40.0, "fy": 40.0}]"#
        .into()
}

/// Of an output folder, the pictures with these names, and the list of their cameras.
fn pictures(scratch: &Scratch, out: &str, names: &[&str]) -> (Vec<Vec<u8>>, Value) {
    let picture = |name: &&str| scratch.read(&format!("{out}/full/{name}.png"));
    let listed = serde_json::from_slice(&scratch.read(&format!("{out}/cameras.json")));
    (
        names.iter().map(picture).collect(),
        listed.expect("JSON of the pictures' cameras"),
    )
}

#[test]
fn cameras_of_a_transforms_file_show_what_the_datasets_own_show() {
    const NAMES: [&str; 3] = ["0000_test_r_0000", "0001_test_r_0001", "0002_test_r_0002"];
    let scratch = Scratch::with_room("blender");
    let file = ["--cameras", "room/transforms_test.json"];
    scratch.train("run");
    scratch.ok(&["render", "run", "--out", "own"]);
    scratch.ok(&[&["render", "run", "--out", "listed"], &file[..]].concat());
    let own = pictures(&scratch, "own", &NAMES);
    assert!(own == pictures(&scratch, "listed", &NAMES));
    for (index, time) in [0.0, 0.5, 1.0].into_iter().enumerate() {
        let entry = &own.1[index];
        assert_eq!(entry["img_name"], NAMES[index]);
        assert_eq!(entry["time"], time);
        assert_eq!(entry["width"], 32);
    }
    assert_eq!(own.1.as_array().map(Vec::len), Some(3));
    // One camera at one instant is one picture.
    scratch.ok(&[
        &["render", "run", "--time", "0.5", "--out", "half"],
        &file[..],
    ]
    .concat());
    let half = std::fs::read_dir(scratch.path("half/full")).expect("listed");
    assert_eq!(half.count(), 1);

    scratch.ok(&["export", "run", "--time", "1", "--out", "end.ply"]);
    scratch.ok(&[&["render", "end.ply", "--out", "ply"], &file[..]].concat());
    pictures(&scratch, "ply", &NAMES);

    // Times in seconds, and pictures that were loaded smaller.
    for name in ["train", "test"] {
        let path = format!("room/transforms_{name}.json");
        let text = text(&scratch.read(&path)).replace("\"time\": 0.5", "\"time\": 15.0");
        let text = text.replace("\"time\": 0.0", "\"time\": 10.0");
        scratch.write(&path, text.replace("\"time\": 1.0", "\"time\": 20.0"));
    }
    scratch.train_with("small", &["--downscale", "2"]);
    scratch.ok(&["render", "small", "--out", "small_own"]);
    scratch.ok(&[&["render", "small", "--out", "small_listed"], &file[..]].concat());
    let (_, own) = pictures(&scratch, "small_own", &NAMES);
    let (_, listed) = pictures(&scratch, "small_listed", &NAMES);
    for index in 0..3 {
        assert_eq!(own[index]["width"], 16, "as loaded");
        assert_eq!(listed[index]["width"], 32, "as the file states");
        for key in ["img_name", "time", "position"] {
            assert_eq!(own[index][key], listed[index][key], "{key}");
        }
    }
    // The dataset's own units mean nothing to a PLY file.
    scratch.fails(
        &[&["render", "end.ply", "--out", "again"], &file[..]].concat(),
        "from 0 to 1",
    );
}

#[test]
fn a_dataset_that_was_moved_is_found_where_it_is_named() {
    let scratch = Scratch::with_room("n3dv");
    scratch.train("run");
    let scene = scratch.read("run/scene/scene.safetensors");
    let scored = results(&scratch, "run");
    let rename = |from: &str, to: &str| {
        std::fs::rename(scratch.path(from), scratch.path(to)).expect("renamed");
    };
    rename("room", "moved");
    scratch.fails(&["eval", "run"], "--dataset DIR");
    scratch.fails(&["render", "run", "--out", "out"], "--dataset DIR");
    scratch.ok(&["render", "run", "--dataset", "moved", "--out", "out"]);
    scratch.ok(&["eval", "run", "--dataset", "moved"]);
    assert_eq!(results(&scratch, "run")["per_view"], scored["per_view"]);

    // The last third again, with the dataset there.
    let unfinish = || {
        for folder in ["run/checkpoints/000030", "run/scene"] {
            std::fs::remove_dir_all(scratch.path(folder)).expect("removed");
        }
    };
    let finish = |dataset: &str| {
        scratch.ok(&["train", dataset, "--out", "run", "--resume"]);
        assert!(scratch.read("run/scene/scene.safetensors") == scene);
        let config = text(&scratch.read("run/config.toml"));
        assert!(config.contains(&format!("/{dataset}\"")), "{config}");
        scratch.ok(&["eval", "run"]);
    };
    unfinish();
    finish("moved");

    // Once more.
    rename("moved", "last");
    unfinish();
    finish("last");

    scratch.ok(&[
        "synth",
        "other",
        "--cameras",
        "4",
        "--frames",
        "2",
        "--size",
        "32x24",
    ]);
    let other = ["train", "other", "--out", "run", "--resume"];
    for part in [
        "other: expected the 12 views that the run was begun with, found 8",
        "/last or where that was moved",
    ] {
        scratch.fails(&other, part);
    }
}

#[test]
fn videos_are_written_where_ffmpeg_is_there() {
    let scratch = Scratch::with_room("blender");
    scratch.train("run");
    scratch.ok(&[
        "render",
        "run",
        "--cameras",
        "spiral",
        "--frames",
        "3",
        "--out",
        "clip.mp4",
    ]);
    assert!(scratch.read("clip.mp4").len() > 500);
    let spiral = ["render", "run", "--cameras", "spiral", "--frames", "2"];
    scratch.ok(&[&spiral[..], &["--out", "CLIP.MP4"]].concat());
    assert!(scratch.path("CLIP.MP4").is_file());
    scratch.ok(&[&spiral[..], &["--fps", "12", "--out", "slow.mp4"]].concat());
    let rate = |name: &str| {
        let asked = ["-v", "error", "-of", "csv=p=0", "-show_entries"];
        let mut probe = std::process::Command::new("ffprobe");
        probe
            .args(asked)
            .arg("stream=r_frame_rate")
            .arg(scratch.path(name));
        String::from_utf8(probe.output().expect("it runs").stdout).expect("text")
    };
    assert_eq!(
        (rate("clip.mp4").trim(), rate("slow.mp4").trim()),
        ("30/1", "12/1")
    );
    scratch.is_wrong_usage(&[&spiral[..], &["--fps", "12", "--out", "pictures"]].concat());
}

#[test]
fn the_same_configuration_gives_the_same_scene_and_so_does_a_resumed_run() {
    let scratch = Scratch::with_room("n3dv");
    scratch.train("run");
    let scene = scratch.read("run/scene/scene.safetensors");
    scratch.ok(&[
        "train",
        "room",
        "--out",
        "again",
        "--config",
        "run/config.toml",
    ]);
    assert!(
        scratch.read("again/scene/scene.safetensors") == scene,
        "the same configuration"
    );

    let run = scratch.path("again");
    std::fs::remove_dir_all(run.join("checkpoints/000030")).expect("removed");
    std::fs::remove_dir_all(run.join("scene")).expect("removed");
    scratch.ok(&[
        "train",
        "room",
        "--out",
        "again",
        "--resume",
        "--iterations",
        "30",
    ]);
    assert!(
        scratch.read("again/scene/scene.safetensors") == scene,
        "resumed from step 20"
    );

    let wrong = ["train", "room", "--out", "again", "--resume"];
    for other in [
        ["--iterations", "31"],
        ["--seed", "1"],
        ["--preset", "paper"],
        ["--downscale", "2"],
    ] {
        let said = scratch.is_wrong_usage(&[&wrong[..], &other[..]].concat());
        assert!(said.contains("--resume"), "{said}");
    }
}

#[test]
fn progress_is_a_few_plain_lines_and_quiet_says_none() {
    let scratch = Scratch::with_room("n3dv");
    let train = |out: &str, extra: &[&str]| {
        let args = [
            "train",
            "room",
            "--out",
            out,
            "--iterations",
            "20",
            "--preset",
            "quick",
        ];
        let output = scratch
            .command(&[&args[..], &TINY[..], extra].concat())
            .output()
            .expect("starts");
        assert!(output.status.success(), "{}", text(&output.stderr));
        (text(&output.stdout), text(&output.stderr))
    };
    let (summary, progress) = train("loud", &[]);
    assert!(
        summary.contains("PSNR") && summary.contains("written to loud"),
        "{summary}"
    );
    assert!((8..=12).contains(&progress.lines().count()), "{progress}");
    assert!(
        progress.contains("20/20 4D: loss") && !progress.contains(['\r', '\u{1b}']),
        "{progress}"
    );
    assert!(progress.contains("held out: cam00\n"), "{progress}");
    let (_, silence) = train("silent", &["-q", "--threads", "1"]);
    assert_eq!(silence, "");
    let scene = "scene/scene.safetensors";
    assert!(
        scratch.read(&format!("loud/{scene}")) == scratch.read(&format!("silent/{scene}")),
        "the number of threads changes nothing"
    );
}

#[test]
fn both_cpu_backends_train() {
    let scratch = Scratch::with_room("blender");
    for device in ["ndarray", "flex", "wgpu"] {
        let args = [
            "train",
            "room",
            "--out",
            device,
            "--iterations",
            "12",
            "--device",
            device,
        ];
        scratch.ok(&[&args[..], &TINY[..]].concat());
        assert_eq!(results(&scratch, device)["device"], device);
    }
}

#[test]
fn help_shows_examples_and_wrong_usage_exits_with_two() {
    let scratch = Scratch::new();
    for command in [
        "synth", "prepare", "train", "eval", "render", "export", "info",
    ] {
        let help = scratch.ok(&[command, "--help"]);
        assert!(
            help.contains("Example") && help.contains(&format!("dash {command} ")),
            "{help}"
        );
    }
    assert!(scratch.ok(&["--version"]).contains("dash 0."));
    for wrong in [
        &["fly"][..],
        &["train", "room"],
        &["synth", "out", "--size", "32"],
        &["synth", "out", "--cameras", "0"],
        &["synth", "out", "--frames", "0"],
        &["train", "room", "--out", "run", "--set", "dsim=1"],
        &["train", "room", "--out", "run", "--memory", "lots"],
        &["train", "room", "--out", "run", "--downscale", "0.5"],
        &["render", "run", "--time", "0.5", "--frames", "3"],
        &["render", "run", "--time", "1.5"],
        &["render", "run", "--background", "red"],
        &["render", "run", "--out", "clip.mov"],
        &["render", "run", "--out", "clip.GIF"],
        &["prepare", "room", "made", "--fps", "0"],
        &[
            "prepare",
            "room",
            "made",
            "--height",
            "9",
            "--downscale",
            "2",
        ],
        &["prepare", "room", "made", "--random-points", "9"],
        &["info", "room", "--device", "abacus"],
        &["info", "room", "--threads", "0"],
    ] {
        let said = scratch.is_wrong_usage(wrong);
        assert!(said.starts_with("error: "), "{said}");
    }
}

#[test]
fn a_budget_becomes_a_number_of_steps_that_the_run_keeps() {
    let scratch = Scratch::with_room("n3dv");
    let train = |run: &str, more: &[&str]| {
        let args = ["train", "room", "--out", run, "--preset", "quick"];
        let args: Vec<&str> = args.iter().chain(&TINY).chain(more).copied().collect();
        scratch.command(&args).output().expect("the binary starts")
    };
    let output = train("run", &["--budget", "1s"]);
    assert!(output.status.success(), "{}", text(&output.stderr));
    let told = text(&output.stderr);
    assert!(told.contains("1.0 s are "), "{told}");
    let steps = results(&scratch, "run")["iterations"].as_u64();
    let steps = steps.expect("a number");
    let config = String::from_utf8(scratch.read("run/config.toml")).expect("text");
    assert!(
        config.contains(&format!("iterations = {steps}\n")),
        "{config}"
    );
    assert!(told.contains(&format!("are {steps} steps")), "{told}");

    let again = train("run", &["--budget", "1s"]);
    assert!(text(&again.stderr).contains("--resume"));
    assert!(
        !train("other", &["--budget", "1s", "--iterations", "5"])
            .status
            .success()
    );
    assert!(!scratch.path("other").exists());
}
