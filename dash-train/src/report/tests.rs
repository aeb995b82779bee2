//! Reports of runs' folders that were written by hand.

use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};

use super::*;
use crate::evaluate::CurveLine;
use crate::train::{DataConfig, LogLine, Preset, RunConfig, RunFolder, TrainConfig};

fn config(seed: u64, iterations: usize) -> RunConfig {
    let mut train = TrainConfig::preset(Preset::Quick);
    (train.seed, train.iterations) = (seed, iterations);
    RunConfig::new(
        DataConfig {
            dataset: "room".into(),
            layout: None,
            downscale: 2.0,
            test_cameras: None,
            drop_cameras: Vec::new(),
            frames: None,
            invert_masks: false,
            skip_broken: false,
            backdrop: None,
            device: "flex".into(),
        },
        train,
    )
}

fn curve_line(step: usize, seconds: f64, psnr: f64) -> CurveLine {
    CurveLine {
        step,
        seconds,
        n_views: 12,
        threads: 2,
        psnr: Some(psnr),
        psnr_dynamic: Some(psnr - 4.0),
        ssim: Some(0.9),
        ms_ssim: Some(0.95),
        lpips_vgg: None,
        lpips_alex: None,
        n_static: 1000 + step,
        n_dynamic: 77,
        storage_bytes: 3 << 20,
        render_fps: Some(50.0),
        peak_memory_bytes: Some(300 << 20),
    }
}

fn log_line(step: usize) -> LogLine {
    LogLine {
        step,
        seconds: step as f64 / 10.0,
        loss: 0.125,
        train_psnr: 21.5,
        n_static: 1000,
        n_dynamic: 0,
        waited_seconds: None,
        validation_psnr: None,
        skipped_steps: Vec::new(),
    }
}

/// A run whose PSNR is `psnr` more than 20 dB after 10 steps, and a decibel more after 20.
fn write_run(folder: &Path, name: &str, seed: u64, psnr: f64) -> PathBuf {
    let path = folder.join(name);
    let run = RunFolder::create(&path, &config(seed, 20)).expect("made");
    let lines = |lines: Vec<String>| lines.join("\n") + "\n";
    let json = |line: &dyn Fn(usize) -> String| lines([10, 20].map(line).into());
    let curve = json(&|step| {
        let line = curve_line(
            step,
            step as f64 / 10.0 + psnr,
            19.0 + psnr + step as f64 / 10.0,
        );
        serde_json::to_string(&line).expect("JSON")
    });
    fs::write(run.curve_path(), curve).expect("written");
    let log = json(&|step| serde_json::to_string(&log_line(step)).expect("JSON"));
    fs::write(run.log_path(), log).expect("written");
    path
}

/// Three seeds of one method, and one of another.
fn four_runs(folder: &Path) -> Vec<PathBuf> {
    let mut paths: Vec<PathBuf> = [0.25, 0.75, 0.5]
        .into_iter()
        .enumerate()
        .map(|(seed, psnr)| write_run(folder, &format!("ours-s{seed}"), seed as u64, psnr))
        .collect();
    let other = folder.join("other");
    RunFolder::create(&other, &config(0, 30)).expect("made");
    let line = serde_json::to_string(&curve_line(15, 9.0, 18.5)).expect("JSON");
    fs::write(other.join("curve.jsonl"), line + "\n").expect("written");
    paths.push(other);
    paths
}

fn table<'a>(report: &'a Report, name: &str) -> &'a Table {
    let found = report.blocks.iter().find_map(|block| match block {
        Block::Table(table) if table.name == name => Some(table),
        _ => None,
    });
    found.unwrap_or_else(|| panic!("no table {name}"))
}

fn figure<'a>(report: &'a Report, name: &str) -> &'a Figure {
    let found = report.blocks.iter().find_map(|block| match block {
        Block::Figure(figure) if figure.name == name => Some(figure),
        _ => None,
    });
    found.unwrap_or_else(|| panic!("no figure {name}"))
}

