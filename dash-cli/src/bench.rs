//! `dash bench`: errors and times of the kernels.

use std::io::Write;
use std::path::PathBuf;

use clap::Args;
use dash_model::scene_file::write_atomically;
use dash_train::bench::{BenchOptions, Measurement, Op, Pass, run as measure};
use dash_train::device::DeviceChoice;

use crate::Shared;
use crate::failure::Failure;

/// Measure the kernels: error against their f64 references, and time, on every backend
#[derive(Args)]
#[command(after_help = "Examples:
  dash bench --out kernels.json
  dash bench --out kernels.json --ops hash_encode,ssim --sizes 1000,10000 --device flex
  dash report kernels.json --out out/kernels
  dash bench --out scene.json --ops scene --sizes 106600 --no-stiffness   # pictures and training steps a second
  dash bench --out growth.json --ops growth --sizes 90000 --no-stiffness  # the same of ever larger scenes

Without --device every backend of this build is measured that the machine has; wgpu without a GPU runs
on Mesa's software adapter. Times of a busy machine mean little.")]
pub struct BenchArgs {
    /// The JSON file to write
    #[arg(long, value_name = "FILE.json")]
    out: PathBuf,
    /// Which operations
    #[arg(long, value_enum, value_delimiter = ',', default_values_t = Op::ALL)]
    ops: Vec<Op>,
    /// Points, Gaussians, pixels or values, 1 to 10000000
    #[arg(
        long,
        value_name = "N,..",
        value_delimiter = ',',
        default_values_t = [1_000, 10_000, 100_000],
        value_parser = clap::value_parser!(u64).range(1..=10_000_000)
    )]
    sizes: Vec<u64>,
    /// Leave out the errors of harder and harder inputs
    #[arg(long)]
    no_stiffness: bool,
}

pub fn run(args: &BenchArgs, shared: &Shared) -> Result<String, Failure> {
    // Minutes of work need a place to go.
    let folder = args.out.parent().filter(|p| !p.as_os_str().is_empty());
    if folder.is_some_and(|folder| !folder.is_dir()) || args.out.is_dir() {
        return Err(Failure::new(format!(
            "{}: cannot be written: expected a file's name in a folder that exists; make the folder \
             first or choose another --out",
            args.out.display()
        )));
    }
    let devices = match shared.device {
        Some(choice) => vec![(choice.resolved().to_string(), choice.device()?)],
        None => [
            DeviceChoice::NdArray,
            DeviceChoice::Flex,
            DeviceChoice::Wgpu,
            DeviceChoice::Cuda(0),
        ]
        .into_iter()
        .filter_map(|choice| Some((choice.to_string(), choice.device().ok()?)))
        .collect(),
    };
    let options = BenchOptions {
        ops: args.ops.clone(),
        sizes: args.sizes.iter().map(|&n| n as usize).collect(),
        devices,
        stiffness: !args.no_stiffness,
    };
    let found = measure(&options, &mut |part| tracing::info!("{part}"))?;
    let json = serde_json::to_vec_pretty(&found)
        .map_err(|e| Failure::new(format!("the measurements cannot be written as JSON: {e}")))?;
    write_atomically(&args.out, |mut file| file.write_all(&json))?;
    let scenes = found
        .measurements
        .iter()
        .filter(|m| m.op == Op::Scene.name());
    let scenes: String = scenes.filter_map(scene_line).collect();
    Ok(format!(
        "{scenes}{} measurements and {} of harder inputs written to {}",
        found.measurements.len(),
        found.stiffness.len(),
        args.out.display()
    ))
}

/// What a whole scene took, a line.
fn scene_line(measured: &Measurement) -> Option<String> {
    let ms = measured.time?.median_ms;
    let what = match measured.pass {
        Pass::Forward => "pictures",
        Pass::Gradient => "training steps",
    };
    let (rate, size) = (1e3 / ms, measured.size);
    let asked = measured.asked.as_ref().map_or_else(String::new, |asked| {
        let (launches, reads) = (asked.launches, asked.reads);
        format!(", {launches:.0} launches and {reads:.2} reads each")
    });
    let Measurement {
        backend, variant, ..
    } = measured;
    Some(format!(
        "{backend}: {size} Gaussians, {variant}: {ms:.2} ms, {rate:.1} {what} a second{asked}\n"
    ))
}
