//! Commands that are stopped by a signal, or by a system that takes no more files: what they leave, say and exit with.

use std::fs;
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::thread::yield_now;

use crate::common::{Scratch, TINY, text};
use dash_train::train::latest_checkpoint;

const NOTHING: [PathBuf; 0] = [];

/// A room, a rig's videos and a run.
fn prepared() -> Scratch {
    let scratch = Scratch::with_room("n3dv");
    let rig = "synth rig --layout rig --cameras 3 --frames 40 --size 160x120";
    scratch.ok(&words(rig));
    scratch.train("run");
    scratch
}

fn words(line: &str) -> Vec<&str> {
    line.split_whitespace().collect()
}

/// Every path whose name says that it is not complete.
fn unfinished(folder: &Path) -> Vec<PathBuf> {
    let mut found = Vec::new();
    let mut folders = vec![folder.to_path_buf()];
    while let Some(folder) = folders.pop() {
        // What is removed meanwhile is not there.
        for path in fs::read_dir(&folder)
            .into_iter()
            .flatten()
            .flatten()
            .map(|e| e.path())
        {
            let name = path.file_name().unwrap_or_default().to_string_lossy();
            if name.starts_with('.') || name.ends_with(".partial") {
                found.push(path.clone());
            }
            if path.is_dir() {
                folders.push(path);
            }
        }
    }
    found
}

fn signal(child: &Child, number: i32) {
    // SAFETY: the child is ours and has not been waited for.
    assert_eq!(unsafe { libc::kill(child.id() as i32, number) }, 0);
}

/// Starts a command that no signal was turned off for, as where the tests run in the background of a shell.
fn start(scratch: &Scratch, line: &str) -> Child {
    let mut command = scratch.command(&words(line));
    let listen = || {
        for number in [libc::SIGHUP, libc::SIGINT, libc::SIGTERM] {
            // SAFETY: `signal` may be called between fork and exec, and takes no memory.
            unsafe { libc::signal(number, libc::SIG_DFL) };
        }
        Ok(())
    };
    // SAFETY: as above; the closure does nothing else.
    unsafe { command.pre_exec(listen) };
    command.stdout(Stdio::piped()).stderr(Stdio::piped());
    command.spawn().expect("the binary starts")
}

/// Waits until `seen`, and fails if the command ends before.
#[track_caller]
fn watch(child: &mut Child, seen: impl Fn() -> bool) {
    while !seen() {
        if let Some(status) = child.try_wait().expect("our own child") {
            panic!("ended by itself: {status}");
        }
        yield_now();
    }
}

/// Programs that a process has started.
fn children(id: u32) -> Vec<u32> {
    let mut found = Vec::new();
    for entry in fs::read_dir("/proc").into_iter().flatten().flatten() {
        let stat = fs::read_to_string(entry.path().join("stat")).unwrap_or_default();
        let after_name = stat.rsplit(')').next().unwrap_or_default();
        let parent = after_name.split_whitespace().nth(1);
        if parent.and_then(|parent| parent.parse().ok()) == Some(id) {
            found.extend(entry.file_name().to_string_lossy().parse::<u32>());
        }
    }
    found
}

fn runs(id: u32) -> bool {
    let stat = fs::read_to_string(format!("/proc/{id}/stat")).unwrap_or_default();
    let state = stat
        .rsplit(')')
        .next()
        .unwrap_or_default()
        .trim_start()
        .chars()
        .next();
    state.is_some_and(|state| state != 'Z')
}

#[test]
fn a_signal_leaves_nothing_and_ends_with_its_own_code() {
    let scratch = prepared();
    let synth = "synth out --cameras 8 --frames 200 --size 96x72";
    let rig = "synth out --layout rig --cameras 2 --frames 400 --size 96x72";
    let pictures = "render run --cameras spiral --frames 9000 --out out";
    let deep = "render run --cameras spiral --frames 9000 --out new/deep/out --layers depth";
    let video = "render run --cameras spiral --frames 9000 --out out.mp4";
    let prepare = "prepare rig/videos out --poses rig/transforms.json --random-points 10";
    for (line, number, code) in [
        (synth, libc::SIGINT, 130),
        (synth, libc::SIGHUP, 129),
        (rig, libc::SIGTERM, 143),
        (pictures, libc::SIGINT, 130),
        (deep, libc::SIGTERM, 143),
        (video, libc::SIGINT, 130),
        (video, libc::SIGHUP, 129),
        (prepare, libc::SIGTERM, 143),
    ] {
        let mut child = start(&scratch, line);
        watch(&mut child, || !unfinished(&scratch.path("")).is_empty());
        let programs = children(child.id());
        signal(&child, number);
        let output = child.wait_with_output().expect("our own child");
        let stderr = text(&output.stderr);
        assert_eq!(output.status.code(), Some(code), "{line}: {stderr}");
        assert!(stderr.contains("stopped by SIG"), "{line}: {stderr}");
        assert_eq!(unfinished(&scratch.path("")), NOTHING, "{line}");
        for out in ["out", "out.mp4", "new"] {
            assert!(!scratch.path(out).exists(), "{line} left {out}");
        }
        let going_on: Vec<&u32> = programs.iter().filter(|&&id| runs(id)).collect();
        assert!(going_on.is_empty(), "{line}: {going_on:?} go on");
    }
}

