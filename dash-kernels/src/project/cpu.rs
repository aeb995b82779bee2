//! Projection on the CPU: every Gaussian on its own, pieces of them in parallel.
//!
//! The covariance is never formed in 3D: with `g` the two rows of `J W R S`, its projection is
//! `g g^T + 0.3 I` and its determinant the sum `|g0 x g1|^2 + 0.3 tr + 0.09`, in which nothing
//! cancels however thin the Gaussian is. The few that are needles in the picture are projected once more in double
//! precision.

mod linear;
mod needle;
mod vjp;

use rayon::prelude::*;

use crate::splats::{self, ALPHA_MIN, LOW_PASS_PX2, N_COLUMNS, is_finite};

use super::sh::sh_basis;
use super::{Activation, GaussianGradients, Gaussians, View};
use linear::{cross, dot, mat_mul, rotation_from_quat};
use needle::{Needle, is_needle};
use vjp::project_one_vjp;

/// Gaussians per parallel piece.
const PIECE: usize = 512;

const LOW_PASS: f32 = LOW_PASS_PX2 as f32;

/// Quaternions with a smaller squared length are culled.
const MIN_QUAT_NORM_SQUARED: f32 = 1e-12;

/// Packed splats `[N, C]`.
pub fn project(gaussians: &Gaussians<f32>, view: &View<f32>) -> Vec<f32> {
    let mut splats = vec![0.0; gaussians.opacities.len() * N_COLUMNS];
    splats
        .par_chunks_mut(PIECE * N_COLUMNS)
        .enumerate()
        .for_each(|(piece, rows)| {
            for (k, row) in rows.chunks_exact_mut(N_COLUMNS).enumerate() {
                if let Some(projected) = project_one(gaussians, piece * PIECE + k, view) {
                    row.copy_from_slice(&projected);
                }
            }
        });
    splats
}

/// Gradients from `splats [N, C]`, the projection, and `v_splats [N, C]`, its gradient.
///
/// The gradient of the SH coefficients stays empty unless `with_sh_coeffs`. A Gaussian whose
/// gradient is not finite gets zeros.
pub fn project_vjp(
    gaussians: &Gaussians<f32>,
    view: &View<f32>,
    splats: &[f32],
    v_splats: &[f32],
    with_sh_coeffs: bool,
) -> GaussianGradients<f32> {
    let n = gaussians.opacities.len();
    let mut out = GaussianGradients {
        v_means: vec![0.0; 3 * n],
        v_quats: vec![0.0; 4 * n],
        v_scales: vec![0.0; 3 * n],
        v_opacities: vec![0.0; n],
        v_sh_dc: Vec::new(),
        v_sh_rest: Vec::new(),
    };
    (
        out.v_means.par_chunks_mut(3 * PIECE),
        out.v_quats.par_chunks_mut(4 * PIECE),
        out.v_scales.par_chunks_mut(3 * PIECE),
        out.v_opacities.par_chunks_mut(PIECE),
    )
        .into_par_iter()
        .enumerate()
        .for_each(|(piece, (v_means, v_quats, v_scales, v_opacities))| {
            for (k, v_opacity) in v_opacities.iter_mut().enumerate() {
                let i = piece * PIECE + k;
                let (row, v_row) = (row(splats, i), row(v_splats, i));
                let Some(v) = project_one_vjp(gaussians, i, view, row, v_row) else {
                    continue;
                };
                v_means[3 * k..3 * k + 3].copy_from_slice(&v.mean);
                v_quats[4 * k..4 * k + 4].copy_from_slice(&v.quat);
                v_scales[3 * k..3 * k + 3].copy_from_slice(&v.scale);
                *v_opacity = v.opacity;
            }
        });
    if with_sh_coeffs {
        [out.v_sh_dc, out.v_sh_rest] = sh_coeffs_vjp(gaussians, view, splats, v_splats);
    }
    out
}

