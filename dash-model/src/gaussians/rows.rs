//! The rows of a set of Gaussians in host memory.

use kiddo::{ImmutableKdTree, SquaredEuclidean};

/// Value of the constant spherical-harmonics basis function.
pub const SH_C0: f32 = 0.282_094_8;

/// Opacity that 3DGS gives a Gaussian made from a point.
const INITIAL_OPACITY: f32 = 0.1;

/// Magnitude of a logit beyond which the sigmoid no longer changes in f32.
pub(crate) const LOGIT_LIMIT: f32 = 15.0;

/// The rows of [`Gaussians`](crate::Gaussians) in host memory, for edits that change their number: densify, prune, relocate.
///
/// # Example
/// ```
/// use burn::tensor::Device;
/// use dash_model::{GaussianRows, Gaussians, SH_C0};
///
/// let points = [[0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [0.0, 0.2, 0.0]];
/// let mut rows = GaussianRows::from_points(&points, &[[0.5; 3]; 3], 1, 0.1);
/// // The colour of degree 0 is `0.5 + SH_C0 * sh_dc`.
/// assert_eq!(rows.sh_dc[0].map(|dc| 0.5 + SH_C0 * dc), [0.5; 3]);
/// // Prune the second Gaussian and clone the third.
/// rows = rows.gather(&[0, 2, 2]);
/// rows.append(&rows.gather(&[0]));
/// assert_eq!((rows.len(), rows.sh_degree()), (4, 1));
/// let set = Gaussians::from_rows(&rows, &Device::flex());
/// assert_eq!(set.to_rows(), rows);
/// ```
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
    /// Embeddings, `embedding_width` values a row.
    pub embeddings: Vec<f32>,
    /// `E`, or 0 without embeddings.
    pub embedding_width: usize,
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

    /// One Gaussian per point: isotropic, as wide as the root mean square distance to its three nearest neighbours, opacity
    /// 0.1 as in 3DGS.
    ///
    /// Coincident points and a single point get `fallback_scale`, so that no scale is zero or infinite.
    ///
    /// # Units
    /// `positions` and `fallback_scale` in world units, `colors` sRGB in [0, 1].
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

    /// The same Gaussians with colour coefficients up to `degree`; new ones are zeros.
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

/// The rows of `width` values named by `sources`.
///
/// ```
/// let values = [1.0, 2.0, 3.0, 4.0];
/// assert_eq!(dash_model::gather_rows(&values, 2, &[1, 1, 0]), [3.0, 4.0, 3.0, 4.0, 1.0, 2.0]);
/// ```
pub fn gather_rows(values: &[f32], width: usize, sources: &[usize]) -> Vec<f32> {
    let mut out = Vec::with_capacity(sources.len() * width);
    for &row in sources {
        out.extend_from_slice(&values[row * width..(row + 1) * width]);
    }
    out
}

/// The logit of an opacity, clamped to where the sigmoid still changes.
///
/// ```
/// assert_eq!(dash_model::logit(0.5), 0.0);
/// assert!(dash_model::logit(1.0).is_finite());
/// ```
pub fn logit(opacity: f32) -> f32 {
    (opacity / (1.0 - opacity))
        .ln()
        .clamp(-LOGIT_LIMIT, LOGIT_LIMIT)
}

/// Root mean square distance to the three nearest neighbours, world units.
fn neighbour_distances(positions: &[[f32; 3]], fallback: f32) -> Vec<f32> {
    const NEIGHBOURS: usize = 3;
    if positions.len() < 2 {
        return vec![fallback; positions.len()];
    }
    let tree: ImmutableKdTree<f32, 3> = ImmutableKdTree::new_from_slice(positions);
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
