//! Plain projection of one Gaussian after the other, for any float type: what the fast kernels
//! are judged by. It goes through full 3x3 covariances, where they avoid them.

mod linear;

use num_traits::Float;

use crate::splats::{self, N_COLUMNS};

use super::sh::{self, sh_basis, sh_basis_vjp};
use super::{Activation, GaussianGradients, Gaussians, View};
use linear::{
    Mat3, Sym2, dot, inverse_vjp, mat_mul, mat_vec, rotation_from_quat, scale_columns, transpose,
};

/// Packed splats `[N, C]`.
pub fn project<T: Float>(gaussians: &Gaussians<T>, view: &View<T>) -> Vec<T> {
    (0..gaussians.opacities.len())
        .flat_map(
            |i| match Projection::new(&Gaussian::at(gaussians, i, view.sh_degree), view) {
                Some(projection) => projection.row,
                None => [T::zero(); N_COLUMNS],
            },
        )
        .collect()
}

/// Gradients from the gradient `v_splats [N, C]` of the packed splats.
pub fn project_vjp<T: Float>(
    gaussians: &Gaussians<T>,
    view: &View<T>,
    v_splats: &[T],
) -> GaussianGradients<T> {
    let width = (gaussians.sh_coeffs.n_coeffs() - 1) * 3;
    let zeros = |like: &[T]| vec![T::zero(); like.len()];
    let mut out = GaussianGradients {
        v_means: zeros(gaussians.means),
        v_quats: zeros(gaussians.quats),
        v_scales: zeros(gaussians.scales),
        v_opacities: zeros(gaussians.opacities),
        v_sh_dc: zeros(gaussians.means),
        v_sh_rest: vec![T::zero(); gaussians.opacities.len() * width],
    };
    for (i, v_row) in v_splats.chunks_exact(N_COLUMNS).enumerate() {
        let gaussian = Gaussian::at(gaussians, i, view.sh_degree);
        let Some(projection) = Projection::new(&gaussian, view) else {
            continue;
        };
        let mut v_sh_coeffs = vec![T::zero(); 3 + width];
        let v = projection.vjp(&gaussian, view, v_row, &mut v_sh_coeffs);
        let (v_dc, v_rest) = v_sh_coeffs.split_at(3);
        out.v_sh_dc[3 * i..3 * i + 3].copy_from_slice(v_dc);
        out.v_sh_rest[i * width..(i + 1) * width].copy_from_slice(v_rest);
        out.v_means[3 * i..3 * i + 3].copy_from_slice(&v.0);
        out.v_quats[4 * i..4 * i + 4].copy_from_slice(&v.1);
        out.v_scales[3 * i..3 * i + 3].copy_from_slice(&v.2);
        out.v_opacities[i] = v.3;
    }
    out
}

struct Gaussian<T> {
    mean: [T; 3],
    quat: [T; 4],
    scale: [T; 3],
    opacity: T,
    /// Those of the degree that is seen.
    sh_coeffs: Vec<T>,
}

impl<T: Float> Gaussian<T> {
    fn at(all: &Gaussians<T>, i: usize, sh_degree: usize) -> Self {
        let (dc, rest) = all.sh_coeffs.row(i, sh_degree);
        Self {
            mean: std::array::from_fn(|k| all.means[3 * i + k]),
            quat: std::array::from_fn(|k| all.quats[4 * i + k]),
            scale: std::array::from_fn(|k| all.scales[3 * i + k]),
            opacity: all.opacities[i],
            sh_coeffs: [dc, rest].concat(),
        }
    }

    /// Whether all but the colour is finite.
    fn is_finite(&self) -> bool {
        let shape = self.mean.iter().chain(&self.quat).chain(&self.scale);
        let mut inputs = shape.chain([&self.opacity]);
        inputs.all(|value| value.is_finite())
    }

    /// Scale and opacity.
    fn activated(&self, activation: Activation) -> ([T; 3], T) {
        match activation {
            Activation::Exp => (
                self.scale.map(T::exp),
                T::one() / (T::one() + (-self.opacity).exp()),
            ),
            Activation::Linear => (self.scale, self.opacity),
        }
    }
}

