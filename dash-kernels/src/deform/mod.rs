//! Canonical Gaussians moved, turned and scaled by what a deformation field says.

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
use crate::displacement::{self, AXES, DisplacementVjp, check_basis};
use crate::host::{HostBackend, dims};

/// Values of a mean, which are the first of a row of offsets.
pub const MEAN: usize = 3;
/// Values of a quaternion.
pub const QUAT: usize = 4;
/// Values of a scale.
pub const SCALE: usize = 3;

/// Where a row of offsets has what.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Columns {
    /// Factor of the offsets of means, which are the first [`MEAN`] columns.
    pub mean_factor: f32,
    /// The first of the [`QUAT`] columns of quaternions, if there are any.
    pub quats: Option<usize>,
    /// The first of the [`SCALE`] columns of scales, if there are any.
    pub scales: Option<usize>,
}

impl Columns {
    /// The column behind the last that is read.
    fn end(&self) -> usize {
        let quats = self.quats.map_or(0, |first| first + QUAT);
        let scales = self.scales.map_or(0, |first| first + SCALE);
        MEAN.max(quats).max(scales)
    }
}

/// Gaussians before and after [`deform`].
#[derive(Debug, Clone)]
pub struct Ellipsoids {
    /// `[N, 3]`, world units.
    pub means: Tensor<2>,
    /// `[N, 4]`.
    pub quats: Tensor<2>,
    /// `[N, 3]`, or their logarithms.
    pub scales: Tensor<2>,
}

/// Coarse trajectories and the values of their basis functions at a time: see
/// [`displacement`](crate::displacement::displacement).
#[derive(Debug, Clone)]
pub struct Path {
    /// `[N, B * 3]`.
    pub coefficients: Tensor<2>,
    /// Of the `B` functions.
    pub basis: Vec<f32>,
}

/// `means + displacement + mean_factor * offsets[.., 0..3]`, `quats + offsets` and `scales + offsets`, in one pass. The
/// displacement is that of `path`, where there is one.
///
/// # Shapes
/// `offsets [N, W]` with at least the columns that `columns` names.
///
/// What is not finite is passed on: [`project`](crate::project::project) draws no such Gaussian.
///
/// # Gradient
/// To all tensors. Columns of offsets that `columns` does not name have none from here.
///
/// # Errors
/// [`KernelError::Shape`] when rows or columns differ, [`KernelError::Config`] for a basis function whose value is not
/// finite.
///
/// # Source
/// DASH Eq. 10; the coarse trajectory below the field's offsets is ours.
///
/// # Example
/// ```
/// use burn::tensor::{Device, Tensor};
/// use dash_kernels::deform::{Columns, Ellipsoids, deform};
///
/// let device = Device::flex();
/// let canonical = Ellipsoids {
///     means: Tensor::from_floats([[1.0, 2.0, 3.0]], &device),
///     quats: Tensor::from_floats([[1.0, 0.0, 0.0, 0.0]], &device),
///     scales: Tensor::from_floats([[-3.0; 3]], &device),
/// };
/// let offsets = Tensor::from_floats([[0.5, 0.0, -0.5, 0.1, 0.2, 0.3]], &device);
/// let columns = Columns { mean_factor: 2.0, quats: None, scales: Some(3) };
/// let deformed = deform(canonical, None, offsets, columns)?;
/// assert_eq!(deformed.means.into_data().try_into_vec::<f32>()?, [2.0, 2.0, 2.0]);
/// assert_eq!(deformed.scales.into_data().try_into_vec::<f32>()?, [-2.9, -2.8, -2.7]);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn deform(
    canonical: Ellipsoids,
    path: Option<Path>,
    offsets: Tensor<2>,
    columns: Columns,
) -> Result<Ellipsoids, KernelError> {
    let Ellipsoids {
        means,
        quats,
        scales,
    } = canonical;
    let [n, _] = means.dims();
    let path = path.filter(|path| !path.basis.is_empty());
    let of_path = path.as_ref().map_or([[n, 0]; 2], |path| {
        let width = AXES * path.basis.len();
        [path.coefficients.dims(), [n, width]]
    });
    for (name, found, width) in [
        ("means", means.dims(), MEAN),
        ("quats", quats.dims(), QUAT),
        ("scales", scales.dims(), SCALE),
        ("path", of_path[0], of_path[1][1]),
        (
            "offsets",
            offsets.dims(),
            columns.end().max(offsets.dims()[1]),
        ),
    ] {
        if found != [n, width] {
            return Err(KernelError::Shape {
                op: "deform",
                tensor: name,
                expected: format!("[{n}, {width}]"),
                found: found.to_vec(),
            });
        }
    }
    if n == 0 {
        return Ok(Ellipsoids {
            means,
            quats,
            scales,
        });
    }
    // Something has to be bound in the place of a path that is not there, and is not looked at.
    let (coefficients, basis) = match path {
        Some(path) => (path.coefficients, path.basis),
        None => (means.clone(), Vec::new()),
    };
    check_basis("deform", &basis)?;
    let form = Form { columns, basis };
    let (moved, turned, scaled) = Dispatch::deform(
        means.into_dispatch(),
        quats.clone().into_dispatch(),
        scales.clone().into_dispatch(),
        coefficients.into_dispatch(),
        offsets.into_dispatch(),
        form,
    );
    Ok(Ellipsoids {
        means: Tensor::from_dispatch(moved),
        quats: columns
            .quats
            .map_or(quats, |_| Tensor::from_dispatch(turned)),
        scales: columns
            .scales
            .map_or(scales, |_| Tensor::from_dispatch(scaled)),
    })
}

