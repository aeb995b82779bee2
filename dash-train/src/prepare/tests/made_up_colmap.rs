//! A shell script in the place of COLMAP, which writes models that the test prepared.
#![cfg(unix)]

use std::fs;
use std::os::unix::fs::PermissionsExt;
use std::path::PathBuf;

use super::super::reconstruct::write_model;
use super::super::{PrepareConfig, PrepareSummary, prepare_with};
use super::{Bench, H, W, assert_close, known};
use crate::Error;
use crate::dataset::poses::known::{self as known_poses, KnownCamera};
use crate::ply::read_points;

/// Finds `--output_path` among the arguments; each step notes its arguments in `calls`.
const PROLOGUE: &str = "#!/bin/sh
here=$(dirname \"$0\")
echo \"$@\" >> \"$here/calls\"
step=$1
while [ $# -gt 0 ]; do
  [ \"$1\" = --output_path ] && out=$2
  [ \"$1\" = --database_path ] && : > \"$2\"
  shift
done
";

/// Points near the origin, in three images each.
fn points() -> String {
    (0..50)
        .map(|k| {
            let at = |n: usize| (k * n % 50) as f64 / 50.0 - 0.5;
            format!(
                "{k} {} {} {} 10 20 30 0.3 1 0 2 0 3 0\n",
                at(7),
                at(11),
                at(13)
            )
        })
        .collect()
}

impl Bench {
    /// A program of which the part after the arguments is `body`.
    fn program(&self, body: &str) -> PathBuf {
        let path = self.write("program/colmap", format!("{PROLOGUE}{body}"));
        fs::set_permissions(&path, fs::Permissions::from_mode(0o755)).expect("executable");
        path
    }

    /// `program/NAME`, a model with these cameras and 50 points.
    fn model(&self, name: &str, indices: &[usize]) {
        let folder = self.path(&format!("program/{name}/cameras.txt"));
        let folder = folder.parent().expect("a folder");
        let images: Vec<PathBuf> = indices
            .iter()
            .map(|n| format!("{n:04}.png").into())
            .collect();
        let cameras: Vec<KnownCamera> = indices.iter().map(|&n| known(n)).collect();
        write_model(folder, &images, &cameras).expect("writes");
        fs::write(folder.join("points3D.txt"), points()).expect("writes");
    }

    fn run(&self, body: &str, config: &PrepareConfig) -> Result<PrepareSummary, Error> {
        let program = self.program(body).into_os_string();
        prepare_with(
            &self.path("input"),
            &self.path("out/made"),
            config,
            Some(program),
        )
    }

    fn calls(&self) -> String {
        fs::read_to_string(self.path("program/calls")).expect("was called")
    }
}

#[test]
fn the_largest_model_is_taken_and_its_points_are_written() {
    let bench = Bench::new();
    bench.image_folders(3, 2);
    bench.model("small", &[0, 1]);
    bench.model("large", &[2, 0, 1]);
    let body = "[ $step = mapper ] && cp -r \"$here/small\" \"$out/0\" && cp -r \"$here/large\" \"$out/1\"\nexit 0";
    let summary = bench
        .run(body, &PrepareConfig::default())
        .expect("prepares");
    assert!(
        summary.to_string().contains("one lens for all (OPENCV)"),
        "{summary}"
    );
    let counts = summary.cloud.expect("triangulated");
    assert_eq!((counts.found, counts.kept), (50, summary.n_points));
    let made = bench.path("out/made");
    let names = ["cam1".to_string(), "cam2".to_string()];
    let train = known_poses::read(&made.join("transforms_train.json"), &names, &[[W, H]; 2]);
    for (got, index) in train.expect("reads").iter().zip([1, 2]) {
        assert_close(got, &known(index));
    }
    assert_eq!(
        read_points(&made.join("points3d.ply"))
            .expect("reads")
            .len(),
        counts.kept
    );
    assert!(bench.calls().contains("--ImageReader.single_camera 1"));
}

#[test]
fn cameras_without_a_pose_are_named_after_each_was_given_its_own_lens() {
    let bench = Bench::new();
    bench.image_folders(3, 1);
    bench.model("small", &[0, 2]);
    let body = "[ $step = mapper ] && cp -r \"$here/small\" \"$out/0\"\nexit 0";
    let error = bench
        .run(body, &PrepareConfig::default())
        .expect_err("cam1 is missing");
    bench.check_refusal(&error, &["2 of 3 cameras", "not of cam1;", "--poses"]);
    let calls = bench.calls();
    assert!(
        calls.contains("SIMPLE_RADIAL") && calls.contains("--ImageReader.single_camera 0"),
        "{calls}"
    );

    let body =
        "[ $step = mapper ] && echo 'ERROR: failed to create sparse model' && exit 1\nexit 0";
    let error = bench
        .run(body, &PrepareConfig::default())
        .expect_err("no model");
    bench.check_refusal(&error, &["0 of 3 cameras;"]);
}

#[test]
fn known_poses_are_handed_over_and_kept_as_they_are() {
    let bench = Bench::new();
    bench.image_folders(3, 1);
    bench.model("found", &[0, 1, 2]);
    let config = PrepareConfig {
        poses: Some(bench.poses(3)),
        ..PrepareConfig::default()
    };
    let body = "[ $step = point_triangulator ] && cp \"$here\"/found/* \"$out\"\nexit 0";
    let summary = bench.run(body, &config).expect("prepares");
    assert_eq!(summary.cloud.map(|counts| counts.found), Some(50));
    assert!(bench.calls().contains("--clear_points 1") && !bench.calls().contains("mapper"));
}

#[test]
fn complaints_are_quoted_and_nothing_is_left_behind() {
    let bench = Bench::new();
    bench.image_folders(2, 1);
    let body =
        "[ $step = exhaustive_matcher ] || exit 0\necho 'no room for the matches' >&2; exit 3";
    let error = bench
        .run(body, &PrepareConfig::default())
        .expect_err("fails");
    bench.check_refusal(
        &error,
        &["exhaustive_matcher failed", "no room for the matches", "3"],
    );
    // Success without a result.
    let error = bench
        .run("exit 0", &PrepareConfig::default())
        .expect_err("no model");
    bench.check_refusal(&error, &["0 of 2 cameras"]);
    let missing = Some("colmap-that-does-not-exist".into());
    for (poses, words) in [
        (None, ["apt install colmap", "--poses"]),
        (Some(bench.poses(2)), ["conda", "--random-points"]),
    ] {
        let config = PrepareConfig {
            poses,
            ..PrepareConfig::default()
        };
        let (input, out) = (bench.path("input"), bench.path("out/made"));
        let error = prepare_with(&input, &out, &config, missing.clone()).expect_err("missing");
        bench.check_refusal(&error, &words);
    }
}