/// The colour of a Gaussian from where it is seen.
struct Colour<T> {
    basis: [T; 16],
    direction: [T; 3],
    distance: T,
    /// Before it is clamped at zero.
    raw: [T; 3],
}

impl<T: Float> Colour<T> {
    fn new(g: &Gaussian<T>, view: &View<T>) -> Self {
        let half = T::from(0.5).expect("every float type holds a half");
        let offset: [T; 3] = std::array::from_fn(|k| g.mean[k] - view.origin[k] - view.position[k]);
        let distance = dot(offset, offset).sqrt();
        let direction = offset.map(|o| o / distance);
        let basis = sh_basis(direction, view.sh_degree);
        let raw = std::array::from_fn(|channel| {
            basis
                .iter()
                .zip(g.sh_coeffs.chunks_exact(3))
                .take(sh::N_COEFFS[view.sh_degree])
                .fold(half, |sum, (&b, coeffs)| sum + b * coeffs[channel])
        });
        Self {
            basis,
            direction,
            distance,
            raw,
        }
    }

    /// Gradient of the mean; that of the SH coefficients is written to `v_sh_coeffs`.
    fn vjp(&self, g: &Gaussian<T>, view: &View<T>, v_row: &[T], v_sh_coeffs: &mut [T]) -> [T; 3] {
        let zero = T::zero();
        let mut v_basis = [zero; 16];
        for channel in 0..3 {
            if self.raw[channel] <= zero {
                continue;
            }
            let v = v_row[splats::RED + channel];
            for k in 0..sh::N_COEFFS[view.sh_degree] {
                v_basis[k] = v_basis[k] + v * g.sh_coeffs[3 * k + channel];
                v_sh_coeffs[3 * k + channel] = v * self.basis[k];
            }
        }
        let v_direction = sh_basis_vjp(self.direction, view.sh_degree, &v_basis);
        let along = dot(v_direction, self.direction);
        std::array::from_fn(|k| (v_direction[k] - along * self.direction[k]) / self.distance)
    }
}

struct Projection<T> {
    row: [T; N_COLUMNS],
    /// The mean in camera coordinates.
    point: [T; 3],
    /// x/z and y/z as the Jacobian takes them, and whether they were clamped.
    slope: [T; 2],
    clamped: [bool; 2],
    jacobian: [[T; 3]; 2],
    unit_quat: [T; 4],
    quat_norm: T,
    rotation: Mat3<T>,
    scale: [T; 3],
    /// The covariance in camera coordinates.
    covariance: Mat3<T>,
    colour: Colour<T>,
}

impl<T: Float> Projection<T> {
    fn new(g: &Gaussian<T>, view: &View<T>) -> Option<Self> {
        let c = |value: f64| T::from(value).expect("every float type converts from f64");
        let zero = T::zero();
        let norm_squared = g.quat.iter().fold(zero, |sum, &q| sum + q * q);
        if !g.is_finite() || norm_squared < c(1e-12) {
            return None;
        }
        let quat_norm = norm_squared.sqrt();
        let unit_quat = g.quat.map(|q| q / quat_norm);

        let from_origin = std::array::from_fn(|k| g.mean[k] - view.origin[k]);
        let rotated = mat_vec(&view.rotation, from_origin);
        let point = std::array::from_fn(|k| rotated[k] + view.translation[k]);
        let [x, y, z] = point;
        if z < view.near_plane {
            return None;
        }
        let ratio = [x / z, y / z];
        let slope = [0, 1].map(|i| ratio[i].max(view.lowest[i]).min(view.highest[i]));
        let [fx, fy] = view.focal;
        let jacobian = [
            [fx / z, zero, -fx * slope[0] / z],
            [zero, fy / z, -fy * slope[1] / z],
        ];
        let (scale, opacity) = g.activated(view.activation);
        let rotation = rotation_from_quat(unit_quat);
        let m = scale_columns(&rotation, scale);
        let world = mat_mul(&m, &transpose(&m));
        let covariance = mat_mul(&mat_mul(&view.rotation, &world), &transpose(&view.rotation));
        let mean2d = [0, 1].map(|i| view.focal[i] * ratio[i] + view.principal[i]);
        let colour = Colour::new(g, view);
        let row = packed_row(
            mean2d,
            z,
            opacity,
            &jacobian,
            &covariance,
            &colour.raw,
            view,
        )?;
        Some(Self {
            row,
            point,
            slope,
            clamped: [0, 1].map(|i| slope[i] != ratio[i]),
            jacobian,
            unit_quat,
            quat_norm,
            rotation,
            scale,
            covariance,
            colour,
        })
    }

