//! Projection of 3D Gaussians to 2D splats (EWA) with view-dependent colour.

mod autodiff;
mod coeffs;
pub mod cpu;
#[cfg(feature = "cube")]
mod cube;
pub mod reference;
pub mod sh;
#[cfg(test)]
mod tests;
mod view;

use burn::backend::tensor::FloatTensor;
use burn::backend::{Backend, Dispatch, backend_extension};
use burn::tensor::Tensor;

use crate::host::{HostBackend, dims};
use crate::limits::check_values;
use crate::splats::{N_COLUMNS, NEAR_PLANE};
use crate::{Camera, KernelError};
pub use coeffs::{ShCoeffs, ShSlices};
pub use view::View;

const OP: &str = "project";

/// Activation that [`project`] applies to scales and opacities.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Activation {
    /// Scales are given as logarithms and opacities as logits.
    #[default]
    Exp,
    /// Scales and opacities in [0, 1] are given directly; a negative scale draws as its absolute value.
    Linear,
}

/// Options of [`project`].
#[derive(Debug, Clone, PartialEq)]
pub struct ProjectOptions {
    /// SH degree to evaluate, 0 to 3; `None` evaluates all the coefficients there are.
    pub sh_degree: Option<usize>,
    /// Form of scales and opacities.
    pub activation: Activation,
    /// Gaussians nearer than this along the camera's z are not drawn, in world units.
    pub near_plane: f64,
}

impl Default for ProjectOptions {
    fn default() -> Self {
        Self {
            sh_degree: None,
            activation: Activation::default(),
            near_plane: NEAR_PLANE,
        }
    }
}

/// Projects Gaussians into `camera` as packed splats; the columns are those of
/// [`splats`](crate::splats).
///
/// Colour is `max(0, SH + 0.5)` seen from the camera's centre. The projected covariance is
/// `J W R S S R^T W^T J^T + 0.3 I`; the Jacobian `J` is clamped some way beyond the image's border. The radii bound the
/// box outside which alpha is under 1/255. Single precision would misplace splats more than a hundred times as long as
/// wide. They are projected in double precision, or in two floats on a GPU, and have
/// [columns of their own](crate::splats::ACROSS_X).
///
/// A row is all zeros (culled: it draws nothing and has no gradient) when the Gaussian is nearer
/// than the near plane, its box misses the image, its opacity is under 1/255, its quaternion is
/// shorter than 1e-6, or any of its inputs or outputs is not finite.
///
/// # Shapes
/// `means [N, 3]`, `quats [N, 4]`, `scales [N, 3]`, `opacities [N]`, `sh_coeffs [N, K, 3]` in one tensor or two (see
/// [`ShCoeffs`]), with K of 1, 4, 9 or 16 -> `[N, C]`. Scales and opacities are logarithms and logits unless
/// [`Activation::Linear`] is chosen.
///
/// # Gradient
/// To all tensors. Zero to a colour where it was clamped, zero through the radii, zero through a Jacobian that was
/// clamped.
///
/// # Errors
/// [`KernelError::Shape`] when shapes do not fit, [`KernelError::Camera`] when the camera has a value out of range,
/// [`KernelError::Config`] when an option has, [`KernelError::Limit`] when the SH coefficients or the splats outgrow
/// the device's largest buffer.
///
/// # Source
/// Zwicker et al. 2001, eq. 31; Kerbl et al. 2023 (3DGS); radii of the opacity-aware kind of
/// StopThePop (Radl et al. 2024).
///
/// # Example
/// ```
/// use burn::tensor::{Device, Tensor};
/// use dash_kernels::Camera;
/// use dash_kernels::project::{Activation, ProjectOptions, project};
/// use dash_kernels::splats;
///
/// let device = Device::flex();
/// let camera = Camera::new(100.0, 100.0, 32.0, 24.0, 64, 48);
/// let options = ProjectOptions { activation: Activation::Linear, ..ProjectOptions::default() };
/// // A round Gaussian two units in front of the camera.
/// let means = Tensor::from_floats([[0.1, 0.0, 2.0]], &device);
/// let quats = Tensor::from_floats([[1.0, 0.0, 0.0, 0.0]], &device);
/// let scales = Tensor::from_floats([[0.05; 3]], &device);
/// let opacities = Tensor::from_floats([0.8], &device);
/// let sh_coeffs = Tensor::<3>::zeros([1, 1, 3], &device);
/// let packed = project(means, quats, scales, opacities, sh_coeffs, &camera, &options)?;
/// let row = packed.into_data().try_into_vec::<f32>()?;
/// assert_eq!(row.len(), splats::N_COLUMNS);
/// assert!((row[splats::MEAN_X] - 37.0).abs() < 1e-4);
/// assert_eq!(row[splats::RED], 0.5);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn project(
    means: Tensor<2>,
    quats: Tensor<2>,
    scales: Tensor<2>,
    opacities: Tensor<1>,
    sh_coeffs: impl Into<ShCoeffs>,
    camera: &Camera,
    options: &ProjectOptions,
) -> Result<Tensor<2>, KernelError> {
    let [n, _] = means.dims();
    let sh_coeffs = sh_coeffs.into();
    check_shape("means", &means.dims(), &[n, 3])?;
    check_shape("quats", &quats.dims(), &[n, 4])?;
    check_shape("scales", &scales.dims(), &[n, 3])?;
    check_shape("opacities", &opacities.dims(), &[n])?;
    let k = sh_coeffs.check(n)?;
    let sh_degree = check_degree(n, k, options.sh_degree)?;
    check_camera(camera)?;
    check_near_plane(options.near_plane)?;
    let remedy = "lower the SH degree or the number of Gaussians";
    let n_values = n * (k * 3).max(N_COLUMNS);
    check_values("a projection", n_values, remedy, &means.device())?;
    let view = View::new(camera, options, sh_degree);
    Ok(Tensor::from_dispatch(Dispatch::project(
        means.into_dispatch(),
        quats.into_dispatch(),
        scales.into_dispatch(),
        opacities.into_dispatch(),
        sh_coeffs.dc.into_dispatch(),
        sh_coeffs.rest.into_dispatch(),
        view,
    )))
}

