//! `dash report` and `dash bench` from the command line.

use crate::common::{Scratch, TINY, text};

#[test]
fn a_run_and_a_benchmark_become_one_page() {
    let scratch = Scratch::with_room("n3dv");
    let mut args = vec![
        "train",
        "room",
        "--out",
        "run",
        "--iterations",
        "30",
        "--preset",
        "quick",
        "--curve",
        "3",
    ];
    args.extend(TINY);
    scratch.ok(&args);
    scratch.ok(&[
        "bench",
        "--out",
        "kernels.json",
        "--ops",
        "ssim,adam",
        "--sizes",
        "100,400",
        "--device",
        "flex",
        "--no-stiffness",
    ]);
    let said = scratch.ok(&["report", "run", "kernels.json", "--out", "out"]);
    assert!(said.contains("report.html"), "{said}");
    let page = text(&scratch.read("out/report.html"));
    for part in [
        "Training on room",
        "Kernels: kernels",
        "ssim",
        "seconds trained",
    ] {
        assert!(page.contains(part), "{part}");
    }
    for file in ["quality-seconds.png", "summary.csv", "kernels-forward.png"] {
        assert!(scratch.path("out").join(file).is_file(), "{file}");
    }
    let results: serde_json::Value =
        serde_json::from_slice(&scratch.read("run/results.json")).expect("JSON");
    let psnr = results["psnr"].as_f64().expect("a number");
    assert!(
        page.contains(&format!(">{psnr:.2}<")),
        "the final PSNR is on the page"
    );
}

#[test]
fn what_cannot_be_reported_is_one_error() {
    let scratch = Scratch::new();
    std::fs::create_dir(scratch.path("empty")).expect("made");
    scratch.fails(
        &["report", "empty", "--out", "out"],
        "expected a run's folder",
    );
    scratch.fails(&["report", "nothing", "--out", "out"], "nothing");
    scratch.write("foreign.json", "[1, 2]");
    scratch.fails(&["report", "foreign.json", "--out", "out"], "dash bench");
    scratch.is_wrong_usage(&["report", "--out", "out"]);
    scratch.fails(&["bench", "--out", "no/where.json"], "a folder that exists");
    scratch.is_wrong_usage(&["bench", "--out", "k.json", "--sizes", "0"]);
    scratch.is_wrong_usage(&["bench", "--out", "k.json", "--ops", "sorting"]);
}
