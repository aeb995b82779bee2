//! Multiresolution hash encoding of points in the unit box, in two to four dimensions.

mod autodiff;
mod corners;
pub mod cpu;
#[cfg(feature = "cube")]
mod cube;
mod layout;
pub mod reference;
#[cfg(test)]
mod tests;

use burn::backend::tensor::FloatTensor;
use burn::backend::{Backend, Dispatch, backend_extension};
use burn::tensor::Tensor;
use num_traits::Float;

pub use layout::{
    HASH_PRIMES, HashGridConfig, HashGridLayout, HashGridLevel, Interpolation, LevelSizing,
    MAX_DIMS, SUPPORTED_FEATURES,
};

use crate::KernelError;
use crate::host::{HostBackend, dims};
use crate::limits::check_values;

/// Gradients of features are clamped to plus and minus this: rows that many points share can add
/// up a hundred million of them in f32.
pub const LARGEST_COTANGENT: f32 = 1e30;

/// Features of points, interpolated from the table rows at the corners of the cells that hold
/// them, level by level.
///
/// # Shapes
/// `positions [N, D]` in [0, 1], `table [T, F]` -> `[N, L * F]`; feature `f` of level `l` is
/// column `l * F + f`. `T` is [`HashGridLayout::n_entries`].
///
/// A point with a coordinate outside [0, 1], or NaN, has zero features; a feature that would not be
/// finite, of a damaged table, is zero.
///
/// # Gradient
/// To the table and to the positions; both are zero for points outside. On a cell's border the
/// positions' gradient is that of the cell above it, at 1 that of the last cell. Gradients of the
/// output are clamped to [`LARGEST_COTANGENT`], and count as zero where they are not finite.
///
/// # Errors
/// [`KernelError::Shape`] when a tensor does not fit the layout, [`KernelError::Limit`] when one
/// outgrows the device's largest buffer.
///
/// # Source
/// DASH Eq. 7-9; see [`LevelSizing`] for the level sizes.
///
/// # Example
/// ```
/// use burn::tensor::{Device, Distribution, Tensor};
/// use dash_kernels::hash_encode::{
///     HashGridConfig, HashGridLayout, Interpolation, LevelSizing, hash_encode,
/// };
///
/// let layout = HashGridLayout::new(&HashGridConfig {
///     n_levels: 4,
///     n_features_per_level: 2,
///     log2_hashmap_size: 10,
///     base_resolution: vec![4; 3],
///     finest_resolution: vec![32; 3],
///     interpolation: Interpolation::Linear,
///     sizing: LevelSizing::Paper,
/// })?;
/// let device = Device::flex().autodiff();
/// let uniform = Distribution::Uniform(-1e-4, 1e-4);
/// let table = Tensor::random([layout.n_entries(), 2], uniform, &device).require_grad();
/// let positions = Tensor::from_floats([[0.1, 0.5, 0.9], [0.2, 0.2, 0.2]], &device);
/// let features = hash_encode(positions, table.clone(), &layout)?;
/// assert_eq!(features.dims(), [2, 8]);
/// let gradients = features.sum().backward();
/// assert_eq!(table.grad(&gradients).expect("tracked").dims(), table.dims());
/// # Ok::<(), dash_kernels::KernelError>(())
/// ```
pub fn hash_encode(
    positions: Tensor<2>,
    table: Tensor<2>,
    layout: &HashGridLayout,
) -> Result<Tensor<2>, KernelError> {
    let shape_error = |tensor, expected, found: [usize; 2]| KernelError::Shape {
        op: "hash_encode",
        tensor,
        expected,
        found: found.to_vec(),
    };
    if positions.dims()[1] != layout.dims() {
        let expected = format!("[N, {}]", layout.dims());
        return Err(shape_error("positions", expected, positions.dims()));
    }
    let table_shape = [layout.n_entries(), layout.n_features_per_level()];
    if table.dims() != table_shape {
        return Err(shape_error(
            "table",
            format!("{table_shape:?}"),
            table.dims(),
        ));
    }
    let device = positions.device();
    let n_values = table_shape[0] * table_shape[1];
    check_values(
        "the hash table",
        n_values,
        "lower `log2_hashmap_size`",
        &device,
    )?;
    // The corners of a level's cells, where gradients are sorted, may outnumber the features.
    let n_values = positions.dims()[0] * layout.n_features().max(1 << layout.dims());
    check_values(
        "the encoding",
        n_values,
        "encode fewer points at a time",
        &device,
    )?;
    Ok(Tensor::from_dispatch(Dispatch::hash_encode(
        positions.into_dispatch(),
        table.into_dispatch(),
        layout.clone(),
    )))
}

/// Dispatch of [`hash_encode`] over the enabled backends.
#[backend_extension(Autodiff, Flex: cfg(feature = "flex"), NdArray: cfg(feature = "ndarray"), Cube: cfg(feature = "cube"))]
pub trait HashEncode: Backend {
    /// See [`hash_encode`]; the shapes have been checked.
    fn hash_encode(
        positions: FloatTensor<Self>,
        table: FloatTensor<Self>,
        layout: HashGridLayout,
    ) -> FloatTensor<Self>;
}

/// The pullback of [`hash_encode`], which a backend has to implement for gradients.
pub trait HashEncodeVjp: HashEncode {
    /// Gradients `[v_positions, v_table]` from the gradient of the output, where `needed`.
    fn hash_encode_vjp(
        positions: FloatTensor<Self>,
        table: FloatTensor<Self>,
        v_out: FloatTensor<Self>,
        layout: &HashGridLayout,
        needed: [bool; 2],
    ) -> [Option<FloatTensor<Self>>; 2];
}

#[inline(always)]
fn finite_or_zero<T: Float>(value: T) -> T {
    if value.is_finite() { value } else { T::zero() }
}

impl<B: HostBackend> HashEncode for B {
    fn hash_encode(
        positions: FloatTensor<B>,
        table: FloatTensor<B>,
        layout: HashGridLayout,
    ) -> FloatTensor<B> {
        let [n_points, _] = dims(&positions);
        let out = cpu::hash_encode(&B::values(&positions), &B::values(&table), &layout);
        B::tensor(out, [n_points, layout.n_features()], &positions)
    }
}

impl<B: HostBackend> HashEncodeVjp for B {
    fn hash_encode_vjp(
        positions: FloatTensor<B>,
        table: FloatTensor<B>,
        v_out: FloatTensor<B>,
        layout: &HashGridLayout,
        [needs_positions, needs_table]: [bool; 2],
    ) -> [Option<FloatTensor<B>>; 2] {
        let (points, v) = (B::values(&positions), B::values(&v_out));
        let v_positions = needs_positions.then(|| {
            let v_positions = cpu::positions_vjp(&points, &B::values(&table), &v, layout);
            B::tensor(v_positions, dims::<2>(&positions), &positions)
        });
        let v_table = needs_table.then(|| {
            let v_table = cpu::table_vjp(&points, &v, layout);
            B::tensor(v_table, dims::<2>(&table), &table)
        });
        [v_positions, v_table]
    }
}