#[test]
fn runs_that_differ_in_the_seed_alone_are_one_group() {
    let folder = tempfile::tempdir().expect("a scratch folder");
    let runs: Vec<RunRecord> = four_runs(folder.path())
        .iter()
        .map(|path| read_run(path).expect("a run"))
        .collect();
    let groups = group_by_seed(runs);
    let labels: Vec<(&str, usize)> = groups
        .iter()
        .map(|group| (group.label.as_str(), group.runs.len()))
        .collect();
    assert_eq!(labels, [("ours", 3), ("other", 1)]);
}

#[test]
fn runs_of_a_comparison_are_named_after_their_methods() {
    let folder = tempfile::tempdir().expect("a scratch folder");
    let method = |name: &str| folder.path().join(name);
    let runs = [("dash", 0, 20), ("dash", 1, 20), ("grid4d+dec", 0, 30)].map(|(name, seed, n)| {
        let path = method(name).join(format!("seed-{seed}"));
        let run = RunFolder::create(&path, &config(seed, n)).expect("made");
        let line = serde_json::to_string(&log_line(10)).expect("JSON");
        fs::write(run.log_path(), line).expect("written");
        read_run(&path).expect("a run")
    });
    assert_eq!(runs[1].name, "dash/seed-1");
    let groups = group_by_seed(runs.into());
    let labels: Vec<&str> = groups.iter().map(|group| group.label.as_str()).collect();
    assert_eq!(labels, ["dash", "grid4d+dec/seed-0"]);
}

#[test]
fn groups_of_one_name_are_told_apart() {
    let folder = tempfile::tempdir().expect("a scratch folder");
    let mut runs = Vec::new();
    for (parent, iterations) in [("a", 20), ("b", 30)] {
        let path = folder.path().join(parent).join("run");
        let run = RunFolder::create(&path, &config(0, iterations)).expect("made");
        let line = serde_json::to_string(&log_line(10)).expect("JSON");
        fs::write(run.log_path(), line).expect("written");
        runs.push(read_run(&path).expect("a run"));
    }
    let groups = group_by_seed(runs);
    let labels: Vec<&str> = groups.iter().map(|group| group.label.as_str()).collect();
    assert_eq!(labels, ["run [1]", "run [2]"]);
}

#[test]
fn lines_are_medians_and_bands_reach_from_lowest_to_highest() {
    let folder = tempfile::tempdir().expect("a scratch folder");
    let report = Report::of_paths(&four_runs(folder.path())).expect("runs");
    let against_seconds = figure(&report, "quality-seconds");
    let psnr = &against_seconds.panels[0];
    assert_eq!(psnr.y.label, "PSNR (dB)");
    let ours = &psnr.series[0];
    let points: Vec<_> = ours.points.iter().map(|p| (p.x, p.y, p.y_range)).collect();
    assert_eq!(
        points,
        [
            (1.5, 20.5, Some([20.25, 20.75])),
            (2.5, 21.5, Some([21.25, 21.75]))
        ]
    );
    assert_eq!(psnr.series[1].points, [Point::new(9.0, 18.5)]);
    let steps = &figure(&report, "quality-steps").panels[0].series[0].points;
    assert_eq!((steps[0].x, steps[1].x), (10.0, 20.0));
    assert_eq!(against_seconds.panels.len(), 4, "LPIPS was not measured");
    for part in [
        "made smaller by 2",
        "rounded to 8 bits",
        "11x11 Gaussian window",
        "background",
        "test views: 12",
        "device: flex",
        "CPU threads: 2",
    ] {
        let caption = &against_seconds.caption;
        assert!(caption.contains(part), "{part} in {caption}");
    }
    assert!(
        report
            .page()
            .contains("Not measured in any run: LPIPS, VGG")
    );
}

