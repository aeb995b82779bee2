//! `dash doctor`: what is wrong with a dataset, and how to mend it.

use std::path::PathBuf;

use clap::Args;
use dash_train::dataset::{FrameRange, Layout, LoadOptions};
use dash_train::doctor::{Diagnosis, Severity, TimedOn, examine_timed};

use crate::Shared;
use crate::failure::{self, Failure};
use crate::values::{self, CameraList};

/// Check a dataset: say what is wrong with it and how to mend it
#[derive(Args)]
#[command(after_help = "Examples:
  dash doctor out/room
  dash doctor flame_steak --downscale 2 --picture flame_steak.png
  dash doctor flame_steak --json

One line per finding: ok, note, warning or error, what was looked at, what was found, and after -> how to
mend it. The exit code is 1 with an error among them, else 0.")]
pub struct DoctorArgs {
    /// The dataset's folder, of any layout
    dataset: PathBuf,
    /// Write JSON: an object with dataset, worst and findings, each with check, severity, text and mend
    #[arg(long)]
    json: bool,
    /// Draw cameras (blue, held out orange, doubtful red), points and training box (green) from above and
    /// from the side [default file: doctor.png]
    #[arg(long, value_name = "FILE.png", num_args = 0..=1, default_missing_value = "doctor.png")]
    picture: Option<PathBuf>,
    /// Force the dataset's layout instead of recognising it by its files
    #[arg(long, value_enum)]
    layout: Option<Layout>,
    /// Indices of the cameras to hold out, such as 0,7, or none; the layout's own choice when left out
    #[arg(long, value_name = "LIST")]
    test_cameras: Option<CameraList>,
    /// Frames to use, such as 151-200, or all, as `dash train` takes them
    #[arg(long, value_name = "FIRST-LAST")]
    frames: Option<FrameRange>,
    /// Make images smaller by this factor [default: 1]
    #[arg(long, value_name = "K", value_parser = values::downscale)]
    downscale: Option<f64>,
    /// Memory that the dataset's images may take in training, such as 2GiB
    #[arg(long, value_name = "BYTES", value_parser = values::bytes)]
    memory: Option<u64>,
    /// Don't time steps of training, which takes up to a minute, to say how long it would take
    #[arg(long)]
    no_timing: bool,
}

pub fn run(args: &DoctorArgs, shared: &Shared) -> Result<String, Failure> {
    let options = LoadOptions {
        layout: args.layout,
        downscale: args.downscale.unwrap_or(1.0),
        frames: args.frames,
        test_cameras: args.test_cameras.as_ref().map(|list| list.0.clone()),
        ..LoadOptions::default()
    };
    let choice = shared.device.unwrap_or_default().resolved();
    let device = match args.no_timing {
        true => None,
        false => Some((choice.device()?, choice.to_string())),
    };
    let on = device.as_ref();
    let on = on.map(|(device, name)| TimedOn { device, name });
    let diagnosis = examine_timed(&args.dataset, &options, args.memory, on);
    if let Some(path) = &args.picture {
        let is_drawn = diagnosis.write_picture(path)?;
        if !is_drawn {
            let path = path.display();
            tracing::warn!("{path} is not written: no camera and no point could be read");
        } else {
            tracing::info!(
                "{}: cameras and points, from above and from the side",
                path.display()
            );
        }
    }
    let text = if args.json {
        serde_json::to_string_pretty(&diagnosis)
            .map_err(|e| Failure::new(format!("the findings cannot be written as JSON: {e}")))?
    } else {
        lines(&diagnosis)
    };
    let errors = diagnosis.count(Severity::Error);
    if errors == 0 {
        return Ok(text);
    }
    // The findings are the result and belong on stdout even where the exit code tells of errors.
    failure::print(&text)?;
    let plural = if errors == 1 { "" } else { "s" };
    Err(Failure::new(format!(
        "{}: {errors} error{plural} in the dataset, named above",
        args.dataset.display()
    )))
}

fn lines(diagnosis: &Diagnosis) -> String {
    let lines: Vec<String> = diagnosis.findings.iter().map(ToString::to_string).collect();
    lines.join("\n")
}