    /// Gradients of mean, quaternion, scale and opacity; those of the SH coefficients are written
    /// to `v_sh_coeffs`.
    fn vjp(
        &self,
        g: &Gaussian<T>,
        view: &View<T>,
        v_row: &[T],
        v_sh_coeffs: &mut [T],
    ) -> ([T; 3], [T; 4], [T; 3], T) {
        let two = T::one() + T::one();
        let (v_jacobian, v_covariance) = self.covariance2d_vjp(v_row, view.low_pass);
        let v_world = mat_mul(
            &mat_mul(&transpose(&view.rotation), &v_covariance),
            &view.rotation,
        );
        let m = scale_columns(&self.rotation, self.scale);
        let v_m = mat_mul(&v_world, &m).map(|row| row.map(|value| two * value));
        let mut v_scale: [T; 3] = std::array::from_fn(|k| {
            (0..3).fold(T::zero(), |sum, r| sum + v_m[r][k] * self.rotation[r][k])
        });
        let v_quat = self.quat_vjp(&scale_columns(&v_m, self.scale));

        let v_point = self.point_vjp(view, v_row, &v_jacobian);
        let through_point = mat_vec(&transpose(&view.rotation), v_point);
        let through_colour = self.colour.vjp(g, view, v_row, v_sh_coeffs);
        let v_mean = std::array::from_fn(|k| through_point[k] + through_colour[k]);

        let mut v_opacity = v_row[splats::OPACITY];
        if view.activation == Activation::Exp {
            let opacity = self.row[splats::OPACITY];
            v_opacity = v_opacity * opacity * (T::one() - opacity);
            for (v, &s) in v_scale.iter_mut().zip(&self.scale) {
                *v = *v * s;
            }
        }
        (v_mean, v_quat, v_scale, v_opacity)
    }

    /// Gradients of the Jacobian and of the covariance in camera coordinates from that of the conic.
    fn covariance2d_vjp(&self, v_row: &[T], low_pass: T) -> ([[T; 3]; 2], Mat3<T>) {
        let two = T::one() + T::one();
        let v_conic = [
            v_row[splats::CONIC_A],
            v_row[splats::CONIC_B] / two,
            v_row[splats::CONIC_C],
        ];
        let cov2d = covariance2d(&self.jacobian, &self.covariance, low_pass);
        let [v_xx, v_xy, v_yy] = inverse_vjp(cov2d, v_conic);
        let v_cov2d = [[v_xx, v_xy], [v_xy, v_yy]];

        // cov2d = J cov J^T: v_cov = J^T v_cov2d J and v_J = 2 v_cov2d J cov.
        let j = &self.jacobian;
        let weighted = v_cov2d
            .map(|[v0, v1]| -> [T; 3] { std::array::from_fn(|k| v0 * j[0][k] + v1 * j[1][k]) });
        let v_covariance = std::array::from_fn(|r| {
            std::array::from_fn(|s| j[0][r] * weighted[0][s] + j[1][r] * weighted[1][s])
        });
        let v_jacobian =
            weighted.map(|row| mat_vec(&self.covariance, row).map(|value| two * value));
        (v_jacobian, v_covariance)
    }