#[test]
fn the_summary_has_medians_ranges_and_times_to_best() {
    let folder = tempfile::tempdir().expect("a scratch folder");
    let report = Report::of_paths(&four_runs(folder.path())).expect("runs");
    let csv = table(&report, "summary").csv();
    let mut lines = csv.lines();
    let header: Vec<&str> = lines.next().expect("a header").split(',').collect();
    // No other column before it has a comma in its name.
    let at = |name: &str| header.iter().position(|h| *h == name).expect(name);
    let ours: Vec<&str> = lines.next().expect("a row").split(',').collect();
    // Three seeds stand in one quoted field: "0, 1, 2".
    let shift = 2;
    assert_eq!(ours[0], "ours");
    for (name, expected) in [
        ("PSNR (dB)", "21.5"),
        ("PSNR (dB) lowest", "21.25"),
        ("PSNR (dB) highest", "21.75"),
    ] {
        assert_eq!(ours[at(name) + shift], expected, "{name}");
    }
    let page = report.page();
    // The best is the last measurement, and the one before is a decibel below.
    assert!(
        page.contains("<td>seconds to best −0.5 dB</td><td class=\"number\">2.5 (2.2–2.8)</td>")
    );
}

#[test]
fn every_measurement_is_in_the_csv_and_on_the_page() {
    let folder = tempfile::tempdir().expect("a scratch folder");
    let paths = four_runs(folder.path());
    let report = Report::of_paths(&paths).expect("runs");
    let csv = table(&report, "curves").csv();
    assert_eq!(csv.lines().count(), 1 + 3 * 2 + 1);
    assert!(
        csv.contains("ours,ours-s1,1,20,2.75,21.75,17.75,0.9,0.95,,,1020,77,50,3145728,314572800"),
        "{csv}"
    );
    let page = report.page();
    for run in paths.iter().map(|path| read_run(path).expect("a run")) {
        for line in &run.curve {
            for value in [line.psnr, line.psnr_dynamic] {
                let text = format!(">{:.2}<", value.expect("measured"));
                assert!(page.contains(&text), "{text} of {}", run.name);
            }
        }
    }
}

#[test]
fn the_page_needs_no_other_file() {
    let folder = tempfile::tempdir().expect("a scratch folder");
    let report = Report::of_paths(&four_runs(folder.path())).expect("runs");
    let page = report.page();
    let without_names = page.replace("xmlns=\"http://www.w3.org/2000/svg\"", "");
    for outside in [
        "http:", "https:", "src=", "href=", "url(", "@import", "<script", "<link", "<img",
    ] {
        assert!(!without_names.contains(outside), "{outside} on the page");
    }
    assert!(page.contains("prefers-color-scheme: dark"));
    assert_eq!(page.matches("<svg").count(), page.matches("</svg>").count());
    for label in ["PSNR (dB)", "seconds trained", "ours (3 runs)", "other"] {
        assert!(page.contains(&format!(">{label}</text>")), "{label}");
    }
}

#[test]
fn the_folder_has_a_page_pictures_and_tables() {
    let folder = tempfile::tempdir().expect("a scratch folder");
    let report = Report::of_paths(&four_runs(folder.path())).expect("runs");
    let out = folder.path().join("deep/report");
    let files = report.write(&out).expect("written");
    assert_eq!(files[0], out.join("report.html"));
    for name in [
        "quality-seconds.png",
        "quality-steps.png",
        "quality-cost.png",
        "summary.csv",
        "runs.csv",
        "curves.csv",
        "log.csv",
    ] {
        assert!(files.contains(&out.join(name)), "{name} in {files:?}");
    }
    let picture = image::open(out.join("quality-seconds.png"))
        .expect("a picture")
        .to_rgb8();
    let drawing = figure(&report, "quality-seconds").drawing();
    assert_eq!(f64::from(picture.width()), (2.0 * drawing.width).ceil());
    let blue = [0x00, 0x72, 0xb2];
    assert!(
        picture.pixels().any(|p| p.0 == blue),
        "the first series is drawn"
    );
    report.write(&out).expect("replaces what it wrote");
}

