//! `dash plan`, `work` and `join`: runs that any number of processes share.

use std::fs;
use std::path::Path;
use std::process::{Child, Stdio};
use std::thread::sleep;
use std::time::Duration;

use crate::common::{Scratch, TINY, text};
use dash_train::jobs::Plan;
use rand::{Rng, SeedableRng};
use rand_pcg::Pcg64;

/// Moments at which a worker is killed.
const KILLS: usize = 8;

/// Two methods from two seeds.
fn compared<'a>(out: &'a str, before: &[&'a str]) -> Vec<&'a str> {
    let mut args = before.to_vec();
    args.extend([
        "compare",
        "room",
        "--out",
        out,
        "--methods",
        "dash,hexplane",
    ]);
    args.extend(["--seeds", "2", "--curve", "1", "--iterations", "40"]);
    args.extend(TINY);
    args.extend(["--set", "checkpoint_interval=3"]);
    args
}

fn spawn(scratch: &Scratch, args: &[&str]) -> Child {
    let mut command = scratch.command(args);
    command.stdout(Stdio::piped()).stderr(Stdio::piped());
    command.spawn().expect("the binary starts")
}

/// What a process that must succeed says.
#[track_caller]
fn ended(child: Child) -> String {
    let output = child.wait_with_output().expect("our own child");
    assert!(output.status.success(), "{}", text(&output.stderr));
    text(&output.stdout)
}

fn scene(out: &Path, run: &str) -> Vec<u8> {
    let path = out.join(run).join("scene/scene.safetensors");
    fs::read(&path).unwrap_or_else(|e| panic!("{}: {e}", path.display()))
}

/// The number in front of a word.
fn count(told: &str, what: &str) -> usize {
    let parts = told.trim().trim_start_matches("tasks: ").split(", ");
    let number = |part: &str| part.strip_suffix(what)?.trim().parse().ok();
    parts.filter_map(number).next().unwrap_or(0)
}

#[test]
fn workers_share_the_runs_of_a_plan_and_give_the_bits_of_one_process() {
    let scratch = Scratch::with_room("n3dv");
    scratch.ok(&compared("whole", &[]));
    let told = scratch.ok(&compared("shared", &["plan"]));
    for line in ["4 tasks", "0  dash/seed-0", "3  hexplane/seed-1"] {
        assert!(told.contains(line), "{line}:\n{told}");
    }
    scratch.fails(
        &["join", "shared"],
        "found 4 missing: dash/seed-0, dash/seed-1",
    );

    // Two take what is free, and two want the same.
    let all = ["work", "shared"];
    let last = ["work", "shared", "--task", "3"];
    let workers = [&all[..], &all, &last, &last].map(|args| spawn(&scratch, args));
    let told = workers.map(ended);
    let done: usize = told.iter().map(|told| count(told, " done")).sum();
    assert_eq!(done, 4, "each run once: {told:?}");
    assert_eq!(count(&scratch.ok(&["work", "shared"]), " done before"), 4);

    let joined = scratch.ok(&["join", "shared"]);
    assert!(joined.contains("Where dash stands"), "{joined}");
    let shared = scratch.path("shared");
    for task in Plan::read(&shared).expect("whole").tasks() {
        let same = scene(&shared, &task.run) == scene(&scratch.path("whole"), &task.run);
        assert!(same, "{} has other bits", task.run);
        assert!(!shared.join(&task.run).join("checkpoints").exists());
    }
    assert!(scratch.path("shared/report.html").is_file());
    // More seeds are added to what is done, which the command itself goes on with, too.
    let more = compared("shared", &["plan"])
        .into_iter()
        .map(|arg| match arg {
            "2" => "3",
            other => other,
        });
    let more: Vec<&str> = more.collect();
    scratch.ok(&more);
    scratch.fails(
        &["join", "shared"],
        "found 2 missing: dash/seed-2, hexplane/seed-2",
    );
}

#[test]
fn workers_that_are_killed_lose_nothing_and_join_tells_the_truth() {
    let scratch = Scratch::with_room("n3dv");
    scratch.ok(&compared("whole", &[]));
    scratch.ok(&compared("killed", &["plan"]));
    let killed = scratch.path("killed");
    let plan = Plan::read(&killed).expect("whole");
    let mut rng = Pcg64::seed_from_u64(3);
    for _ in 0..KILLS {
        let mut workers = [(); 2].map(|()| spawn(&scratch, &["work", "killed"]));
        sleep(Duration::from_millis(rng.random_range(50..600)));
        for worker in &mut workers {
            worker.kill().expect("our own child");
            worker.wait().expect("our own child");
        }
        let missing = plan.missing(&killed).expect("no scores are half written");
        match missing.as_slice() {
            [] => {
                scratch.ok(&["join", "killed"]);
            }
            [first, ..] => {
                let found = format!("found {} missing: {first}", missing.len());
                scratch.fails(&["join", "killed"], &found);
            }
        }
    }
    scratch.ok(&["work", "killed"]);
    scratch.ok(&["join", "killed"]);
    for task in plan.tasks() {
        let same = scene(&killed, &task.run) == scene(&scratch.path("whole"), &task.run);
        assert!(same, "{} has other bits", task.run);
    }
}

#[test]
fn scenes_of_a_benchmark_are_tasks_too() {
    let scratch = Scratch::new();
    let room = "data/coffee_martini";
    scratch.ok(&[
        "synth",
        room,
        "--cameras",
        "4",
        "--frames",
        "3",
        "--size",
        "32x24",
    ]);
    let mut args = vec![
        "plan",
        "benchmark",
        "n3dv",
        "data",
        "--out",
        "all",
        "--slurm",
    ];
    args.extend(["--seeds", "2", "--preset", "quick", "--iterations", "20"]);
    args.extend(TINY);
    let script = scratch.ok(&args);
    assert!(script.starts_with("#!/bin/sh\n"), "{script}");
    assert!(script.contains("--array=0-1 "), "{script}");
    for task in ["1", "0"] {
        let told = scratch.ok(&["work", "all", "--task", task]);
        assert_eq!(count(&told, " done"), 1, "{told}");
    }
    let joined = scratch.ok(&["join", "all"]);
    assert!(joined.contains("over 1 of 6 scenes"), "{joined}");
}

#[test]
fn a_task_that_fails_does_not_keep_others_from_being_done() {
    let scratch = Scratch::with_room("n3dv");
    scratch.ok(&compared("all", &["plan"]));
    // Another run is where the first task's is to go.
    scratch.train("all/dash/seed-0");
    fs::remove_file(scratch.path("all/dash/seed-0/results.json")).expect("scored");
    let output = scratch.command(&["work", "all"]).output().expect("starts");
    assert_eq!(output.status.code(), Some(1));
    let told = text(&output.stderr);
    let last = told.lines().last().expect("an error");
    assert!(
        last.contains("dash/seed-0 failed") && last.contains("3 done"),
        "{last}"
    );
    scratch.fails(&["join", "all"], "found 1 missing: dash/seed-0");
}

#[test]
fn what_cannot_be_planned_is_refused() {
    let scratch = Scratch::with_room("n3dv");
    let timed = ["plan", "compare", "room", "--budget", "9", "--out", "all"];
    assert!(scratch.is_wrong_usage(&timed).contains("--iterations"));
    scratch.is_wrong_usage(&["plan", "train", "room", "--out", "all"]);
    let no_views = [&compared("all", &["plan"])[..], &["--test-cameras", "none"]].concat();
    scratch.fails(&no_views, "--test-cameras");
    scratch.fails(&["work", "room"], "plan.json");
    scratch.fails(&["join", "room"], "plan.json");
    scratch.ok(&compared("all", &["plan"]));
    assert!(
        scratch
            .is_wrong_usage(&["work", "all", "--task", "4"])
            .contains("from 0 to 3")
    );
    let others = [&compared("all", &["plan"])[..], &["--set", "sh_degree=0"]].concat();
    scratch.fails(&others, "compare.toml differs");
}
