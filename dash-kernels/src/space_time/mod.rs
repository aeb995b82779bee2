//! Positions and a time as points of the four-dimensional unit cube.

mod autodiff;
pub mod cpu;
#[cfg(feature = "cube")]
mod cube;
pub mod reference;
#[cfg(test)]
mod tests;

use burn::backend::tensor::FloatTensor;
use burn::backend::{Backend, Dispatch, backend_extension};
use burn::tensor::Tensor;

use crate::KernelError;
use crate::host::{HostBackend, dims};

/// Coordinates of a position.
const AXES: usize = 3;
/// Coordinates of a point.
pub(crate) const WIDTH: usize = AXES + 1;

/// How a box of space is mapped onto the unit cube.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bounds {
    /// Smallest corner, world units.
    pub min: [f32; AXES],
    /// One over the lengths of its edges, in world units.
    pub scale: [f32; AXES],
    /// Whether positions outside are clamped to the box.
    pub clamp: bool,
}

/// `(position - min) * scale` of every position, followed by the time: the input of an encoder over space and time.
///
/// Positions that are not finite count as `min`. Without [`Bounds::clamp`] results are clamped to the range of `f32`.
///
/// # Shapes
/// `positions [N, 3] -> [N, 4]`
///
/// # Gradient
/// To the positions; zero along axes on which a position was clamped. A gradient of the output that is not finite counts
/// as zero.
///
/// # Errors
/// [`KernelError::Shape`] when positions have other than three coordinates, [`KernelError::Config`] when the bounds or
/// the time are not finite.
///
/// # Example
/// ```
/// use burn::tensor::{Device, Tensor};
/// use dash_kernels::space_time::{Bounds, space_time};
///
/// // A box from -2 to 2 along each axis.
/// let bounds = Bounds { min: [-2.0; 3], scale: [0.25; 3], clamp: true };
/// let positions = Tensor::from_floats([[0.0, 1.0, 9.0]], &Device::flex());
/// let points = space_time(positions, &bounds, 0.125)?;
/// assert_eq!(points.into_data().try_into_vec::<f32>()?, [0.5, 0.75, 1.0, 0.125]);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn space_time(
    positions: Tensor<2>,
    bounds: &Bounds,
    time: f32,
) -> Result<Tensor<2>, KernelError> {
    run(positions, None, bounds, time)
}

/// Points beside those of some positions.
#[derive(Debug, Clone)]
pub struct Beside {
    /// Of which positions.
    pub rows: Vec<u32>,
    /// How far beside, `[M, 4]`, in the unit cube.
    pub steps: Tensor<2>,
}

/// [`space_time`], and behind its points others beside some of them, clamped to the unit cube.
///
/// # Shapes
/// `positions [N, 3]`, `M` points beside `-> [N + M, 4]`
///
/// # Gradient
/// That of [`space_time`]: points beside have none.
///
/// # Errors
/// Those of [`space_time`], and [`KernelError::Shape`] when steps and rows differ or a row is not there.
///
/// # Example
/// ```
/// use burn::tensor::{Device, Tensor};
/// use dash_kernels::space_time::{Beside, Bounds, space_time_beside};
///
/// let device = Device::flex();
/// let bounds = Bounds { min: [-2.0; 3], scale: [0.25; 3], clamp: true };
/// let positions = Tensor::from_floats([[0.0, 1.0, 9.0]], &device);
/// let steps = Tensor::from_floats([[0.25, -0.25, 0.25, 0.125]], &device);
/// let points = space_time_beside(positions, Beside { rows: vec![0], steps }, &bounds, 0.125)?;
/// let points = points.into_data().try_into_vec::<f32>()?;
/// assert_eq!(points, [0.5, 0.75, 1.0, 0.125, 0.75, 0.5, 1.0, 0.25]);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn space_time_beside(
    positions: Tensor<2>,
    beside: Beside,
    bounds: &Bounds,
    time: f32,
) -> Result<Tensor<2>, KernelError> {
    let [n, _] = positions.dims();
    let m = beside.rows.len();
    let has_rows = beside.rows.iter().all(|&row| (row as usize) < n);
    if beside.steps.dims() != [m, WIDTH] || !has_rows {
        return Err(KernelError::Shape {
            op: "space_time_beside",
            tensor: "steps",
            expected: format!("[{m}, {WIDTH}], beside rows below {n}"),
            found: beside.steps.dims().to_vec(),
        });
    }
    run(positions, Some(beside), bounds, time)
}

