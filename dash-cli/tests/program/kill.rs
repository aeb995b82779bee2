//! A run that is killed at any moment, also while it writes a checkpoint, loses no checkpoint and
//! resumes to the same bits.

use std::fs;
use std::path::Path;
use std::process::{Child, ExitStatus, Stdio};
use std::sync::Arc;
use std::thread::yield_now;

use crate::common::{Scratch, TINY, text};
use burn::tensor::Device;
use dash_train::dataset::{Dataset, LoadOptions, load};
use dash_train::train::{RunFolder, latest_checkpoint, load_checkpoint};
use rand::{Rng, SeedableRng};
use rand_pcg::Pcg64;

/// The step of the last kill at the latest, of 300: the end must not come before it.
const LAST_KILL: usize = 270;

/// Every other one is meant for the writing of a checkpoint.
const KILLS: usize = 20;

/// How often the run's folder is looked at, at most, before a kill between two checkpoints.
const MOST_LOOKS: usize = 1000;

/// [`TINY`], with density control and opacity resets of both sets, and the mean of the last quarter.
fn arguments(run: &str) -> Vec<&str> {
    let mut args = vec!["train", "room", "--out", run, "--preset", "quick"];
    args.extend(["--iterations", "300", "--seed", "7"]);
    args.extend(TINY);
    for assignment in [
        "checkpoint_interval=3",
        "densify.interval=10",
        "densify.opacity_reset_interval=40",
        "extensions.averaging.share=0.25",
    ] {
        args.extend(["--set", assignment]);
    }
    args
}

/// The step of the newest complete checkpoint.
fn newest(run: &RunFolder) -> usize {
    let path = latest_checkpoint(&run.checkpoints_path()).expect("listed");
    path.map_or(0, |path| {
        let name = path.file_name().and_then(|name| name.to_str());
        name.and_then(|name| name.parse().ok()).expect("a number")
    })
}

/// Whether a checkpoint is begun and not complete.
fn is_writing(run: &RunFolder) -> bool {
    fs::read_dir(run.checkpoints_path()).is_ok_and(|mut entries| {
        entries
            .any(|entry| entry.is_ok_and(|e| e.path().extension().is_some_and(|x| x == "partial")))
    })
}

/// Looks at the run's folder until `arrived`, and fails if the process ends before.
#[track_caller]
fn watch(child: &mut Child, mut arrived: impl FnMut() -> bool) {
    while !arrived() {
        if let Some(status) = child.try_wait().expect("our own child") {
            let mut stderr = Vec::new();
            let pipe = child.stderr.as_mut().expect("piped");
            std::io::Read::read_to_end(pipe, &mut stderr).expect("read");
            panic!("ended by itself, {status}: {}", text(&stderr));
        }
        yield_now();
    }
}

/// The newest checkpoint must be whole: its step, after everything in it was read.
fn readable(run: &RunFolder, dataset: &Arc<Dataset>) -> usize {
    let Some(path) = latest_checkpoint(&run.checkpoints_path()).expect("listed") else {
        return 0;
    };
    let (trainer, _) =
        load_checkpoint(&path, dataset.clone(), &Device::flex()).unwrap_or_else(|e| panic!("{e}"));
    trainer.steps_done()
}

fn killed(mut child: Child) -> ExitStatus {
    child.kill().expect("our own child");
    child.wait().expect("our own child")
}

fn scene(run: &Path) -> [Vec<u8>; 2] {
    ["scene.safetensors", "scene.json"].map(|name| {
        let path = run.join("scene").join(name);
        fs::read(&path).unwrap_or_else(|e| panic!("{}: {e}", path.display()))
    })
}

#[test]
fn a_run_killed_at_random_moments_loses_no_checkpoint_and_ends_with_the_same_bits() {
    let scratch = Scratch::with_room("n3dv");
    let dataset = Arc::new(load(&scratch.path("room"), &LoadOptions::default()).expect("sound"));
    scratch.ok(&arguments("whole"));

    let mut rng = Pcg64::seed_from_u64(11);
    let mut while_writing = 0;
    for kill in 0..KILLS {
        let mut args = vec!["train", "room", "--out", "killed", "--resume"];
        if kill == 0 {
            args = arguments("killed");
        }
        let mut command = scratch.command(&args);
        command.stdout(Stdio::null()).stderr(Stdio::piped());
        let mut child = command.spawn().expect("the binary starts");
        watch(&mut child, || scratch.path("killed/config.toml").is_file());
        let run = RunFolder::open(&scratch.path("killed")).expect("just seen");

        // The first before there is a checkpoint, the others spread over the whole run.
        if kill > 0 {
            let [from, to] = [kill, kill + 1].map(|part| part * LAST_KILL / KILLS);
            let step = rng.random_range(from..to);
            watch(&mut child, || newest(&run) >= step);
        }
        if kill % 2 == 1 {
            watch(&mut child, || is_writing(&run));
        } else if kill > 0 {
            let step = newest(&run);
            let mut looks = rng.random_range(0..MOST_LOOKS);
            watch(&mut child, || {
                looks = looks.saturating_sub(1);
                looks == 0 || newest(&run) > step
            });
        }
        let before = newest(&run);
        let status = killed(child);
        assert!(!status.success(), "the run was over before kill {kill}");
        let was_writing = is_writing(&run);
        while_writing += usize::from(was_writing);
        let after = readable(&run, &dataset);
        eprintln!("kill {kill}: step {before} -> {after}, while writing: {was_writing}");
        assert!(
            after >= before && after == newest(&run),
            "kill {kill}: step {after} can be read, step {before} was there before"
        );
    }
    assert!(
        while_writing > 0,
        "no kill fell into the writing of a checkpoint"
    );

    scratch.ok(&["train", "room", "--out", "killed", "--resume"]);
    let (whole, resumed) = (scratch.path("whole"), scratch.path("killed"));
    let same = scene(&whole) == scene(&resumed);
    assert!(same, "the resumed run's scene has other bits");
    let left = RunFolder::open(&resumed).expect("a run");
    let counts = left.scene(&Device::flex()).expect("a scene").counts();
    assert!(counts.0 > 0 && counts.1 > 0, "an empty set: {counts:?}");
    assert!(!is_writing(&left), "half a checkpoint is left behind");
    let steps = |run: &Path| -> Vec<usize> {
        let lines = RunFolder::open(run).and_then(|run| run.log());
        lines.expect("a log").iter().map(|line| line.step).collect()
    };
    assert_eq!(steps(&whole), steps(&resumed), "lines of the log");
}