    /// Gradient of the mean in camera coordinates.
    fn point_vjp(&self, view: &View<T>, v_row: &[T], v_jacobian: &[[T; 3]; 2]) -> [T; 3] {
        let [x, y, z] = self.point;
        let [fx, fy] = view.focal;
        let mut v_point = [T::zero(); 3];
        v_point[2] = v_row[splats::DEPTH];
        let (v_u, v_v) = (v_row[splats::MEAN_X], v_row[splats::MEAN_Y]);
        v_point[0] = v_point[0] + fx / z * v_u;
        v_point[1] = v_point[1] + fy / z * v_v;
        v_point[2] = v_point[2] - (fx * x * v_u + fy * y * v_v) / (z * z);
        for (i, f) in [fx, fy].into_iter().enumerate() {
            let [v_diagonal, v_third] = [v_jacobian[i][i], v_jacobian[i][2]];
            v_point[2] = v_point[2] + (f * self.slope[i] * v_third - f * v_diagonal) / (z * z);
            if !self.clamped[i] {
                let v_slope = -f / z * v_third;
                v_point[i] = v_point[i] + v_slope / z;
                v_point[2] = v_point[2] - self.slope[i] / z * v_slope;
            }
        }
        v_point
    }

    /// Gradient of the unnormalised quaternion from that of the rotation matrix.
    fn quat_vjp(&self, v: &Mat3<T>) -> [T; 4] {
        let two = T::one() + T::one();
        let [w, x, y, z] = self.unit_quat;
        let v_unit = [
            x * (v[2][1] - v[1][2]) + y * (v[0][2] - v[2][0]) + z * (v[1][0] - v[0][1]),
            y * (v[0][1] + v[1][0]) + z * (v[0][2] + v[2][0]) + w * (v[2][1] - v[1][2])
                - two * x * (v[1][1] + v[2][2]),
            x * (v[0][1] + v[1][0]) + z * (v[1][2] + v[2][1]) + w * (v[0][2] - v[2][0])
                - two * y * (v[0][0] + v[2][2]),
            x * (v[0][2] + v[2][0]) + y * (v[1][2] + v[2][1]) + w * (v[1][0] - v[0][1])
                - two * z * (v[0][0] + v[1][1]),
        ]
        .map(|value| two * value);
        let along = (0..4).fold(T::zero(), |sum, k| sum + v_unit[k] * self.unit_quat[k]);
        std::array::from_fn(|k| (v_unit[k] - along * self.unit_quat[k]) / self.quat_norm)
    }
}

/// The covariance in the picture.
fn covariance2d<T: Float>([jx, jy]: &[[T; 3]; 2], covariance: &Mat3<T>, low_pass: T) -> Sym2<T> {
    [
        dot(*jx, mat_vec(covariance, *jx)) + low_pass,
        dot(*jx, mat_vec(covariance, *jy)),
        dot(*jy, mat_vec(covariance, *jy)) + low_pass,
    ]
}

/// The packed splat; `None` where it is culled.
fn packed_row<T: Float>(
    mean2d: [T; 2],
    depth: T,
    opacity: T,
    jacobian: &[[T; 3]; 2],
    covariance: &Mat3<T>,
    raw_colour: &[T; 3],
    view: &View<T>,
) -> Option<[T; N_COLUMNS]> {
    let zero = T::zero();
    let [xx, xy, yy] = covariance2d(jacobian, covariance, view.low_pass);
    let det = xx * yy - xy * xy;
    let regular = det > zero;
    if opacity < view.alpha_min || !regular {
        return None;
    }
    let two = T::one() + T::one();
    let extent = two * (opacity / view.alpha_min).ln();
    let radii = [(extent * xx).sqrt(), (extent * yy).sqrt()];
    for i in 0..2 {
        if !(mean2d[i] + radii[i] > zero && mean2d[i] - radii[i] < view.size[i]) {
            return None;
        }
    }
    let [red, green, blue] = raw_colour.map(|value| value.max(zero));
    let row = [
        mean2d[0],
        mean2d[1],
        yy / det,
        -xy / det,
        xx / det,
        opacity,
        red,
        green,
        blue,
        depth,
        radii[0],
        radii[1],
        zero,
        zero,
        zero,
        zero,
    ];
    let mut all = row.iter().chain(raw_colour).chain([&det]);
    all.all(|value| value.is_finite()).then_some(row)
}