fn run(
    positions: Tensor<2>,
    beside: Option<Beside>,
    bounds: &Bounds,
    time: f32,
) -> Result<Tensor<2>, KernelError> {
    let [n, width] = positions.dims();
    if width != AXES {
        return Err(KernelError::Shape {
            op: "space_time",
            tensor: "positions",
            expected: "[N, 3]".into(),
            found: vec![n, width],
        });
    }
    let mut numbers = bounds.min.iter().chain(&bounds.scale).chain([&time]);
    if !numbers.all(|value| value.is_finite()) {
        return Err(KernelError::Config {
            op: "space_time",
            what: format!("{bounds:?} at time {time}, expected finite values"),
        });
    }
    // No device binds an empty buffer.
    if n == 0 {
        return Ok(Tensor::zeros([0, WIDTH], &positions.device()));
    }
    // Something has to be bound in the place of steps that are not there, and is not looked at.
    let (rows, steps) = match beside {
        Some(beside) => (beside.rows, beside.steps),
        None => (Vec::new(), positions.clone()),
    };
    Ok(Tensor::from_dispatch(Dispatch::space_time(
        positions.into_dispatch(),
        steps.into_dispatch(),
        rows,
        *bounds,
        time,
    )))
}

/// Dispatch of [`space_time`] and [`space_time_beside`] over the enabled backends.
#[backend_extension(Autodiff, Flex: cfg(feature = "flex"), NdArray: cfg(feature = "ndarray"), Cube: cfg(feature = "cube"))]
pub trait SpaceTime: Backend {
    /// See [`space_time_beside`]; shapes and values have been checked, and there is a position. Without `rows`, steps are not
    /// looked at.
    fn space_time(
        positions: FloatTensor<Self>,
        steps: FloatTensor<Self>,
        rows: Vec<u32>,
        bounds: Bounds,
        time: f32,
    ) -> FloatTensor<Self>;
}

/// The pullback of [`space_time`], which a backend has to implement for gradients.
pub trait SpaceTimeVjp: SpaceTime {
    /// Gradient of the positions from that of the output, whose first rows are theirs.
    fn space_time_vjp(
        positions: FloatTensor<Self>,
        v_out: FloatTensor<Self>,
        bounds: Bounds,
    ) -> FloatTensor<Self>;
}

impl<B: HostBackend> SpaceTime for B {
    fn space_time(
        positions: FloatTensor<B>,
        steps: FloatTensor<B>,
        rows: Vec<u32>,
        bounds: Bounds,
        time: f32,
    ) -> FloatTensor<B> {
        let [n, _] = dims::<2>(&positions);
        let mut out = cpu::space_time(&B::values(&positions), &bounds, time);
        if !rows.is_empty() {
            cpu::add_beside(&mut out, &B::values(&steps), &rows);
        }
        B::tensor(out, [n + rows.len(), WIDTH], &positions)
    }
}

impl<B: HostBackend> SpaceTimeVjp for B {
    fn space_time_vjp(
        positions: FloatTensor<B>,
        v_out: FloatTensor<B>,
        bounds: Bounds,
    ) -> FloatTensor<B> {
        let [n, _] = dims::<2>(&positions);
        let gradient = cpu::space_time_vjp(&B::values(&positions), &B::values(&v_out), &bounds);
        B::tensor(gradient, [n, AXES], &positions)
    }
}
