//! What the examples of dataset layouts share: their arguments, and a small clip where none are given.

use std::path::PathBuf;

use dash_train::evaluate::Evaluation;
use dash_train::reconstruct::ReconstructConfig;
use dash_train::synth::{self, SynthConfig, SynthLayout};
use dash_train::train::StepReport;

/// Why an example ended early.
pub type Failure = Box<dyn std::error::Error + Send + Sync>;

/// What an example works on.
pub struct Task {
    /// The dataset.
    pub folder: PathBuf,
    /// The folder of the run to make.
    pub run: PathBuf,
    /// How to load and to train.
    pub config: ReconstructConfig,
}

/// `FOLDER RUN [DOWNSCALE]`; without arguments a synthetic clip in that layout and a run too short to look good,
/// both in `out/EXAMPLE`.
pub fn task(layout: SynthLayout) -> Result<Task, Failure> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let mut config = ReconstructConfig {
        layout: Some(layout.to_string().parse()?),
        ..Default::default()
    };
    let program = std::env::current_exe()?;
    let out = PathBuf::from("out").join(program.file_stem().unwrap_or_default());
    let (folder, run) = match arguments.as_slice() {
        [] => (out.join("data"), out.join("run")),
        [folder, run] => (folder.into(), run.into()),
        [folder, run, downscale] => {
            config.downscale = downscale.parse()?;
            (folder.into(), run.into())
        }
        _ => return Err("expected FOLDER RUN [DOWNSCALE], or nothing".into()),
    };
    if arguments.is_empty() {
        let clip = SynthConfig {
            layout,
            frames: 6,
            width: 80,
            height: 60,
            ..Default::default()
        };
        println!("{}", synth::write(&folder, &clip)?);
        config.train.set("iterations=150")?;
    }
    Ok(Task {
        folder,
        run,
        config,
    })
}

/// Prints some of the steps.
pub fn print_step(report: &StepReport, seconds: f64) {
    if report.step.is_multiple_of(500) || report.step == 1 {
        println!(
            "{seconds:5.0} s  step {:6}  {:5.2} dB  {} static, {} dynamic",
            report.step, report.psnr, report.n_static, report.n_dynamic
        );
    }
}

/// Prints the scores of the held-out views, where there are any.
pub fn print_scores(scores: Option<&Evaluation>) {
    let Some(scores) = scores else {
        return println!("nothing is held out");
    };
    println!(
        "{} test views: PSNR {:.2} dB, SSIM {:.3}",
        scores.per_view.len(),
        scores.psnr.unwrap_or(f64::NAN),
        scores.ssim.unwrap_or(f64::NAN),
    );
}
