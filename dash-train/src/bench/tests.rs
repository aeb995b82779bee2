//! What a small measurement holds.

use burn::tensor::Device;

use super::*;
use crate::report::{Block, Cell, Report, kernel_blocks};

/// The largest 99th percentile of relative errors that f32 kernels have in their own tests.
const P99: f64 = 1e-3;

fn small(ops: &[Op], stiffness: bool) -> KernelBench {
    let options = BenchOptions {
        ops: ops.to_vec(),
        sizes: vec![300, 1500],
        devices: vec![("flex".into(), Device::flex())],
        stiffness,
    };
    run(&options, &mut |_| {}).expect("measured")
}

#[test]
fn every_operation_is_measured_and_agrees_with_its_reference() {
    let bench = small(&Op::ALL, false);
    for op in Op::ALL {
        let own = || bench.measurements.iter().filter(|m| m.op == op.name());
        assert!(own().any(|m| m.pass == Pass::Forward), "{op}");
        let has_gradient = own().any(|m| m.pass == Pass::Gradient);
        assert_eq!(has_gradient, op != Op::Adam, "{op}");
        for m in own().filter(|m| m.variant != hash_encode::HALF_TABLE) {
            let p99 = m.error.relative.p99.expect("finite");
            assert!(p99 < P99 && m.error.n_values > 0, "{m:?}");
            assert_eq!(m.error.n_not_finite, 0, "{m:?}");
            let time = m.time.expect("timed");
            assert!(time.first_quartile_ms <= time.median_ms, "{m:?}");
            assert!(time.median_ms <= time.third_quartile_ms, "{m:?}");
        }
    }
    // A negative control: half precision is visibly worse.
    let rms = |variant: &str| {
        let found = bench.measurements.iter().find(|m| m.variant == variant);
        found.and_then(|m| m.error.absolute.rms).expect("measured")
    };
    assert!(rms(hash_encode::HALF_TABLE) > 50.0 * rms("linear"));
}

#[test]
fn a_scene_is_timed_with_the_field_of_each_preset() {
    let options = BenchOptions {
        ops: vec![Op::Scene],
        sizes: vec![60],
        devices: vec![("flex".into(), Device::flex())],
        stiffness: true,
    };
    let bench = run(&options, &mut |_| {}).expect("measured");
    let variants = ["field of quick", "field of default", "field of paper"];
    let expected = variants.map(|v| [(v, Pass::Forward), (v, Pass::Gradient)]);
    let found: Vec<_> = bench
        .measurements
        .iter()
        .map(|m| (m.variant.as_str(), m.pass))
        .collect();
    assert_eq!(found, expected.as_flattened());
    for m in &bench.measurements {
        assert!(m.time.expect("timed").median_ms > 0.0, "{m:?}");
        assert_eq!(m.error, ErrorStats::default(), "it has no reference");
    }
    assert!(bench.stiffness.is_empty());
}

#[test]
fn growing_scenes_are_timed_along_every_axis() {
    let device = Device::flex();
    let target = Target {
        name: "flex",
        device: &device,
    };
    let mut bench = Bench {
        on_part: &mut |_| {},
        found: KernelBench::new(rayon::current_num_threads()),
    };
    let base = scene::Made {
        size: [32, 24],
        ..scene::Made::of(90)
    };
    growth::sweep(&mut bench, target, base).expect("measured");
    let bench = bench.found;
    let values = |what: &str, pass: Pass| -> Vec<usize> {
        let own = bench.measurements.iter();
        let own = own.filter(|m| m.variant == what && m.pass == pass);
        own.map(|m| m.size).collect()
    };
    for pass in [Pass::Forward, Pass::Gradient] {
        assert_eq!(values("Gaussians", pass), [10, 30, 90, 270, 810]);
        assert_eq!(values("frames", pass), [24, 75, 300, 1200]);
        assert_eq!(values("percent that moves", pass), [0, 5, 20, 50, 90]);
        assert_eq!(values("pixels", pass).len(), 5);
        let all = rayon::current_num_threads();
        assert_eq!(values("threads", pass).last(), Some(&all));
    }
    let blocks = kernel_blocks(&bench, "");
    let mut figures = blocks.iter().filter_map(|block| match block {
        Block::Figure(figure) => Some(figure),
        _ => None,
    });
    let figure = figures.next_back().expect("drawn");
    assert_eq!(figure.panels.len(), 5);
    for panel in &figure.panels {
        let lines = panel.series.iter().map(|series| series.points.len());
        assert!(
            lines.clone().count() == 2 && lines.min() > Some(0),
            "{}",
            panel.title
        );
    }
}

