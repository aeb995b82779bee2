//! Runs the binary in a folder of its own.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

/// Settings with which a tiny scene trains in a moment, but through all three stages.
pub const TINY: [&str; 20] = [
    "--set",
    "method.motion_field.log2_hashmap_size=8",
    "--set",
    "method.field.log2_hashmap_size=8",
    "--set",
    "method.field.hidden=8",
    "--set",
    "initial_points=[0, 300]",
    "--set",
    "checkpoint_interval=10",
    "--set",
    "sh_degree=1",
    "--set",
    "method.stages=[0.1, 0.5]",
    "--set",
    "extensions.following.min_steps=0",
    "--set",
    "method.motion_floor=0",
    "--set",
    "method.static_quantile=0.5",
];

/// A scratch folder in which commands run.
pub struct Scratch {
    folder: tempfile::TempDir,
}

impl Scratch {
    pub fn new() -> Self {
        Self {
            folder: tempfile::tempdir().expect("a scratch folder"),
        }
    }

    /// A folder that holds the dataset `room`: 4 cameras, 3 frames, 32x24 pixels.
    pub fn with_room(layout: &str) -> Self {
        let scratch = Self::new();
        scratch.ok(&[
            "synth",
            "room",
            "--layout",
            layout,
            "--cameras",
            "4",
            "--frames",
            "3",
            "--size",
            "32x24",
        ]);
        scratch
    }

    /// Trains `run` on `room` for 30 steps.
    pub fn train(&self, run: &str) {
        self.train_with(run, &[]);
    }

    /// The same with further arguments.
    pub fn train_with(&self, run: &str, more: &[&str]) {
        let mut args = vec![
            "train",
            "room",
            "--out",
            run,
            "--iterations",
            "30",
            "--preset",
            "quick",
        ];
        args.extend(TINY);
        args.extend(more);
        self.ok(&args);
    }

    pub fn path(&self, path: &str) -> PathBuf {
        self.folder.path().join(path)
    }

    pub fn read(&self, path: &str) -> Vec<u8> {
        let path = self.path(path);
        fs::read(&path).unwrap_or_else(|e| panic!("{}: {e}", path.display()))
    }

    pub fn write(&self, path: &str, bytes: impl AsRef<[u8]>) {
        let path = self.path(path);
        fs::create_dir_all(path.parent().expect("below the scratch folder")).expect("made");
        fs::write(&path, bytes).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
    }

    /// Cuts a file off after `share` of its bytes.
    pub fn truncate(&self, path: &str, share: f64) {
        let bytes = self.read(path);
        self.write(path, &bytes[..(bytes.len() as f64 * share) as usize]);
    }

    pub fn command(&self, args: &[&str]) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_dash"));
        command
            .args(args)
            .current_dir(self.folder.path())
            .env("RAYON_NUM_THREADS", "2");
        command
    }

    /// Runs a command that must succeed; its output.
    pub fn ok(&self, args: &[&str]) -> String {
        let output = self.command(args).output().expect("the binary starts");
        assert!(
            output.status.success(),
            "dash {args:?}: {}",
            text(&output.stderr)
        );
        text(&output.stdout)
    }

    /// Runs a command that must exit with 1, name `part` in the one line it says, and leave every
    /// file as it was.
    pub fn fails(&self, args: &[&str], part: &str) {
        self.fails_as(self.command(args), part);
    }

    /// [`Scratch::fails`] for a prepared command.
    pub fn fails_as(&self, mut command: Command, part: &str) {
        let before = self.listing();
        let output = command.output().expect("the binary starts");
        let stderr = text(&output.stderr);
        let context = format!("{command:?}:\n{stderr}");
        assert_eq!(output.status.code(), Some(1), "{context}");
        assert_eq!(stderr.lines().count(), 1, "one line on stderr: {context}");
        assert!(stderr.starts_with("error: "), "{context}");
        assert!(!stderr.contains("a fault in dash itself"), "{context}");
        assert!(stderr.contains(part), "expected `{part}` in {context}");
        assert!(output.stdout.is_empty(), "{context}");
        assert_eq!(self.listing(), before, "files left behind by {context}");
    }

    /// Runs a command that must exit with 2 and leave every file as it was.
    pub fn is_wrong_usage(&self, args: &[&str]) -> String {
        let before = self.listing();
        let output: Output = self.command(args).output().expect("the binary starts");
        let stderr = text(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "dash {args:?}: {stderr}");
        assert_eq!(self.listing(), before, "files left behind by dash {args:?}");
        stderr
    }

    /// Every path in the scratch folder.
    fn listing(&self) -> BTreeSet<PathBuf> {
        let mut found = BTreeSet::new();
        collect(self.folder.path(), &mut found);
        found
    }
}

fn collect(folder: &Path, found: &mut BTreeSet<PathBuf>) {
    for entry in fs::read_dir(folder).expect("listed") {
        let path = entry.expect("listed").path();
        if path.is_dir() {
            collect(&path, found);
        }
        found.insert(path);
    }
}

pub fn text(bytes: &[u8]) -> String {
    String::from_utf8(bytes.to_vec()).expect("UTF-8")
}
