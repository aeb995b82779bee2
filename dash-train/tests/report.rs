//! `dash report` and `dash bench` from the command line.

mod common;

use common::{Bench, TINY, text};

#[test]
fn a_run_and_a_benchmark_become_one_page() {
    let bench = Bench::with_room("n3dv");
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
    bench.ok(&args);
    bench.ok(&[
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
    let said = bench.ok(&["report", "run", "kernels.json", "--out", "out"]);
    assert!(said.contains("report.html"), "{said}");
    let page = text(&bench.read("out/report.html"));
    for part in [
        "Training on room",
        "Kernels: kernels",
        "ssim",
        "seconds trained",
    ] {
        assert!(page.contains(part), "{part}");
    }
    for file in ["quality-seconds.png", "summary.csv", "kernels-forward.png"] {
        assert!(bench.path("out").join(file).is_file(), "{file}");
    }
    let results: serde_json::Value =
        serde_json::from_slice(&bench.read("run/results.json")).expect("JSON");
    let psnr = results["psnr"].as_f64().expect("a number");
    assert!(
        page.contains(&format!(">{psnr:.2}<")),
        "the final PSNR is on the page"
    );
}

#[test]
fn what_cannot_be_reported_is_one_error() {
    let bench = Bench::new();
    std::fs::create_dir(bench.path("empty")).expect("made");
    bench.fails(
        &["report", "empty", "--out", "out"],
        "expected a run's folder",
    );
    bench.fails(&["report", "nothing", "--out", "out"], "nothing");
    bench.write("foreign.json", "[1, 2]");
    bench.fails(&["report", "foreign.json", "--out", "out"], "dash bench");
    bench.is_wrong_usage(&["report", "--out", "out"]);
    bench.fails(&["bench", "--out", "no/where.json"], "a folder that exists");
    bench.is_wrong_usage(&["bench", "--out", "k.json", "--sizes", "0"]);
    bench.is_wrong_usage(&["bench", "--out", "k.json", "--ops", "sorting"]);
}
