//! A set of 3D Gaussians as a Burn module.

mod rows;

use burn::module::{Module, Param};
use burn::tensor::{Device, Tensor};
use dash_kernels::project::ShCoeffs;

pub(crate) use rows::LOGIT_LIMIT;
pub use rows::{GaussianRows, SH_C0, gather_rows, logit};

use crate::parameters::parameter;

/// A set of anisotropic 3D Gaussians with colour as spherical harmonics.
///
/// # Shapes
/// All tensors share their first dimension `N`.
///
/// # Source
/// Kerbl et al. 2023; DASH Eqs. 1-2.
///
/// # Example
/// ```
/// use burn::tensor::Device;
/// use dash_kernels::project::{ProjectOptions, project};
/// use dash_kernels::rasterize::{RasterizeOptions, rasterize};
/// use dash_model::{Camera, GaussianRows, Gaussians};
///
/// let points = [[0.0, 0.0, 3.0], [0.2, 0.1, 3.5]];
/// let rows = GaussianRows::from_points(&points, &[[0.9, 0.4, 0.1]; 2], 0, 0.1);
/// let set = Gaussians::from_rows(&rows, &Device::flex().autodiff());
/// let camera = Camera::new(40.0, 40.0, 16.0, 12.0, 32, 24);
/// let splats = project(
///     set.means.val(),
///     set.quats.val(),
///     set.log_scales.val(),
///     set.opacity_logits.val(),
///     set.sh_coeffs(),
///     &camera,
///     &ProjectOptions::default(),
/// )?;
/// let options = RasterizeOptions { width: 32, height: 24, background: [0.0; 3] };
/// let gradients = rasterize(splats, &options)?.sum().backward();
/// assert_eq!(set.means.val().grad(&gradients).expect("used").dims(), [2, 3]);
/// # Ok::<(), dash_kernels::KernelError>(())
/// ```
#[derive(Module, Debug)]
pub struct Gaussians {
    /// Centres `[N, 3]`, world units.
    pub means: Param<Tensor<2>>,
    /// Rotations `[N, 4]` as (w, x, y, z), not necessarily of unit length.
    pub quats: Param<Tensor<2>>,
    /// Logarithms of the standard deviations `[N, 3]`.
    pub log_scales: Param<Tensor<2>>,
    /// Opacities before the sigmoid `[N]`.
    pub opacity_logits: Param<Tensor<1>>,
    /// Constant colour coefficient `[N, 1, 3]`.
    pub sh_dc: Param<Tensor<3>>,
    /// Higher colour coefficients `[N, K - 1, 3]`.
    pub sh_rest: Param<Tensor<3>>,
    /// Coefficients of the coarse trajectory `[N, B * 3]` (see
    /// [`TrajectoryBasis`](crate::TrajectoryBasis)); absent in a static set.
    pub trajectories: Option<Param<Tensor<2>>>,
    /// Embeddings `[N, E]`, for fields that take them (see
    /// [`DeformationConfig::embedding_width`](crate::DeformationConfig::embedding_width)).
    pub embeddings: Option<Param<Tensor<2>>>,
}

impl Gaussians {
    /// The number of Gaussians.
    pub fn len(&self) -> usize {
        self.means.dims()[0]
    }

    /// Whether the set is empty.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The stored spherical-harmonics degree, 0 to 3.
    pub fn sh_degree(&self) -> usize {
        match self.sh_rest.dims()[1] {
            0 => 0,
            3 => 1,
            8 => 2,
            _ => 3,
        }
    }

    /// Colour coefficients.
    pub fn sh_coeffs(&self) -> ShCoeffs {
        ShCoeffs {
            dc: self.sh_dc.val(),
            rest: self.sh_rest.val(),
        }
    }

    /// Copies every row to the host.
    pub fn to_rows(&self) -> GaussianRows {
        let sh_rest_width = self.sh_rest.dims()[1] * 3;
        let optional = |param: &Option<Param<Tensor<2>>>| match param {
            Some(param) => (to_host(param.val()), param.dims()[1]),
            None => (Vec::new(), 0),
        };
        let (trajectories, trajectory_width) = optional(&self.trajectories);
        let (embeddings, embedding_width) = optional(&self.embeddings);
        GaussianRows {
            means: cast(to_host(self.means.val())),
            quats: cast(to_host(self.quats.val())),
            log_scales: cast(to_host(self.log_scales.val())),
            opacity_logits: to_host(self.opacity_logits.val()),
            sh_dc: cast(to_host(self.sh_dc.val())),
            sh_rest: to_host(self.sh_rest.val()),
            sh_rest_width,
            trajectories,
            trajectory_width,
            embeddings,
            embedding_width,
        }
    }

    /// Moves rows to a device.
    pub fn from_rows(rows: &GaussianRows, device: &Device) -> Self {
        let n = rows.len();
        let optional = |values: &[f32], width: usize| {
            (width > 0).then(|| parameter(values.to_vec(), [n, width], device))
        };
        let rest = rows.sh_rest_width / 3;
        Self {
            means: parameter(rows.means.as_flattened().to_vec(), [n, 3], device),
            quats: parameter(rows.quats.as_flattened().to_vec(), [n, 4], device),
            log_scales: parameter(rows.log_scales.as_flattened().to_vec(), [n, 3], device),
            opacity_logits: parameter(rows.opacity_logits.clone(), [n], device),
            sh_dc: parameter(rows.sh_dc.as_flattened().to_vec(), [n, 1, 3], device),
            sh_rest: parameter(rows.sh_rest.clone(), [n, rest, 3], device),
            trajectories: optional(&rows.trajectories, rows.trajectory_width),
            embeddings: optional(&rows.embeddings, rows.embedding_width),
        }
    }
}

/// Reads a tensor back as host values in row-major order.
pub(crate) fn to_host<const R: usize>(tensor: Tensor<R>) -> Vec<f32> {
    dash_kernels::counts::note_read();
    tensor
        .into_data()
        .try_into_vec::<f32>()
        .unwrap_or_else(|error| panic!("model tensors are f32: {error:?}"))
}

fn cast<const W: usize>(values: Vec<f32>) -> Vec<[f32; W]> {
    let (rows, rest) = values.as_chunks::<W>();
    assert!(rest.is_empty(), "a row width divides its tensor");
    rows.to_vec()
}
