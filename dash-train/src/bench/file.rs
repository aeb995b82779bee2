//! The JSON file that `dash bench` writes and `dash report` reads.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use dash_kernels::counts::Counts;
use serde::{Deserialize, Serialize};

use super::error::ErrorStats;
use super::timing::Timing;
use crate::Error;

/// What a file says that it is.
pub const FORMAT: &str = "dash-kernel-bench-1";

/// Errors and times of kernels.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct KernelBench {
    /// [`FORMAT`].
    pub format: String,
    /// CPU threads of the process.
    pub threads: usize,
    /// How the errors are taken.
    pub error_rule: String,
    /// How the times are taken.
    pub time_rule: String,
    /// What was measured.
    pub measurements: Vec<Measurement>,
    /// Errors of harder and harder inputs.
    pub stiffness: Vec<StiffnessPoint>,
    /// What a device had no room for.
    pub left_out: Vec<String>,
}

/// Which way through an operation.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Pass {
    /// Its values.
    Forward,
    /// Its gradients; the time is that of both ways.
    Gradient,
}

/// One variant of an operation on one backend, with input of one size.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Measurement {
    /// The operation.
    pub op: String,
    /// The backend, or `host` for plain functions.
    pub backend: String,
    /// What sets it apart from others of the same operation.
    pub variant: String,
    /// Values or gradients.
    pub pass: Pass,
    /// Points, Gaussians, pixels or values.
    pub size: usize,
    /// Against the f64 reference.
    pub error: ErrorStats,
    /// Absent where only the error was measured.
    pub time: Option<Timing>,
    /// What a picture, or a step on average, asks of the device.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub asked: Option<Asked>,
    /// What a reader must know.
    pub note: Option<String>,
}

/// What is asked of a device, on average.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Asked {
    /// Kernels launched.
    pub launches: f64,
    /// Tensors read back.
    pub reads: f64,
    /// Launches of each kernel.
    pub kernels: BTreeMap<String, f64>,
}

impl Asked {
    pub(super) fn of(counts: &Counts, repeats: usize) -> Self {
        let each = |n: usize| n as f64 / repeats as f64;
        let kernels = counts.kernels.iter();
        Self {
            launches: each(counts.launches()),
            reads: each(counts.reads),
            kernels: kernels.map(|(name, &n)| (name.clone(), each(n))).collect(),
        }
    }
}

/// The error of one variant for one input of a series that gets harder.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StiffnessPoint {
    /// What gets harder, and its unit.
    pub sweep: String,
    /// How hard it is here.
    pub value: f64,
    /// Whether the values are spread by their logarithm.
    pub logarithmic: bool,
    /// The operation and what is measured of it.
    pub op: String,
    /// The backend, or `host` for plain functions.
    pub backend: String,
    /// What sets it apart from others of the same operation.
    pub variant: String,
    /// Against the f64 reference.
    pub error: ErrorStats,
}

impl KernelBench {
    pub(super) fn new(threads: usize) -> Self {
        Self {
            format: FORMAT.into(),
            threads,
            error_rule: super::error::RULE.into(),
            time_rule: super::timing::RULE.into(),
            measurements: Vec::new(),
            stiffness: Vec::new(),
            left_out: Vec::new(),
        }
    }
}

/// Reads a file of `dash bench`.
///
/// # Errors
/// When it can't be read or is none.
pub fn read_bench(path: &Path) -> Result<KernelBench, Error> {
    let bytes = fs::read(path).map_err(|e| Error::io(path, "read", e))?;
    let refuse = |found: String| {
        Error::run(
            path,
            format!(
                "expected measurements of kernels, found {found}; make them with `dash bench --out FILE.json`"
            ),
        )
    };
    let bench: KernelBench = serde_json::from_slice(&bytes).map_err(|e| refuse(e.to_string()))?;
    if bench.format != FORMAT {
        return Err(refuse(format!("the format `{}`", bench.format)));
    }
    Ok(bench)
}
