//! `dash train --backdrop`: a run of the same place.

use crate::common::{Scratch, TINY};
use burn::tensor::Device;
use dash_model::DynamicScene;
use dash_train::train::RunFolder;

#[test]
fn what_differs_from_a_run_of_the_same_place_is_trained() {
    let scratch = Scratch::new();
    let synth = |name: &str, scene: &str| {
        let sizes = ["--cameras", "4", "--frames", "4", "--size", "32x24"];
        scratch.ok(&[&["synth", name, "--scene", scene], &sizes[..]].concat());
    };
    synth("stage", "static");
    synth("take", "bounce");
    let train = |data: &str, steps: &str, more: &[&str]| {
        let mut args = vec!["train", data, "--iterations", steps];
        args.extend(TINY);
        args.extend(more);
        args.into_iter().map(String::from).collect::<Vec<_>>()
    };
    let ok = |args: Vec<String>| {
        let args: Vec<&str> = args.iter().map(String::as_str).collect();
        scratch.ok(&args)
    };
    let quick = ["--preset", "quick"];
    ok(train(
        "stage",
        "60",
        &[&quick[..], &["--out", "empty"]].concat(),
    ));
    let on_stage = ["--out", "first", "--backdrop", "empty"];
    ok(train("take", "20", &[&quick[..], &on_stage].concat()));
    let device = Device::flex();
    let run = RunFolder::open(&scratch.path("first")).expect("a run");
    let own = DynamicScene::load(&run.scene_path(), &device).expect("trained");
    let whole = run.scene(&device).expect("with the stage").counts();
    assert!(
        whole.0 > own.counts().0 && whole.1 == own.counts().1,
        "{whole:?}"
    );
    // Its configuration names the stage, and trains the same again.
    let config = ["--config", "first/config.toml", "--out", "second"];
    ok(train("take", "20", &config));
    for file in ["scene/scene.safetensors", "backdrop.json"] {
        let [first, second] = ["first", "second"].map(|run| scratch.read(&format!("{run}/{file}")));
        assert_eq!(first, second, "{file}");
    }
    let refused = train(
        "take",
        "20",
        &[&quick[..], &["--out", "no", "--backdrop", "stage"]].concat(),
    );
    let refused: Vec<&str> = refused.iter().map(String::as_str).collect();
    scratch.fails(&refused, "config.toml");
    assert!(!scratch.path("no").exists());
    // The stage is needed from then on.
    std::fs::rename(scratch.path("empty"), scratch.path("elsewhere")).expect("movable");
    scratch.fails(&["render", "first", "--cameras", "test"], "empty");
    // A run is not its own.
    let path = scratch.path("first/config.toml");
    let text = String::from_utf8(scratch.read("first/config.toml")).expect("text");
    let named = text
        .lines()
        .find(|line| line.starts_with("backdrop = "))
        .expect("named");
    std::fs::write(&path, text.replace(named, "backdrop = \".\"")).expect("writable");
    scratch.fails(&["render", "first", "--cameras", "test"], "another run");
}
