//! `dash quickstart`, shortened.

use crate::common::Scratch;
use serde_json::Value;

#[test]
fn the_quick_start_ends_in_a_scored_model_and_pictures() {
    let scratch = Scratch::new();
    let told = scratch.ok(&[
        "quickstart",
        "--iterations",
        "40",
        "--scene",
        "tiny",
        "--out",
        "first",
    ]);
    assert!(
        told.contains("PSNR") && told.contains("first/run"),
        "{told}"
    );
    for file in [
        "data/poses_bounds.npy",
        "run/scene/scene.json",
        "run/overview.png",
        "run/renders/full/0000_cam00.png",
        "run/renders/depth/0023_cam00.png",
    ] {
        assert!(scratch.path("first").join(file).is_file(), "{file}");
    }
    let results: Value =
        serde_json::from_slice(&scratch.read("first/run/results.json")).expect("JSON");
    assert_eq!(results["iterations"], 40);
    scratch.fails(&["quickstart", "--out", "first"], "first/data");
}