#[test]
fn needles_break_the_textbook_form_alone() {
    let bench = small(&[Op::Project], true);
    let at = |variant: &str, px: f64| {
        let found = bench
            .stiffness
            .iter()
            .find(|p| p.op == "determinant" && p.variant == variant && p.value == px);
        found.and_then(|p| p.error.relative.max).expect("measured")
    };
    assert!(at("cross product", 65e3) < 1e-5);
    assert!(at("a c − b²", 65e3) > 1.0);
    let kernels = bench
        .stiffness
        .iter()
        .filter(|p| p.op.starts_with("project: "));
    for point in kernels {
        assert!(point.error.relative.p99.expect("finite") < P99, "{point:?}");
    }
}

#[test]
fn crowds_and_tables_of_all_sizes_are_finite() {
    for point in &small(&[Op::Rasterize], true).stiffness {
        assert_eq!(point.error.n_not_finite, 0, "{point:?}");
        assert!(point.error.relative.rms.is_some(), "{point:?}");
    }
}

#[test]
fn a_file_is_read_back_and_its_report_has_every_number() {
    let bench = small(&[Op::Ssim, Op::Adam], false);
    let folder = tempfile::tempdir().expect("a scratch folder");
    let path = folder.path().join("kernels.json");
    let json = serde_json::to_vec_pretty(&bench).expect("JSON");
    std::fs::write(&path, json).expect("written");
    let read = read_bench(&path).expect("our own");
    assert_eq!(read.measurements.len(), bench.measurements.len());
    for (read, m) in read.measurements.iter().zip(&bench.measurements) {
        assert_eq!((&read.op, &read.variant), (&m.op, &m.variant));
        let rms = |m: &Measurement| m.error.relative.rms.expect("finite");
        assert!((rms(read) - rms(m)).abs() <= 1e-12 * rms(m));
    }
    let blocks = kernel_blocks(&bench, "");
    let page = Report {
        title: "kernels".into(),
        blocks: blocks.clone(),
    }
    .page();
    for text in [
        "ssim",
        "adam",
        "median time (ms)",
        "99th percentile",
        "quartiles",
    ] {
        assert!(page.contains(text), "{text}");
    }
    let table = blocks.iter().find_map(|block| match block {
        Block::Table(table) if table.name == "measurements" => Some(table),
        _ => None,
    });
    let table = table.expect("a table of all measurements");
    assert_eq!(table.rows.len(), bench.measurements.len());
    for (row, m) in table.rows.iter().zip(&bench.measurements) {
        let time = m.time.expect("timed");
        assert!(row.contains(&Cell::Number(time.median_ms, 3)), "{row:?}");
        let bias = m.error.relative.bias.expect("finite");
        assert!(row.contains(&Cell::Number(bias, 2)), "{row:?}");
    }
}

#[test]
fn another_file_is_refused() {
    let folder = tempfile::tempdir().expect("a scratch folder");
    let path = folder.path().join("kernels.json");
    let mut bench = KernelBench::new(1);
    bench.format = "dash-kernel-bench-0".into();
    std::fs::write(&path, serde_json::to_vec(&bench).expect("JSON")).expect("written");
    let error = read_bench(&path).expect_err("another format").to_string();
    assert!(error.contains("dash-kernel-bench-0"), "{error}");
}