fn sh_coeffs_vjp(
    gaussians: &Gaussians<f32>,
    view: &View<f32>,
    splats: &[f32],
    v_splats: &[f32],
) -> [Vec<f32>; 2] {
    let n = gaussians.opacities.len();
    let width = 3 * (gaussians.sh_coeffs.n_coeffs() - 1);
    let n_active = (view.sh_degree + 1) * (view.sh_degree + 1);
    let (mut v_dc, mut v_rest) = (vec![0.0; 3 * n], vec![0.0; width * n]);
    // Nothing of nothing where there are only constant ones.
    let mut pieces: Vec<&mut [f32]> = match width {
        0 => (0..n.div_ceil(PIECE)).map(|_| Default::default()).collect(),
        _ => v_rest.chunks_mut(width * PIECE).collect(),
    };
    v_dc.par_chunks_mut(3 * PIECE)
        .zip(&mut pieces)
        .enumerate()
        .for_each(|(piece, (v_dc, v_rest))| {
            for (k, v_dc) in v_dc.chunks_exact_mut(3).enumerate() {
                let i = piece * PIECE + k;
                let v_rest = &mut v_rest[k * width..(k + 1) * width];
                let row = row(splats, i);
                if row[splats::RADIUS_X] <= 0.0 {
                    continue;
                }
                let v_colour = clamped_colour_vjp(row, self::row(v_splats, i));
                if !all_finite(&[v_colour]) {
                    continue;
                }
                let (direction, _) = direction(gaussians, i, view);
                let basis = sh_basis(direction, view.sh_degree);
                let v_coeffs = std::iter::once(v_dc).chain(v_rest.chunks_exact_mut(3));
                for (v, b) in v_coeffs.zip(&basis[..n_active]) {
                    for (v, v_channel) in v.iter_mut().zip(v_colour) {
                        *v = b * v_channel;
                    }
                }
            }
        });
    [v_dc, v_rest]
}

/// Without a branch per value, unlike [`Iterator::all`].
#[inline(always)]
fn all_finite<const R: usize>(vectors: &[[f32; R]]) -> bool {
    let magnitudes = vectors.as_flattened().iter().map(|v| v.to_bits() << 1);
    magnitudes.fold(0, u32::max) < 0xff00_0000
}

#[inline(always)]
fn row(rows: &[f32], i: usize) -> &[f32; N_COLUMNS] {
    rows[i * N_COLUMNS..(i + 1) * N_COLUMNS]
        .try_into()
        .expect("the range is N_COLUMNS long")
}

/// The gradient of the colour before it was clamped at zero.
#[inline(always)]
fn clamped_colour_vjp(row: &[f32; N_COLUMNS], v_row: &[f32; N_COLUMNS]) -> [f32; 3] {
    std::array::from_fn(|channel| {
        if row[splats::RED + channel] > 0.0 {
            v_row[splats::RED + channel]
        } else {
            0.0
        }
    })
}

/// The mean relative to the view's origin.
#[inline(always)]
fn from_origin(gaussians: &Gaussians<f32>, i: usize, view: &View<f32>) -> [f32; 3] {
    let mean: [f32; 3] = vector(gaussians.means, i);
    std::array::from_fn(|k| mean[k] - view.origin[k])
}

/// Unit vector from the camera's centre to the mean, and the distance.
#[inline(always)]
fn direction(gaussians: &Gaussians<f32>, i: usize, view: &View<f32>) -> ([f32; 3], f32) {
    let mean = from_origin(gaussians, i, view);
    let offset: [f32; 3] = std::array::from_fn(|k| mean[k] - view.position[k]);
    let distance = dot(offset, offset).sqrt();
    (offset.map(|o| o / distance), distance)
}

#[inline(always)]
fn vector<const R: usize>(rows: &[f32], i: usize) -> [f32; R] {
    rows[R * i..R * (i + 1)]
        .try_into()
        .expect("the range is R long")
}

/// The projected covariance and what leads to it.
struct Footprint {
    point: [f32; 3],
    /// x/z and y/z.
    ratio: [f32; 2],
    /// The same, no further than the Jacobian follows.
    slope: [f32; 2],
    unit_quat: [f32; 4],
    inverse_quat_norm: f32,
    scale: [f32; 3],
    /// `W R`: the Gaussian's axes in camera coordinates, as columns.
    axes: [[f32; 3]; 3],
    /// The rows of `J W R S`.
    rows: [[f32; 3]; 2],
}