/// What is added to what.
#[derive(Debug, Clone, PartialEq)]
pub struct Form {
    /// Where offsets are.
    pub columns: Columns,
    /// Values of the basis functions of trajectories; none: there are no trajectories.
    pub basis: Vec<f32>,
}

/// Dispatch of [`deform`] over the enabled backends.
#[backend_extension(Autodiff, Flex: cfg(feature = "flex"), NdArray: cfg(feature = "ndarray"), Cube: cfg(feature = "cube"))]
pub trait Deform: Backend {
    /// Means, quaternions and scales; see [`deform`]. Shapes have been checked, and there is a row. Quaternions and scales
    /// without offsets are given back in any state.
    fn deform(
        means: FloatTensor<Self>,
        quats: FloatTensor<Self>,
        scales: FloatTensor<Self>,
        coefficients: FloatTensor<Self>,
        offsets: FloatTensor<Self>,
        form: Form,
    ) -> (FloatTensor<Self>, FloatTensor<Self>, FloatTensor<Self>);
}

/// The pullback of [`deform`], which a backend has to implement for gradients. That of trajectories is the displacement's.
pub trait DeformVjp: Deform + DisplacementVjp {
    /// The gradient of `width` columns of offsets `[N, width]`, from those of means, quaternions and scales. The gradients of the other
    /// inputs are those of the outputs.
    fn deform_vjp(
        v_means: FloatTensor<Self>,
        v_quats: FloatTensor<Self>,
        v_scales: FloatTensor<Self>,
        width: usize,
        columns: Columns,
    ) -> FloatTensor<Self>;
}

impl<B: HostBackend> Deform for B {
    fn deform(
        means: FloatTensor<B>,
        quats: FloatTensor<B>,
        scales: FloatTensor<B>,
        coefficients: FloatTensor<B>,
        offsets: FloatTensor<B>,
        form: Form,
    ) -> (FloatTensor<B>, FloatTensor<B>, FloatTensor<B>) {
        let [n, width] = dims::<2>(&offsets);
        let offsets = B::values(&offsets);
        let rows = cpu::Offsets {
            values: &offsets,
            width,
        };
        let Form { columns, basis } = form;
        let path = (!basis.is_empty())
            .then(|| displacement::cpu::displacement(&B::values(&coefficients), &basis));
        let moved = cpu::moved(&B::values(&means), path.as_deref(), rows, columns);
        let add = |values: FloatTensor<B>, first: Option<usize>, size: usize| match first {
            Some(first) => {
                let sum = cpu::plus(&B::values(&values), size, rows, first);
                B::tensor(sum, [n, size], &values)
            }
            None => values,
        };
        (
            B::tensor(moved, [n, MEAN], &means),
            add(quats, columns.quats, QUAT),
            add(scales, columns.scales, SCALE),
        )
    }
}

impl<B: HostBackend> DeformVjp for B {
    fn deform_vjp(
        v_means: FloatTensor<B>,
        v_quats: FloatTensor<B>,
        v_scales: FloatTensor<B>,
        width: usize,
        columns: Columns,
    ) -> FloatTensor<B> {
        let [n, _] = dims::<2>(&v_means);
        let v_offsets = cpu::deform_vjp(
            &B::values(&v_means),
            &B::values(&v_quats),
            &B::values(&v_scales),
            width,
            columns,
        );
        B::tensor(v_offsets, [n, width], &v_means)
    }
}
