//! Errors of every kernel variant against its f64 reference, and times, on every backend.
//!
//! [`run`] measures, and `dash report` draws its results. Inputs are random f32 values with a fixed seed. The
//! reference takes them as exact f64 values, so that an error is the kernel's own.
//!
//! # Map
//! - this file: the request and the loop over it; `file`: the JSON file.
//! - `error`: errors of many values; `timing`: medians and quartiles.
//! - `hash_encode`, `mlp`, `project`, `rasterize`, `ssim`, `photometric`, `adam`: one operation each.
//! - `trajectories`: `displacement`, `squared_extent`, `take_rows`, `join_rows`, `space_time`.
//! - `scene`: a whole scene; `growth`: ever larger ones; `determinant`, `exponent`, `host`: forms of one formula, on the host; `stiffness`: ever harder
//!   inputs.

mod adam;
mod determinant;
mod error;
mod exponent;
mod file;
mod growth;
mod hash_encode;
mod host;
mod mlp;
mod photometric;
mod project;
mod rasterize;
mod scene;
mod ssim;
mod stiffness;
#[cfg(test)]
mod tests;
mod timing;
mod trajectories;

use std::fmt;

use burn::tensor::{Device, Tensor, TensorData};
use dash_kernels::{KernelError, is_deterministic, limits, set_deterministic};
use rand::{Rng, SeedableRng};
use rand_pcg::Pcg64;

use crate::Error;
use error::Errors;
pub use error::{ErrorStats, Norms};
pub use file::{Asked, FORMAT, KernelBench, Measurement, Pass, StiffnessPoint, read_bench};
pub use timing::Timing;
use timing::time;

const SEED: u64 = 7;

/// An operation of `dash-kernels`, or a scene made of them.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
#[value(rename_all = "snake_case")]
pub enum Op {
    /// Multiresolution hash encoding.
    HashEncode,
    /// Small fully connected networks.
    Mlp,
    /// Projection of Gaussians.
    Project,
    /// Rasterization of splats.
    Rasterize,
    /// Structural similarity.
    Ssim,
    /// The loss of a picture.
    Photometric,
    /// A step of Adam.
    Adam,
    /// Where trajectories are.
    Displacement,
    /// How far trajectories go.
    SquaredExtent,
    /// Some rows of a matrix.
    TakeRows,
    /// The rows of two matrices.
    JoinRows,
    /// Positions as points of the unit cube.
    SpaceTime,
    /// A whole scene at 1352 x 1014, of which a fifth moves: pictures and training steps; times only
    Scene,
    /// The same, ever larger: more Gaussians, pixels, frames, threads, or more that moves; times only
    Growth,
}

impl Op {
    /// Those that have a reference: all but [`Op::Scene`] and [`Op::Growth`].
    pub const ALL: [Self; 12] = [
        Self::HashEncode,
        Self::Mlp,
        Self::Project,
        Self::Rasterize,
        Self::Ssim,
        Self::Photometric,
        Self::Adam,
        Self::Displacement,
        Self::SquaredExtent,
        Self::TakeRows,
        Self::JoinRows,
        Self::SpaceTime,
    ];

    /// Its name, that in `dash-kernels` if it is there.
    pub fn name(self) -> &'static str {
        match self {
            Self::HashEncode => "hash_encode",
            Self::Mlp => "mlp",
            Self::Project => "project",
            Self::Rasterize => "rasterize",
            Self::Ssim => "ssim",
            Self::Photometric => "photometric",
            Self::Adam => "adam",
            Self::Displacement => "displacement",
            Self::SquaredExtent => "squared_extent",
            Self::TakeRows => "take_rows",
            Self::JoinRows => "join_rows",
            Self::SpaceTime => "space_time",
            Self::Scene => "scene",
            Self::Growth => "growth",
        }
    }
}

impl fmt::Display for Op {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// What is to be measured.
pub struct BenchOptions {
    /// The operations.
    pub ops: Vec<Op>,
    /// Points, rows, Gaussians, pixels, values or trajectories that they are measured with.
    pub sizes: Vec<usize>,
    /// The devices and their names.
    pub devices: Vec<(String, Device)>,
    /// Whether to measure errors of harder and harder inputs, too.
    pub stiffness: bool,
}

/// Measures everything; `on_part` is told what is measured next.
///
/// What a device has no buffer for is left out and named in the result.
///
/// # Errors
/// When a kernel refuses its input for another reason, or a device breaks down.
pub fn run(options: &BenchOptions, on_part: &mut dyn FnMut(&str)) -> Result<KernelBench, Error> {
    let deterministic = is_deterministic();
    let mut bench = Bench {
        on_part,
        found: KernelBench::new(rayon::current_num_threads()),
    };
    let measured = bench.run(options);
    set_deterministic(deterministic);
    measured?;
    Ok(bench.found)
}

struct Bench<'a> {
    on_part: &'a mut dyn FnMut(&str),
    found: KernelBench,
}

