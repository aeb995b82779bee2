//! Extreme inputs for every operation, for scenes and for training, judged on any device.
//!
//! [`cases`] is the one list: `dash stress` prints it as a table, `tests/workspace/extremes.rs` asserts it. A case
//! computes values and gradients on a device and compares them with the operation's `f64` reference, or with a
//! known result. Each part has a tolerance of its own, and everything must be finite.
//!
//! # Map
//! - `measured`: the result of a case; `inputs`: random inputs and tensors; `projected`: Gaussians on a device and
//!   in `f64`.
//! - `projection`, `rasterization`, `precision`, `hash_grid`, `networks`, `similarity`, `trajectories`, `optimiser`, `selection`,
//!   `scenes`, `training`: the cases of each family.

mod hash_grid;
mod inputs;
mod measured;
mod networks;
mod optimiser;
mod precision;
mod projected;
mod projection;
mod rasterization;
mod scenes;
mod selection;
mod similarity;
mod training;
mod trajectories;

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::time::Instant;

use burn::tensor::Device;
use serde::Serialize;

use crate::Error;
pub use measured::{Judged, Measured};

/// One extreme input.
#[derive(Debug, Clone, Copy)]
pub struct Case {
    /// What it belongs to.
    pub family: &'static str,
    /// Its name, unique.
    pub name: &'static str,
    /// What is extreme.
    pub extreme: &'static str,
    /// Works it out on a device.
    pub measure: fn(&Device) -> Result<Measured, Error>,
}

/// How a case went on a device.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Outcome {
    /// What it belongs to.
    pub family: &'static str,
    /// The case.
    pub case: &'static str,
    /// What is extreme.
    pub extreme: &'static str,
    /// Whether all that came out is finite and within its tolerance.
    pub passes: bool,
    /// Whether all that came out is finite.
    pub finite: bool,
    /// What was compared.
    pub parts: Vec<Judged>,
    /// Why nothing came out; `None` where something did.
    pub failure: Option<String>,
    /// Time that the case took with its reference, milliseconds.
    pub ms: f64,
}

impl Outcome {
    /// The part that is nearest to its tolerance, or furthest beyond it.
    pub fn worst(&self) -> Option<&Judged> {
        let parts = self.parts.iter();
        parts.max_by(|a, b| a.strain().total_cmp(&b.strain()))
    }
}

/// All cases but the long ones.
pub fn cases() -> Vec<Case> {
    [
        projection::CASES,
        rasterization::CASES,
        precision::CASES,
        hash_grid::CASES,
        networks::CASES,
        similarity::CASES,
        trajectories::CASES,
        optimiser::CASES,
        selection::CASES,
        scenes::CASES,
        training::CASES,
    ]
    .concat()
}

/// Training for 10,000 steps on the worst of the cases.
pub fn long_cases() -> Vec<Case> {
    training::LONG_CASES.to_vec()
}

/// Works out one case. A fault in it is a failed case, not the end of the others.
///
/// ```
/// use burn::tensor::Device;
/// use dash_train::stress::{cases, run};
///
/// let outcome = run(&cases()[0], &Device::flex());
/// assert!(outcome.passes, "{outcome:?}");
/// ```
pub fn run(case: &Case, device: &Device) -> Outcome {
    let start = Instant::now();
    let result = catch_unwind(AssertUnwindSafe(|| (case.measure)(device)));
    let ms = start.elapsed().as_secs_f64() * 1e3;
    let (measured, failure) = match result {
        Ok(Ok(measured)) => (measured, None),
        Ok(Err(error)) => (Measured::default(), Some(error.to_string())),
        Err(fault) => {
            let text = fault
                .downcast_ref::<String>()
                .cloned()
                .or_else(|| fault.downcast_ref::<&str>().map(ToString::to_string));
            let text = text.unwrap_or_else(|| "no message".into());
            (Measured::default(), Some(format!("a fault: {text}")))
        }
    };
    Outcome {
        family: case.family,
        case: case.name,
        extreme: case.extreme,
        passes: failure.is_none() && measured.passes(),
        finite: failure.is_none() && measured.finite,
        parts: measured.parts,
        failure,
        ms,
    }
}
