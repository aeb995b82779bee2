//! What is told of a run: where it was stopped, and what became of it.

use dash_train::Error;
use dash_train::dataset::{Dataset, Partition};
use dash_train::evaluate::PerceptualFiles;
use dash_train::results::{Process, evaluate_run};
use dash_train::train::{RunConfig, RunFolder};

use super::TrainArgs;
use crate::failure::Failure;
use crate::summary::{self, Table, duration};
use crate::values;

/// What is told of a training that a signal has stopped.
pub(super) fn stopped_by(signal: &str, args: &TrainArgs, error: Option<Error>) -> String {
    match error {
        Some(Error::Stopped { step, .. }) => format!(
            "{}: stopped by {signal} after step {step}, with a checkpoint; {}",
            args.out.display(),
            resume(args)
        ),
        Some(error) => format!("stopped by {signal}, and: {error}"),
        None => format!("stopped by {signal}; {}", score(args)),
    }
}

pub(super) fn waited_for_images(waited: f64, secs: f64) -> String {
    format!(
        "\nimages were decoded on demand: steps waited {} for them, {:.1} % of the training",
        duration(waited),
        100.0 * waited / secs.max(1e-9)
    )
}

/// How to go on with a run that was stopped.
pub(super) fn resume(args: &TrainArgs) -> String {
    format!(
        "go on with `dash train {} --out {} --resume`",
        values::word(&args.dataset),
        values::word(&args.out)
    )
}

/// What remains to be done for a trained run.
pub(super) fn score(args: &TrainArgs) -> String {
    let run = values::word(&args.out);
    format!("the scene is trained: score it with `dash eval {run}`")
}

/// Scores the run where there are test views, and says what became of it.
pub(super) fn finish(
    run: &RunFolder,
    config: &RunConfig,
    dataset: &Dataset,
    device: (&burn::tensor::Device, &str),
    (secs, process): (f64, Process),
    perceptual: &PerceptualFiles,
) -> Result<String, Failure> {
    let root = run.root().display();
    if dataset.views_of(Partition::Test).next().is_none() {
        let (n_static, n_dynamic) = run.scene(device.0)?.counts();
        let mut table = Table::default();
        table
            .row(
                "dataset",
                format!("{}, no test views to score", dataset.name),
            )
            .row(
                "Gaussians",
                format!("{n_static} static, {n_dynamic} dynamic"),
            )
            .row(
                "training",
                format!("{} steps, {}", config.train.iterations, duration(secs)),
            );
        return Ok(format!("{}\nwritten to {root}", table.text()));
    }
    let perceptual = perceptual.load(device.0)?;
    let results = evaluate_run(run, dataset, Partition::Test, device, process, &perceptual)?;
    let look = format!("dash view {}", values::word(run.root()));
    Ok(format!(
        "{}\nwritten to {root}; look at it: {look}",
        summary::results(&results)
    ))
}
