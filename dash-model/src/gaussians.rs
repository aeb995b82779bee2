//! A set of 3D Gaussians as a Burn module, and its rows in host memory.

use burn::module::{Module, Param};
use burn::tensor::{Device, Tensor};
use dash_kernels::project::ShCoeffs;
use kiddo::{ImmutableKdTree, SquaredEuclidean};

use crate::parameters::parameter;

/// Value of the constant spherical-harmonics basis function.
pub const SH_C0: f32 = 0.282_094_8;

/// Opacity that 3DGS gives a Gaussian made from a point.
const INITIAL_OPACITY: f32 = 0.1;

/// Logit magnitude beyond which the sigmoid no longer changes in f32.
pub(crate) const LOGIT_LIMIT: f32 = 15.0;

/// A set of anisotropic 3D Gaussians with colour as spherical harmonics.
///
/// # Shapes
/// All tensors share their first dimension `N`.
///
/// # Source
/// Kerbl et al. 2023; DASH Eqs. 1-2.
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
    /// Features of every Gaussian's own `[N, E]`, for fields that take them (see
    /// [`DeformationConfig::embedding_width`](crate::DeformationConfig::embedding_width)).
    pub embeddings: Option<Param<Tensor<2>>>,
}

/// The rows of [`Gaussians`] in host memory, for edits that change their number.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct GaussianRows {
    /// Centres.
    pub means: Vec<[f32; 3]>,
    /// Rotations (w, x, y, z).
    pub quats: Vec<[f32; 4]>,
    /// Logarithms of the standard deviations.
    pub log_scales: Vec<[f32; 3]>,
    /// Opacities before the sigmoid.
    pub opacity_logits: Vec<f32>,
    /// Constant colour coefficients.
    pub sh_dc: Vec<[f32; 3]>,
    /// Higher colour coefficients, `sh_rest_width` values a row.
    pub sh_rest: Vec<f32>,
    /// `(K - 1) * 3`.
    pub sh_rest_width: usize,
    /// Trajectory coefficients, `trajectory_width` values a row.
    pub trajectories: Vec<f32>,
    /// `B * 3`, or 0 without trajectories.
    pub trajectory_width: usize,
    /// Features of every Gaussian's own, `embedding_width` values a row.
    pub embeddings: Vec<f32>,
    /// `E`, or 0 without embeddings.
    pub embedding_width: usize,
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

    /// The highest spherical-harmonics degree that is stored.
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

impl GaussianRows {
    /// The number of rows.
    pub fn len(&self) -> usize {
        self.means.len()
    }

    /// Whether there are no rows.
    pub fn is_empty(&self) -> bool {
        self.means.is_empty()
    }

    /// One Gaussian per point: isotropic, as wide as the mean distance to its three nearest
    /// neighbours, opacity 0.1 as in 3DGS.
    ///
    /// Coincident or lonely points get `fallback_scale`, so no scale is ever zero or infinite.
    pub fn from_points(
        positions: &[[f32; 3]],
        colors: &[[f32; 3]],
        sh_degree: usize,
        fallback_scale: f32,
    ) -> Self {
        let sh_rest_width = ((sh_degree + 1).pow(2) - 1) * 3;
        let n = positions.len();
        let log_scales = neighbour_distances(positions, fallback_scale)
            .into_iter()
            .map(|d| [d.ln(); 3])
            .collect();
        Self {
            means: positions.to_vec(),
            quats: vec![[1.0, 0.0, 0.0, 0.0]; n],
            log_scales,
            opacity_logits: vec![logit(INITIAL_OPACITY); n],
            sh_dc: colors
                .iter()
                .map(|c| c.map(|v| (v - 0.5) / SH_C0))
                .collect(),
            sh_rest: vec![0.0; n * sh_rest_width],
            sh_rest_width,
            trajectories: Vec::new(),
            trajectory_width: 0,
            embeddings: Vec::new(),
            embedding_width: 0,
        }
    }