#[test]
fn lines_that_were_cut_off_do_not_count() {
    let folder = tempfile::tempdir().expect("a scratch folder");
    let path = write_run(folder.path(), "run", 0, 0.5);
    for name in ["curve.jsonl", "log.jsonl"] {
        let mut file = fs::OpenOptions::new()
            .append(true)
            .open(path.join(name))
            .expect("there");
        file.write_all(b"{\"step\":30,\"sec").expect("written");
        // A multi-byte character in its middle.
        file.write_all(&[0xe2, 0x82]).expect("written");
    }
    let run = read_run(&path).expect("the rest is whole");
    assert_eq!((run.curve.len(), run.log.len()), (2, 2));
}

#[test]
fn what_is_missing_is_said() {
    let folder = tempfile::tempdir().expect("a scratch folder");
    let path = write_run(folder.path(), "run", 0, 0.5);
    fs::remove_file(path.join("curve.jsonl")).expect("removed");
    let report = Report::of_paths(&[path]).expect("a run with a log");
    assert!(
        !report.blocks.iter().any(
            |block| matches!(block, Block::Figure(figure) if figure.name.starts_with("quality"))
        )
    );
    let page = report.page();
    assert!(page.contains("made without --curve"), "{page}");
    assert!(page.contains("<td>PSNR (dB)</td><td class=\"number\">-</td>"));
    assert!(page.contains("PSNR of training views (dB)"));
}

#[test]
fn runs_on_different_data_have_sections_of_their_own() {
    let folder = tempfile::tempdir().expect("a scratch folder");
    let first = write_run(folder.path(), "run", 0, 0.5);
    let second = folder.path().join("second");
    let mut other = config(0, 20);
    other.data.dataset = "hall".into();
    RunFolder::create(&second, &other).expect("made");
    fs::copy(first.join("curve.jsonl"), second.join("curve.jsonl")).expect("copied");
    let report = Report::of_paths(&[first, second]).expect("runs");
    let page = report.page();
    assert!(page.contains("Training on room") && page.contains("Training on hall"));
    figure(&report, "1-quality-seconds");
    figure(&report, "2-quality-seconds");
}

#[test]
fn names_cannot_break_the_page() {
    let folder = tempfile::tempdir().expect("a scratch folder");
    let name = "<script>alert(1)</script>";
    let path = write_run(folder.path(), "placeholder", 0, 0.5);
    let mut run = read_run(&path).expect("a run");
    run.name = name.into();
    let groups = [RunGroup {
        label: name.into(),
        runs: vec![run],
    }];
    let page = compared("a & b".into(), &groups).page();
    assert!(!page.contains("<script"), "{page}");
    assert!(page.contains("a &amp; b"));
}

#[test]
fn what_is_no_run_is_one_clear_error() {
    let folder = tempfile::tempdir().expect("a scratch folder");
    let error = |paths: &[PathBuf]| Report::of_paths(paths).expect_err("refused").to_string();
    assert!(error(&[]).contains("name at least one"));
    let empty = folder.path().join("empty");
    fs::create_dir(&empty).expect("made");
    assert!(error(&[empty]).contains("expected a run's folder"));
    let missing = folder.path().join("missing");
    assert!(error(std::slice::from_ref(&missing)).contains("missing"));
    let path = write_run(folder.path(), "run", 0, 0.5);
    assert!(error(&[path.clone(), path.join("../run")]).contains("twice"));
    assert!(error(&[path.join("config.toml")]).contains("dash bench"));
    let untouched = folder.path().join("untouched");
    RunFolder::create(&untouched, &config(0, 20)).expect("made");
    assert!(error(&[untouched]).contains("found no whole line"));
    let foreign = folder.path().join("foreign.json");
    fs::write(&foreign, "{\"format\":\"other\"}").expect("written");
    assert!(error(&[foreign]).contains("expected measurements of kernels"));
}
