//! `dash compare`: runs of several methods, taken up again where they were left.

use crate::common::{Scratch, TINY};

const METHODS: &str = "dash,hexplane,embedding,static";

fn arguments<'a>(methods: &'a str, budget: &'a str) -> Vec<&'a str> {
    of_length(methods, ["--budget", budget])
}

fn of_length<'a>(methods: &'a str, length: [&'a str; 2]) -> Vec<&'a str> {
    let mut args = vec![
        "compare",
        "room",
        "--out",
        "all",
        "--methods",
        methods,
        "--curve",
        "2",
        "--seeds",
        "1",
    ];
    args.extend(length);
    args.extend(TINY);
    args
}

#[test]
fn methods_are_trained_once_and_told_in_one_table() {
    let scratch = Scratch::with_room("n3dv");
    // Short enough that the first trial is the last.
    let told = scratch.ok(&arguments(METHODS, "0.3"));
    for method in METHODS.split(',') {
        let line = told.lines().find(|line| line.starts_with(method));
        let line = line.unwrap_or_else(|| panic!("no line for {method}:\n{told}"));
        let columns: Vec<&str> = line.split_whitespace().collect();
        assert_eq!(columns[1], "1", "{line}");
        let psnr: f64 = columns[4].parse().unwrap_or_else(|e| panic!("{line}: {e}"));
        assert!(psnr > 3.0, "{line}");
        let run = format!("all/{method}/seed-0");
        let curve = String::from_utf8(scratch.read(&format!("{run}/curve.jsonl"))).expect("UTF-8");
        assert_eq!(curve.lines().count(), 2, "{method}");
        assert!(scratch.path(&format!("{run}/scene/scene.json")).is_file());
    }
    let scene = "all/dash/seed-0/results.json";
    let before = scratch.read(scene);
    let again = scratch.ok(&arguments(METHODS, "0.3"));
    assert_eq!(again, told);
    assert_eq!(scratch.read(scene), before);
    // A run that was interrupted is trained again.
    std::fs::remove_file(scratch.path(scene)).expect("removed");
    scratch.ok(&arguments("dash", "0.3"));
    assert!(scratch.path(scene).is_file());
    scratch.fails(&arguments("dash", "0.4"), "compare.toml differs");
    // How fast the machine was is kept with what it measured.
    let speed = String::from_utf8(scratch.read("all/speed.toml")).expect("UTF-8");
    assert!(speed.starts_with("reference_step_secs = "), "{speed}");
    std::fs::remove_file(scratch.path(scene)).expect("removed");
    for bad in ["reference_step_secs = -1.0\n", "reference_step_secs\n"] {
        scratch.write("all/speed.toml", bad);
        scratch.fails(&arguments("dash", "0.3"), "speed.toml");
    }
    scratch.write("all/speed.toml", &speed);
    scratch.ok(&arguments("dash", "0.3"));
    assert_eq!(scratch.read("all/speed.toml"), speed.as_bytes());
}

#[test]
fn methods_of_equal_steps_are_told_with_what_each_brings() {
    let scratch = Scratch::with_room("n3dv");
    let four = "dash,hash,grid4d+dec,grid4d";
    let arguments = [
        &of_length(four, ["--iterations", "12"])[..],
        &["--had-a-say"],
    ]
    .concat();
    let told = scratch.ok(&arguments);
    for method in four.split(',') {
        let line = told.lines().find(|line| line.starts_with(method));
        let line = line.unwrap_or_else(|| panic!("no line for {method}:\n{told}"));
        let columns: Vec<&str> = line.split_whitespace().collect();
        assert_eq!(columns[3], "12", "{line}");
    }
    let page = String::from_utf8(scratch.read("all/report.html")).expect("UTF-8");
    for said in ["Where dash stands", "4D hash less Grid4D", "had a say"] {
        assert!(told.contains(said), "{said}:\n{told}");
        assert!(page.contains(said), "{said}");
    }
    assert!(told.contains("one seed"), "{told}");
    let csv = scratch.read("all/standing.csv");
    assert!(csv.starts_with(b"dash against,"));
}

#[test]
fn what_cannot_be_compared_is_refused() {
    let scratch = Scratch::with_room("n3dv");
    let none = [&arguments("dash", "1")[..], &["--test-cameras", "none"]].concat();
    scratch.fails(&none, "--test-cameras");
    scratch.write("all/notes.txt", "mine");
    scratch.fails(&arguments("dash", "1"), "new or empty folder");
    for (methods, budget) in [("dash,hexplan", "1"), ("dash", "0"), ("dash", "soon")] {
        scratch.is_wrong_usage(&arguments(methods, budget));
    }
    scratch.is_wrong_usage(&of_length("dash", ["--iterations", "0"]));
    let both = [&arguments("dash", "1")[..], &["--iterations", "5"]].concat();
    scratch.is_wrong_usage(&both);
    scratch.is_wrong_usage(&["compare", "room", "--out", "all"]);
}