fn check_shape(
    tensor: &'static str,
    found: &[usize],
    expected: &[usize],
) -> Result<(), KernelError> {
    if found == expected {
        return Ok(());
    }
    Err(KernelError::Shape {
        op: OP,
        tensor,
        expected: format!("{expected:?}"),
        found: found.to_vec(),
    })
}

fn check_degree(n: usize, n_coeffs: usize, wanted: Option<usize>) -> Result<usize, KernelError> {
    let Some(stored) = sh::N_COEFFS.iter().position(|&n| n == n_coeffs) else {
        return Err(KernelError::Shape {
            op: OP,
            tensor: "sh_coeffs",
            expected: format!("[N, K, 3] with K one of {:?}", sh::N_COEFFS),
            found: vec![n, n_coeffs, 3],
        });
    };
    match wanted {
        Some(degree) if degree > stored => Err(KernelError::Config {
            op: OP,
            what: format!(
                "`sh_degree` is {degree}, but {n_coeffs} coefficients allow at most {stored}"
            ),
        }),
        wanted => Ok(wanted.unwrap_or(stored)),
    }
}

fn check_camera(camera: &Camera) -> Result<(), KernelError> {
    let refuse = |what: String| Err(KernelError::Camera { what });
    let numbers = camera
        .rotation
        .iter()
        .flatten()
        .chain(&camera.translation)
        .chain([&camera.fx, &camera.fy, &camera.cx, &camera.cy]);
    if !numbers.into_iter().all(|value| value.is_finite()) {
        return refuse(format!("{camera:?}, expected finite values"));
    }
    if camera.fx <= 0.0 || camera.fy <= 0.0 || camera.width == 0 || camera.height == 0 {
        return refuse(format!(
            "fx {}, fy {}, {} x {} pixels, expected positive focal lengths and sizes",
            camera.fx, camera.fy, camera.width, camera.height
        ));
    }
    Ok(())
}

fn check_near_plane(near_plane: f64) -> Result<(), KernelError> {
    if near_plane > 0.0 && near_plane.is_finite() {
        return Ok(());
    }
    Err(KernelError::Config {
        op: OP,
        what: format!("`near_plane` is {near_plane}, expected a positive number"),
    })
}

/// The inputs of [`project`] as row-major slices.
#[derive(Debug, Clone, Copy)]
pub struct Gaussians<'a, T> {
    /// `[N, 3]`.
    pub means: &'a [T],
    /// `[N, 4]`.
    pub quats: &'a [T],
    /// `[N, 3]`.
    pub scales: &'a [T],
    /// `[N]`.
    pub opacities: &'a [T],
    /// `[N, K, 3]`.
    pub sh_coeffs: ShSlices<'a, T>,
}

/// Gradients of the inputs of [`project`], row-major.
#[derive(Debug, Clone, PartialEq)]
pub struct GaussianGradients<T> {
    /// `[N, 3]`.
    pub v_means: Vec<T>,
    /// `[N, 4]`.
    pub v_quats: Vec<T>,
    /// `[N, 3]`.
    pub v_scales: Vec<T>,
    /// `[N]`.
    pub v_opacities: Vec<T>,
    /// `[N, 1, 3]`, or empty where it was not asked for.
    pub v_sh_dc: Vec<T>,
    /// `[N, K - 1, 3]`, or empty where it was not asked for.
    pub v_sh_rest: Vec<T>,
}

