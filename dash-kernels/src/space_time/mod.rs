//! Positions in space at a time as points of the four-dimensional unit cube.

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
const WIDTH: usize = AXES + 1;

/// How a box of space is mapped onto the unit cube.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bounds {
    /// Smallest corner, world units.
    pub min: [f32; AXES],
    /// One over the lengths of its edges, in world units.
    pub scale: [f32; AXES],
    /// Whether positions outside are moved to the nearest face.
    pub clamp: bool,
}

/// `(position - min) * scale` of every position, and the time: where a field over space and time is asked.
///
/// Positions that are not finite count as `min`; what would be beyond the largest number is that number.
///
/// # Shapes
/// `positions [N, 3] -> [N, 4]`
///
/// # Gradient
/// To the positions; zero along the axes on which a position was moved to a face. A gradient of the output that is not
/// finite counts as zero.
///
/// # Errors
/// [`KernelError::Shape`] when positions have other than three coordinates, [`KernelError::Config`] when the bounds or
/// the time are not finite.
pub fn space_time(
    positions: Tensor<2>,
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
    Ok(Tensor::from_dispatch(Dispatch::space_time(
        positions.into_dispatch(),
        *bounds,
        time,
    )))
}

/// Dispatch of [`space_time`] over the enabled backends.
#[backend_extension(Autodiff, Flex: cfg(feature = "flex"), NdArray: cfg(feature = "ndarray"), Cube: cfg(feature = "cube"))]
pub trait SpaceTime: Backend {
    /// See [`space_time`]; shape and values have been checked.
    fn space_time(positions: FloatTensor<Self>, bounds: Bounds, time: f32) -> FloatTensor<Self>;
}

/// What a backend brings so that [`space_time`] can be differentiated on it.
pub trait SpaceTimeVjp: SpaceTime {
    /// Gradient of the positions from that of the output.
    fn space_time_vjp(
        positions: FloatTensor<Self>,
        v_out: FloatTensor<Self>,
        bounds: Bounds,
    ) -> FloatTensor<Self>;
}

impl<B: HostBackend> SpaceTime for B {
    fn space_time(positions: FloatTensor<B>, bounds: Bounds, time: f32) -> FloatTensor<B> {
        let [n, _] = dims::<2>(&positions);
        let out = cpu::space_time(&B::values(&positions), &bounds, time);
        B::tensor(out, [n, WIDTH], &positions)
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