impl Bench<'_> {
    fn run(&mut self, options: &BenchOptions) -> Result<(), Error> {
        for (name, device) in &options.devices {
            let target = Target { name, device };
            for &op in &options.ops {
                for &size in &options.sizes {
                    (self.on_part)(&format!("{name}: {op}, {size}"));
                    let measured = match op {
                        Op::HashEncode => hash_encode::measure(self, target, size),
                        Op::Mlp => mlp::measure(self, target, size),
                        Op::Project => project::measure(self, target, size),
                        Op::Rasterize => rasterize::measure(self, target, size),
                        Op::Ssim => ssim::measure(self, target, size),
                        Op::Photometric => photometric::measure(self, target, size),
                        Op::Adam => adam::measure(self, target, size),
                        Op::Displacement => trajectories::measure_displacement(self, target, size),
                        Op::SquaredExtent => {
                            trajectories::measure_squared_extent(self, target, size)
                        }
                        Op::TakeRows => trajectories::measure_take_rows(self, target, size),
                        Op::JoinRows => trajectories::measure_join_rows(self, target, size),
                        Op::SpaceTime => trajectories::measure_space_time(self, target, size),
                        Op::Scene => scene::measure(self, target, size),
                        Op::Growth => growth::measure(self, target, size),
                    };
                    self.unless_too_large(measured, &format!("{name}: {op}, {size}"))?;
                }
            }
        }
        if options.ops.contains(&Op::Project) {
            for &size in &options.sizes {
                determinant::measure(self, size);
            }
        }
        if options.ops.contains(&Op::Rasterize) {
            for &size in &options.sizes {
                exponent::measure(self, size);
            }
        }
        if options.stiffness {
            stiffness::measure(self, options)?;
        }
        Ok(())
    }

    /// Notes what a device has no room for and goes on.
    fn unless_too_large(&mut self, measured: Result<(), Error>, what: &str) -> Result<(), Error> {
        match measured {
            Err(Error::Kernel(error @ KernelError::Limit { .. })) => {
                self.found.left_out.push(format!("{what}: {error}"));
                Ok(())
            }
            other => other,
        }
    }

    fn add(&mut self, measured: Measurement) {
        self.found.measurements.push(measured);
    }
}

/// A device and its name.
#[derive(Clone, Copy)]
struct Target<'a> {
    name: &'a str,
    device: &'a Device,
}

impl Target<'_> {
    /// The ways in which this device sums gradients: its name for each, and whether it is the
    /// deterministic one. A CPU has one way.
    fn gradient_variants(&self) -> Vec<(&'static str, bool)> {
        if limits::largest_buffer_bytes(self.device).is_some() {
            vec![(", atomic", false), (", deterministic", true)]
        } else {
            vec![("", false)]
        }
    }

    fn tensor<const R: usize>(&self, values: &[f32], shape: [usize; R]) -> Tensor<R> {
        Tensor::from_data(TensorData::new(values.to_vec(), shape), self.device)
    }

    /// The same on a device that differentiates.
    fn leaf<const R: usize>(&self, values: &[f32], shape: [usize; R]) -> Tensor<R> {
        let device = self.device.clone().autodiff();
        Tensor::from_data(TensorData::new(values.to_vec(), shape), &device).require_grad()
    }

    /// A tensor on a device that differentiates, without a gradient of its own.
    fn constant<const R: usize>(&self, values: &[f32], shape: [usize; R]) -> Tensor<R> {
        let device = self.device.clone().autodiff();
        Tensor::from_data(TensorData::new(values.to_vec(), shape), &device)
    }

    fn measurement(&self, op: Op, variant: &str, pass: Pass, size: usize) -> Measurement {
        Measurement {
            op: op.name().into(),
            backend: self.name.into(),
            variant: variant.into(),
            pass,
            size,
            error: ErrorStats::default(),
            time: None,
            asked: None,
            note: None,
        }
    }
}

fn generator(salt: u64) -> Pcg64 {
    Pcg64::seed_from_u64(SEED ^ salt << 32)
}

fn uniform(rng: &mut Pcg64, n: usize, low: f32, high: f32) -> Vec<f32> {
    (0..n).map(|_| rng.random_range(low..high)).collect()
}

fn to_f64(values: &[f32]) -> Vec<f64> {
    values.iter().map(|&v| f64::from(v)).collect()
}

fn values<const R: usize>(tensor: Tensor<R>) -> Result<Vec<f32>, Error> {
    tensor
        .into_data()
        .try_into_vec::<f32>()
        .map_err(|error| Error::DeviceFault(format!("{error:?}")))
}

/// A leaf's gradient; zeros where nothing came back.
fn gradient<const R: usize>(
    leaf: &Tensor<R>,
    gradients: &burn::tensor::Gradients,
) -> Result<Vec<f32>, Error> {
    match leaf.grad(gradients) {
        Some(gradient) => values(gradient),
        None => Ok(vec![0.0; leaf.dims().iter().product()]),
    }
}