    /// The rows named by `sources`, in that order; a row may be named more than once.
    pub fn gather(&self, sources: &[usize]) -> Self {
        fn take<T: Copy>(values: &[T], sources: &[usize]) -> Vec<T> {
            sources.iter().map(|&row| values[row]).collect()
        }
        Self {
            means: take(&self.means, sources),
            quats: take(&self.quats, sources),
            log_scales: take(&self.log_scales, sources),
            opacity_logits: take(&self.opacity_logits, sources),
            sh_dc: take(&self.sh_dc, sources),
            sh_rest: gather_rows(&self.sh_rest, self.sh_rest_width, sources),
            sh_rest_width: self.sh_rest_width,
            trajectories: gather_rows(&self.trajectories, self.trajectory_width, sources),
            trajectory_width: self.trajectory_width,
            embeddings: gather_rows(&self.embeddings, self.embedding_width, sources),
            embedding_width: self.embedding_width,
        }
    }

    /// The largest spherical-harmonics degree of the rows, 0 to 3.
    pub fn sh_degree(&self) -> usize {
        (1 + self.sh_rest_width / 3).isqrt() - 1
    }

    /// The same Gaussians with colour coefficients up to `degree`: those that are not there yet are zeros.
    ///
    /// # Panics
    /// When `degree` is lower than that of the rows.
    pub fn with_sh_degree(mut self, degree: usize) -> Self {
        assert!(degree >= self.sh_degree(), "SH coefficients would be lost");
        let width = ((degree + 1).pow(2) - 1) * 3;
        let mut sh_rest = vec![0.0; self.len() * width];
        for row in 0..self.len() {
            let known = &self.sh_rest[row * self.sh_rest_width..][..self.sh_rest_width];
            sh_rest[row * width..][..self.sh_rest_width].copy_from_slice(known);
        }
        (self.sh_rest, self.sh_rest_width) = (sh_rest, width);
        self
    }

    /// Appends the rows of `other`.
    ///
    /// # Panics
    /// When the row widths differ.
    pub fn append(&mut self, other: &Self) {
        assert_eq!(self.sh_rest_width, other.sh_rest_width, "SH degrees differ");
        assert_eq!(
            self.trajectory_width, other.trajectory_width,
            "trajectories differ"
        );
        assert_eq!(
            self.embedding_width, other.embedding_width,
            "embeddings differ"
        );
        self.means.extend(&other.means);
        self.quats.extend(&other.quats);
        self.log_scales.extend(&other.log_scales);
        self.opacity_logits.extend(&other.opacity_logits);
        self.sh_dc.extend(&other.sh_dc);
        self.sh_rest.extend(&other.sh_rest);
        self.trajectories.extend(&other.trajectories);
        self.embeddings.extend(&other.embeddings);
    }
}

/// Rows of `width` values named by `sources`.
pub fn gather_rows(values: &[f32], width: usize, sources: &[usize]) -> Vec<f32> {
    let mut out = Vec::with_capacity(sources.len() * width);
    for &row in sources {
        out.extend_from_slice(&values[row * width..(row + 1) * width]);
    }
    out
}

/// The logit of an opacity, clamped to where the sigmoid still answers.
pub fn logit(opacity: f32) -> f32 {
    (opacity / (1.0 - opacity))
        .ln()
        .clamp(-LOGIT_LIMIT, LOGIT_LIMIT)
}

/// Root mean square distance to the three nearest neighbours, world units.
fn neighbour_distances(positions: &[[f32; 3]], fallback: f32) -> Vec<f32> {
    const NEIGHBOURS: usize = 3;
    // Coordinates are rounded to a lattice far below the scene's detail: the tree refuses long
    // runs of equal coordinates, so coincident points are told apart by their own tiny offset.
    if positions.len() < 2 {
        return vec![fallback; positions.len()];
    }
    let entries: Vec<[f32; 3]> = positions.to_vec();
    let tree: ImmutableKdTree<f32, 3> = ImmutableKdTree::new_from_slice(&entries);
    let wanted = std::num::NonZero::new((NEIGHBOURS + 1).min(positions.len()))
        .expect("at least two positions were checked above");
    positions
        .iter()
        .map(|point| {
            let found = tree.nearest_n::<SquaredEuclidean>(point, wanted);
            let sum: f32 = found.iter().map(|n| n.distance).sum();
            let mean = sum / (found.len().max(2) - 1) as f32;
            if mean.is_finite() && mean > 1e-14 {
                mean.sqrt()
            } else {
                fallback
            }
        })
        .collect()
}

/// Reads a tensor back as host values in row-major order.
pub(crate) fn to_host<const R: usize>(tensor: Tensor<R>) -> Vec<f32> {
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