#[test]
fn what_a_killed_command_leaves_is_gone_after_the_next() {
    let scratch = prepared();
    for (long, short) in [
        (
            "synth out --cameras 8 --frames 200 --size 96x72",
            "synth out --cameras 2 --frames 2 --size 32x24",
        ),
        (
            "render run --cameras spiral --frames 9000 --out out.mp4",
            "render run --cameras spiral --frames 3 --out out.mp4",
        ),
        (
            "render run --cameras spiral --frames 9000 --out pictures",
            "render run --cameras spiral --frames 3 --out pictures",
        ),
    ] {
        let mut child = start(&scratch, long);
        watch(&mut child, || !unfinished(&scratch.path("")).is_empty());
        signal(&child, libc::SIGKILL);
        child.wait().expect("our own child");
        assert!(!unfinished(&scratch.path("")).is_empty(), "{long}");
        scratch.ok(&words(short));
        assert_eq!(unfinished(&scratch.path("")), NOTHING, "{short}");
    }
}

fn train_line(out: &str) -> String {
    format!(
        "train room --out {out} --preset quick --iterations 400 --seed 3 {} --set checkpoint_interval=1000",
        TINY.join(" ").replace(", ", ",")
    )
}

#[test]
fn training_answers_a_signal_with_a_checkpoint_and_goes_on_to_the_same_bits() {
    let scratch = Scratch::with_room("n3dv");
    scratch.ok(&words(&train_line("whole")));
    for (number, code) in [
        (libc::SIGINT, 130),
        (libc::SIGTERM, 143),
        (libc::SIGHUP, 129),
    ] {
        let run = format!("stopped-{number}");
        let mut child = start(&scratch, &train_line(&run));
        let log = scratch.path(&run).join("log.jsonl");
        watch(&mut child, || {
            fs::metadata(&log).is_ok_and(|log| log.len() > 0)
        });
        signal(&child, number);
        let output = child.wait_with_output().expect("our own child");
        let stderr = text(&output.stderr);
        assert_eq!(output.status.code(), Some(code), "{stderr}");
        let go_on = format!("go on with `dash train room --out {run} --resume`");
        assert!(stderr.contains(&go_on), "{stderr}");
        let checkpoints = scratch.path(&run).join("checkpoints");
        let newest = latest_checkpoint(&checkpoints).expect("listed");
        assert!(newest.is_some(), "no checkpoint: {stderr}");
        assert_eq!(unfinished(&scratch.path("")), NOTHING);
        scratch.ok(&["train", "room", "--out", &run, "--resume"]);
        for file in ["scene.safetensors", "scene.json"] {
            let of = |run: &str| scratch.read(&format!("{run}/scene/{file}"));
            assert!(of("whole") == of(&run), "{file} after signal {number}");
        }
    }
}

#[test]
fn a_second_signal_stops_training_at_once() {
    let scratch = Scratch::with_room("n3dv");
    let mut child = start(&scratch, &train_line("run"));
    let log = scratch.path("run/log.jsonl");
    watch(&mut child, || {
        fs::metadata(&log).is_ok_and(|log| log.len() > 0)
    });
    // Two of the same kind could become one.
    signal(&child, libc::SIGINT);
    signal(&child, libc::SIGTERM);
    let output = child.wait_with_output().expect("our own child");
    let code = output.status.code();
    assert!(
        code == Some(130) || code == Some(143),
        "{code:?}: {}",
        text(&output.stderr)
    );
    assert_eq!(unfinished(&scratch.path("")), NOTHING);
    scratch.ok(&["train", "room", "--out", "run", "--resume"]);
}