impl<T: Copy> GaussianGradients<T> {
    /// `[N, K, 3]`, or empty where it was not asked for.
    pub fn v_sh_coeffs(&self) -> Vec<T> {
        let n = self.v_sh_dc.len() / 3;
        let width = self.v_sh_rest.len().checked_div(n).unwrap_or(0);
        let row = |i: usize| {
            let rest = &self.v_sh_rest[i * width..(i + 1) * width];
            self.v_sh_dc[3 * i..3 * i + 3].iter().chain(rest)
        };
        (0..n).flat_map(row).copied().collect()
    }
}

/// The tensors of a projection.
#[derive(Debug, Clone)]
pub struct GaussianTensors<B: Backend> {
    /// `[N, 3]`.
    pub means: FloatTensor<B>,
    /// `[N, 4]`.
    pub quats: FloatTensor<B>,
    /// `[N, 3]`.
    pub scales: FloatTensor<B>,
    /// `[N]`.
    pub opacities: FloatTensor<B>,
    /// `[N, 1, 3]`.
    pub sh_dc: FloatTensor<B>,
    /// `[N, K - 1, 3]`.
    pub sh_rest: FloatTensor<B>,
}

/// Dispatch of [`project`] over the enabled backends.
#[backend_extension(Autodiff, Flex: cfg(feature = "flex"), NdArray: cfg(feature = "ndarray"), Cube: cfg(feature = "cube"))]
pub trait Project: Backend {
    /// See [`project`].
    fn project(
        means: FloatTensor<Self>,
        quats: FloatTensor<Self>,
        scales: FloatTensor<Self>,
        opacities: FloatTensor<Self>,
        sh_dc: FloatTensor<Self>,
        sh_rest: FloatTensor<Self>,
        view: View<f32>,
    ) -> FloatTensor<Self>;
}

/// The pullback of [`project`], which a backend has to implement for gradients.
pub trait ProjectVjp: Project {
    /// Gradients of means, quats, scales, opacities and SH coefficients, constant ones first, in that order, from the
    /// gradient of `splats`, the output; those of SH coefficients only when `with_sh_coeffs` and there are any.
    fn project_vjp(
        gaussians: GaussianTensors<Self>,
        view: View<f32>,
        splats: FloatTensor<Self>,
        v_splats: FloatTensor<Self>,
        with_sh_coeffs: bool,
    ) -> [Option<FloatTensor<Self>>; 6];
}

impl<B: HostBackend> Project for B {
    fn project(
        means: FloatTensor<B>,
        quats: FloatTensor<B>,
        scales: FloatTensor<B>,
        opacities: FloatTensor<B>,
        sh_dc: FloatTensor<B>,
        sh_rest: FloatTensor<B>,
        view: View<f32>,
    ) -> FloatTensor<B> {
        let [n, others, _] = dims::<3>(&sh_rest);
        let splats = cpu::project(
            &Gaussians {
                means: &B::values(&means),
                quats: &B::values(&quats),
                scales: &B::values(&scales),
                opacities: &B::values(&opacities),
                sh_coeffs: ShSlices::apart(&B::values(&sh_dc), &B::values(&sh_rest), 1 + others),
            },
            &view,
        );
        B::tensor(splats, [n, N_COLUMNS], &means)
    }
}

impl<B: HostBackend> ProjectVjp for B {
    fn project_vjp(
        gaussians: GaussianTensors<B>,
        view: View<f32>,
        splats: FloatTensor<B>,
        v_splats: FloatTensor<B>,
        with_sh_coeffs: bool,
    ) -> [Option<FloatTensor<B>>; 6] {
        let GaussianTensors {
            means,
            quats,
            scales,
            opacities,
            sh_dc,
            sh_rest,
        } = &gaussians;
        let [n, others, _] = dims::<3>(sh_rest);
        let gradients = cpu::project_vjp(
            &Gaussians {
                means: &B::values(means),
                quats: &B::values(quats),
                scales: &B::values(scales),
                opacities: &B::values(opacities),
                sh_coeffs: ShSlices::apart(&B::values(sh_dc), &B::values(sh_rest), 1 + others),
            },
            &view,
            &B::values(&splats),
            &B::values(&v_splats),
            with_sh_coeffs,
        );
        [
            Some(B::tensor(gradients.v_means, [n, 3], means)),
            Some(B::tensor(gradients.v_quats, [n, 4], means)),
            Some(B::tensor(gradients.v_scales, [n, 3], means)),
            Some(B::tensor(gradients.v_opacities, [n], means)),
            with_sh_coeffs.then(|| B::tensor(gradients.v_sh_dc, [n, 1, 3], means)),
            (with_sh_coeffs && others > 0)
                .then(|| B::tensor(gradients.v_sh_rest, [n, others, 3], means)),
        ]
    }
}
