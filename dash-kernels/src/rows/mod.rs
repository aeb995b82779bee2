//! Rows of matrices: some of one, or those of two joined.

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

/// Stands for a row that was not taken.
pub(crate) const NOT_TAKEN: u32 = u32::MAX;

/// Some rows of a matrix, none of them twice.
///
/// `Tensor::select` allows a row twice and adds up gradients, for which Burn has one GPU unit go through all rows of a
/// column.
///
/// A value or gradient that is not finite counts as zero.
///
/// # Shapes
/// `values [N, C]`, `rows [M]` in ascending order `-> [M, C]`
///
/// # Gradient
/// To `values`; zero for the other rows.
///
/// # Errors
/// [`KernelError::Rows`] when a row is not there or the rows do not ascend.
///
/// # Example
/// ```
/// use burn::tensor::{Device, Tensor};
/// use dash_kernels::rows::take_rows;
///
/// let values = Tensor::from_floats([[1.0, 2.0], [3.0, 4.0], [5.0, 6.0]], &Device::flex());
/// let taken = take_rows(values, &[0, 2])?;
/// assert_eq!(taken.into_data().try_into_vec::<f32>()?, [1.0, 2.0, 5.0, 6.0]);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn take_rows(values: Tensor<2>, rows: &[u32]) -> Result<Tensor<2>, KernelError> {
    let [n, width] = values.dims();
    let refuse = |what: String| {
        Err(KernelError::Rows {
            op: "take_rows",
            what,
        })
    };
    if let Some(pair) = rows.windows(2).find(|pair| pair[0] >= pair[1]) {
        return refuse(format!(
            "row {} after row {}, expected rows in ascending order",
            pair[1], pair[0]
        ));
    }
    if let Some(&row) = rows.last().filter(|&&row| row as usize >= n) {
        return refuse(format!("row {row}, expected rows below {n}"));
    }
    // No device binds an empty buffer.
    if rows.is_empty() || width == 0 {
        return Ok(Tensor::zeros([rows.len(), width], &values.device()));
    }
    Ok(Tensor::from_dispatch(Dispatch::take_rows(
        values.into_dispatch(),
        rows.to_vec(),
    )))
}

/// The rows of one matrix, then those of another.
///
/// `Tensor::cat` takes a launch for each tensor on GPUs, and on CUDA one more to pack rows.
///
/// A value or gradient that is not finite counts as zero.
///
/// # Shapes
/// `first [N, C]`, `second [M, C] -> [N + M, C]`
///
/// # Gradient
/// To both.
///
/// # Errors
/// [`KernelError::Shape`] when their rows are not of one length.
///
/// # Example
/// ```
/// use burn::tensor::{Device, Tensor};
/// use dash_kernels::rows::join_rows;
///
/// let device = Device::flex();
/// let splats_of_two_sets = [Tensor::ones([3, 16], &device), Tensor::zeros([2, 16], &device)];
/// let [first, second] = splats_of_two_sets;
/// assert_eq!(join_rows(first, second)?.dims(), [5, 16]);
/// # Ok::<(), dash_kernels::KernelError>(())
/// ```
pub fn join_rows(first: Tensor<2>, second: Tensor<2>) -> Result<Tensor<2>, KernelError> {
    let ([n, width], [m, found]) = (first.dims(), second.dims());
    if width != found {
        return Err(KernelError::Shape {
            op: "join_rows",
            tensor: "second",
            expected: format!("[M, {width}]"),
            found: vec![m, found],
        });
    }
    // No device binds an empty buffer.
    match [n * width, m * width] {
        [0, 0] => Ok(Tensor::zeros([n + m, width], &first.device())),
        [0, _] => Ok(second),
        [_, 0] => Ok(first),
        _ => Ok(Tensor::from_dispatch(Dispatch::join_rows(
            first.into_dispatch(),
            second.into_dispatch(),
        ))),
    }
}

/// Dispatch of [`join_rows`] over the enabled backends.
#[backend_extension(Autodiff, Flex: cfg(feature = "flex"), NdArray: cfg(feature = "ndarray"), Cube: cfg(feature = "cube"))]
pub trait JoinRows: Backend {
    /// See [`join_rows`]; both have been checked, and have values.
    fn join_rows(first: FloatTensor<Self>, second: FloatTensor<Self>) -> FloatTensor<Self>;
}

/// The pullback of [`join_rows`], which a backend has to implement for gradients.
pub trait JoinRowsVjp: JoinRows {
    /// Gradients of the first, which has `n` rows, and of the second.
    fn join_rows_vjp(v_out: FloatTensor<Self>, n: usize) -> [FloatTensor<Self>; 2];
}

impl<B: HostBackend> JoinRows for B {
    fn join_rows(first: FloatTensor<B>, second: FloatTensor<B>) -> FloatTensor<B> {
        let ([n, width], [m, _]) = (dims::<2>(&first), dims::<2>(&second));
        let out = cpu::join_rows(&B::values(&first), &B::values(&second));
        B::tensor(out, [n + m, width], &first)
    }
}

impl<B: HostBackend> JoinRowsVjp for B {
    fn join_rows_vjp(v_out: FloatTensor<B>, n: usize) -> [FloatTensor<B>; 2] {
        let [all, width] = dims::<2>(&v_out);
        let [first, second] = cpu::join_rows_vjp(&B::values(&v_out), n * width);
        [
            B::tensor(first, [n, width], &v_out),
            B::tensor(second, [all - n, width], &v_out),
        ]
    }
}

/// Dispatch of [`take_rows`] over the enabled backends.
#[backend_extension(Autodiff, Flex: cfg(feature = "flex"), NdArray: cfg(feature = "ndarray"), Cube: cfg(feature = "cube"))]
pub trait TakeRows: Backend {
    /// See [`take_rows`]; the rows have been checked.
    fn take_rows(values: FloatTensor<Self>, rows: Vec<u32>) -> FloatTensor<Self>;
}

/// The pullback of [`take_rows`], which a backend has to implement for gradients.
pub trait TakeRowsVjp: TakeRows {
    /// Gradient of all rows from that of those taken; `places` says for each row the place among these, or
    /// `u32::MAX`.
    fn take_rows_vjp(v_out: FloatTensor<Self>, places: Vec<u32>) -> FloatTensor<Self>;
}

/// The place of each of `n` rows among those taken.
pub(crate) fn places(n: usize, rows: &[u32]) -> Vec<u32> {
    let mut places = vec![NOT_TAKEN; n];
    for (place, &row) in (0..).zip(rows) {
        places[row as usize] = place;
    }
    places
}

impl<B: HostBackend> TakeRows for B {
    fn take_rows(values: FloatTensor<B>, rows: Vec<u32>) -> FloatTensor<B> {
        let [_, width] = dims::<2>(&values);
        let out = cpu::take_rows(&B::values(&values), width, &rows);
        B::tensor(out, [rows.len(), width], &values)
    }
}

impl<B: HostBackend> TakeRowsVjp for B {
    fn take_rows_vjp(v_out: FloatTensor<B>, places: Vec<u32>) -> FloatTensor<B> {
        let [_, width] = dims::<2>(&v_out);
        let gradient = cpu::take_rows_vjp(&B::values(&v_out), width, &places);
        B::tensor(gradient, [places.len(), width], &v_out)
    }
}