/// Runs a line of the shell in which `$DASH` is the binary.
fn shell(scratch: &Scratch, line: &str) -> Output {
    let mut command = Command::new("sh");
    command
        .args(["-c", line])
        .current_dir(scratch.path(""))
        .env("DASH", env!("CARGO_BIN_EXE_dash"))
        .env("RAYON_NUM_THREADS", "2");
    command.output().expect("there is a shell")
}

#[test]
fn a_signal_that_was_turned_off_before_stays_so() {
    let scratch = Scratch::new();
    let line = "trap '' HUP; exec \"$DASH\" synth out --cameras 4 --frames 30 --size 64x48";
    let mut command = Command::new("sh");
    command.args(["-c", line]).current_dir(scratch.path(""));
    command
        .env("DASH", env!("CARGO_BIN_EXE_dash"))
        .stderr(Stdio::piped());
    let mut child = command.spawn().expect("there is a shell");
    watch(&mut child, || !unfinished(&scratch.path("")).is_empty());
    signal(&child, libc::SIGHUP);
    assert!(child.wait().expect("our own child").success());
    assert!(scratch.path("out/truth.json").is_file());
}

#[test]
fn the_error_names_what_refused_and_offers_what_the_command_has() {
    let scratch = prepared();
    let full = "ulimit -f 4; ";
    for (before, line, says, never) in [
        (
            "TMPDIR=/no/such/folder ",
            "render run --cameras spiral --frames 3 --out a.mp4",
            "",
            "error",
        ),
        (
            "TMPDIR=/no/such/folder ",
            "synth b --layout rig --cameras 2 --frames 2 --size 32x24",
            "",
            "error",
        ),
        (
            "TMPDIR=/no/such/folder ",
            "prepare rig/videos p --poses rig/transforms.json --random-points 9",
            "",
            "error",
        ),
        (
            full,
            "synth c --cameras 2 --frames 2 --size 160x120",
            "File too large",
            "--video",
        ),
        (
            full,
            "synth d --layout rig --cameras 2 --frames 9 --size 160x120",
            "too large",
            "libx264",
        ),
        (
            full,
            "render run --cameras spiral --frames 40 --out e.mp4",
            "too large",
            "libx264",
        ),
        (
            full,
            "render run --cameras spiral --frames 2 --format exr --out f",
            "File too large",
            "--skip-broken",
        ),
        (full, "export run --time 0 --out g.ply", "g.ply", "exists"),
        (
            full,
            "prepare rig/videos h --poses rig/transforms.json --random-points 9",
            "too large",
            "--skip-broken",
        ),
        (
            full,
            "train room --out i --preset quick --iterations 9",
            "too large",
            "--skip-broken",
        ),
        (
            full,
            "doctor room --no-timing --picture j.png",
            "j.png",
            "exists",
        ),
    ] {
        let line = format!("{before}\"$DASH\" {line}");
        let output = shell(&scratch, &line);
        let stderr = text(&output.stderr);
        assert!(stderr.contains(says), "`{says}` in {line}: {stderr}");
        assert!(!stderr.contains(never), "`{never}` in {line}: {stderr}");
        assert_eq!(output.status.success(), says.is_empty(), "{line}: {stderr}");
        assert_eq!(unfinished(&scratch.path("")), NOTHING, "{line}");
    }
}

#[test]
fn a_result_that_cannot_be_written_fails_and_a_reader_that_leaves_does_not_matter() {
    let scratch = prepared();
    for line in [
        "doctor room --no-timing --json",
        "doctor room --no-timing",
        "info room",
        "info run",
        "synth OUT --cameras 2 --frames 2 --size 32x24",
        "export run --time 0 --out OUT.ply",
        "config",
    ] {
        for (n, (to, ok)) in [
            ("> /dev/full", false),
            (">&-", true),
            ("2>&-", true),
            ("| true", true),
            ("2>&1 | true", true),
        ]
        .into_iter()
        .enumerate()
        {
            let out = format!("{}-{n}", line.len());
            let line = format!("\"$DASH\" {} {to}", line.replace("OUT", &out));
            let output = shell(&scratch, &line);
            assert_eq!(
                output.status.success(),
                ok,
                "{line}: {}",
                text(&output.stderr)
            );
            let stderr = text(&output.stderr);
            assert!(
                !stderr.contains("a fault in dash itself"),
                "{line}: {stderr}"
            );
            assert_eq!(unfinished(&scratch.path("")), NOTHING, "{line}");
        }
    }
}
