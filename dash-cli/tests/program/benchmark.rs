//! `dash benchmark`: a protocol on made-up scenes, beside what is published.

use crate::common::{Scratch, TINY};

fn arguments<'a>(protocol: &'a str, data: &'a str, more: &[&'a str]) -> Vec<&'a str> {
    let mut args = vec![
        "benchmark",
        protocol,
        data,
        "--out",
        "all",
        "--preset",
        "quick",
        "--iterations",
        "20",
    ];
    args.extend(TINY);
    args.extend(more);
    args
}

fn scene(scratch: &Scratch, folder: &str, layout: &str, cameras: &str) {
    scratch.ok(&[
        "synth",
        folder,
        "--layout",
        layout,
        "--cameras",
        cameras,
        "--frames",
        "3",
        "--size",
        "32x24",
    ]);
}

#[test]
fn scenes_that_are_there_are_told_beside_published_ones() {
    let scratch = Scratch::new();
    scene(&scratch, "data/coffee_martini", "n3dv", "4");
    let drop = ["--drop-cameras", "coffee_martini:cam02"];
    let told = scratch.ok(&arguments("n3dv", "data", &drop));
    for words in [
        "camera 0, at every frame",
        "11x11 Gaussian window",
        "flame_salmon_1: 0 to 299",
        "cook_spinach, cut_roasted_beef",
        "coffee_martini: 32x24 pixels instead of 1352x1014; 3 frames instead of 300; without cam02",
        "31.53, NeRFPlayer",
        "over 1 of 6 scenes",
    ] {
        assert!(told.contains(words), "`{words}` is not in:\n{told}");
    }
    let results = scratch.read("all/coffee_martini/seed-0/results.json");
    assert_eq!(scratch.ok(&arguments("n3dv", "data", &drop)), told);
    assert_eq!(
        scratch.read("all/coffee_martini/seed-0/results.json"),
        results
    );
    scratch.fails(&arguments("n3dv", "data", &[]), "benchmark.toml differs");
    // More seeds are added; one scene's folder is enough, elsewhere.
    let seeds = [&drop[..], &["--seeds", "2"]].concat();
    scratch.ok(&arguments("n3dv", "data", &seeds));
    assert!(
        scratch
            .path("all/coffee_martini/seed-1/results.json")
            .is_file()
    );

    let run = "all/coffee_martini/seed-0";
    scratch.ok(&["report", run, "--out", "page"]);
    let page = String::from_utf8(scratch.read("page/report.html")).expect("UTF-8");
    assert!(page.contains("Published of coffee_martini (Neural 3D Video)"));
    assert!(page.contains("arXiv 2312.16812"));
}

#[test]
fn what_is_no_scene_of_a_protocol_is_refused() {
    let scratch = Scratch::with_room("n3dv");
    scratch.fails(
        &arguments("panoptic", "room", &[]),
        "basketball, boxes, football",
    );
    scratch.fails(&arguments("n3dv", "nowhere", &[]), "nowhere");
    scene(&scratch, "data/sear_steak", "n3dv", "3");
    let of = |more: &[&'static str]| arguments("n3dv", "data", more);
    scratch.fails(&of(&["--scenes", "flame_steak"]), "flame_steak");
    scratch.fails(&of(&["--scenes", "basketball"]), "--scenes");
    scratch.fails(&of(&["--drop-cameras", "steak:cam01"]), "`steak`");
    scratch.fails(&of(&["--drop-cameras", "cam09"]), "--drop-cameras");
    scratch.is_wrong_usage(&of(&["--drop-cameras", "steak:"]));
    scratch.is_wrong_usage(&arguments("d-nerv", "data", &[]));
    scratch.is_wrong_usage(&of(&["--seeds", "0"]));
}