impl Footprint {
    /// `None` when the Gaussian is to be culled before anything is projected.
    #[inline(always)]
    fn new(gaussians: &Gaussians<f32>, i: usize, view: &View<f32>) -> Option<Self> {
        let mean = from_origin(gaussians, i, view);
        let w = &view.rotation;
        let point: [f32; 3] = std::array::from_fn(|r| dot(w[r], mean) + view.translation[r]);
        // In the positive form, so that NaN is culled too.
        let in_front = point[2] >= view.near_plane;
        if !in_front {
            return None;
        }
        let quat: [f32; 4] = vector(gaussians.quats, i);
        let raw_scale: [f32; 3] = vector(gaussians.scales, i);
        if !all_finite(&[mean, raw_scale, point]) || !all_finite(&[quat]) {
            return None;
        }
        let norm_squared =
            quat[0] * quat[0] + quat[1] * quat[1] + quat[2] * quat[2] + quat[3] * quat[3];
        if norm_squared < MIN_QUAT_NORM_SQUARED || !is_finite(norm_squared) {
            return None;
        }
        let inverse_quat_norm = 1.0 / norm_squared.sqrt();
        let unit_quat = quat.map(|q| q * inverse_quat_norm);
        let scale = match view.activation {
            Activation::Exp => raw_scale.map(f32::exp),
            Activation::Linear => raw_scale,
        };
        let axes = mat_mul(w, &rotation_from_quat(unit_quat));
        let inverse_z = 1.0 / point[2];
        let ratio = [point[0] * inverse_z, point[1] * inverse_z];
        let slope = [0, 1].map(|k| ratio[k].max(view.lowest[k]).min(view.highest[k]));
        let rows = [0, 1].map(|k| {
            let per_depth = view.focal[k] * inverse_z;
            std::array::from_fn(|axis| {
                per_depth * (axes[k][axis] - slope[k] * axes[2][axis]) * scale[axis]
            })
        });
        Some(Self {
            point,
            ratio,
            slope,
            unit_quat,
            inverse_quat_norm,
            scale,
            axes,
            rows,
        })
    }
}

#[inline(always)]
fn project_one(gaussians: &Gaussians<f32>, i: usize, view: &View<f32>) -> Option<[f32; N_COLUMNS]> {
    let raw_opacity = gaussians.opacities[i];
    let opacity = match view.activation {
        Activation::Exp => 1.0 / (1.0 + (-raw_opacity).exp()),
        Activation::Linear => raw_opacity,
    };
    let opaque = opacity >= ALPHA_MIN as f32;
    if !opaque || !is_finite(raw_opacity) {
        return None;
    }
    let footprint = Footprint::new(gaussians, i, view)?;
    let [g0, g1] = footprint.rows;
    let (g00, g11) = (dot(g0, g0), dot(g1, g1));
    let (xx, xy, yy) = (g00 + LOW_PASS, dot(g0, g1), g11 + LOW_PASS);
    let normal = cross(g0, g1);
    let det = dot(normal, normal) + LOW_PASS * (g00 + g11) + LOW_PASS * LOW_PASS;
    let extent = 2.0 * (opacity / ALPHA_MIN as f32).ln();
    let radii = [(extent * xx).sqrt(), (extent * yy).sqrt()];
    let mean2d = [0, 1].map(|k| view.focal[k] * footprint.ratio[k] + view.principal[k]);
    for k in 0..2 {
        if !(mean2d[k] + radii[k] > 0.0 && mean2d[k] - radii[k] < view.size[k]) {
            return None;
        }
    }

    let (direction, _) = direction(gaussians, i, view);
    let basis = sh_basis(direction, view.sh_degree);
    let n_active = (view.sh_degree + 1) * (view.sh_degree + 1);
    let (dc, rest) = gaussians.sh_coeffs.row(i, view.sh_degree);
    let mut colour = dc.map(|coeff| 0.5 + basis[0] * coeff);
    for (coeffs, b) in rest.chunks_exact(3).zip(&basis[1..n_active]) {
        for (value, coeff) in colour.iter_mut().zip(coeffs) {
            *value += b * coeff;
        }
    }
    let [red, green, blue] = colour.map(|value| value.max(0.0));
    let mut row = [
        mean2d[0],
        mean2d[1],
        yy / det,
        -xy / det,
        xx / det,
        opacity,
        red,
        green,
        blue,
        footprint.point[2],
        radii[0],
        radii[1],
        0.0,
        0.0,
        0.0,
        0.0,
    ];
    if is_needle(xx + yy, det)
        && let Some(needle) = Needle::new(gaussians, i, &footprint, view)
    {
        needle.write(&mut row, extent);
    }
    let finite = all_finite(&[row]) && all_finite(&[colour, [det; 3]]);
    finite.then_some(row)
}
