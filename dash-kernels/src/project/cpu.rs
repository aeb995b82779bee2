//! Projection on the CPU: every Gaussian on its own, pieces of them in parallel.
//!
//! The covariance is never formed in 3D: with `g` the two rows of `J W R S`, its projection is
//! `g g^T + 0.3 I` and its determinant the sum `|g0 x g1|^2 + 0.3 tr + 0.09`, in which nothing
//! cancels however thin the Gaussian is. The few that are needles in the picture are projected once more in double
//! precision.

mod footprint;
mod linear;
mod needle;
mod vjp;

use rayon::prelude::*;

use crate::isa::Kernel;
use crate::splats::{self, ALPHA_MIN, LOW_PASS_PX2, N_COLUMNS, is_finite};

use super::sh::{N_COEFFS, sh_basis, sh_basis_vjp};
use super::{Activation, GaussianGradients, Gaussians, View};
use footprint::Footprint;
use linear::{cross, dot};
use needle::{Needle, is_needle};
use vjp::project_one_vjp;

/// Gaussians per parallel piece.
const PIECE: usize = 512;

const LOW_PASS: f32 = LOW_PASS_PX2 as f32;

/// Packed splats `[N, C]`.
pub fn project(gaussians: &Gaussians<f32>, view: &View<f32>) -> Vec<f32> {
    let mut splats = vec![0.0; gaussians.opacities.len() * N_COLUMNS];
    splats
        .par_chunks_mut(PIECE * N_COLUMNS)
        .enumerate()
        .for_each(|(i, rows)| {
            let (rows, _) = rows.as_chunks_mut();
            match view.sh_degree {
                0 => PieceOf::<0>(gaussians, view, i, rows).run(),
                1 => PieceOf::<1>(gaussians, view, i, rows).run(),
                2 => PieceOf::<2>(gaussians, view, i, rows).run(),
                _ => PieceOf::<3>(gaussians, view, i, rows).run(),
            }
        });
    splats
}

/// A piece of Gaussians whose colours have SH up to `DEGREE`, its number and its packed splats.
struct PieceOf<'a, const DEGREE: usize>(
    &'a Gaussians<'a, f32>,
    &'a View<f32>,
    usize,
    &'a mut [[f32; N_COLUMNS]],
);

impl<const DEGREE: usize> Kernel for PieceOf<'_, DEGREE> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self(gaussians, view, piece, rows) = self;
        for (k, row) in rows.iter_mut().enumerate() {
            if let Some(projected) = project_one::<DEGREE>(gaussians, piece * PIECE + k, view) {
                *row = projected;
            }
        }
    }
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
    let width = match with_sh_coeffs {
        true => 3 * (gaussians.sh_coeffs.n_coeffs() - 1),
        false => 0,
    };
    let mut out = GaussianGradients {
        v_sh_rest: vec![0.0; width * n],
        v_sh_dc: vec![0.0; if with_sh_coeffs { 3 * n } else { 0 }],
        v_means: vec![0.0; 3 * n],
        v_quats: vec![0.0; 4 * n],
        v_scales: vec![0.0; 3 * n],
        v_opacities: vec![0.0; n],
    };
    let pieces: Vec<Piece> = Piece::of(&mut out, width).collect();
    pieces.into_par_iter().enumerate().for_each(|(i, out)| {
        let inputs = Inputs {
            gaussians,
            view,
            splats,
            v_splats,
            first: i * PIECE,
        };
        match view.sh_degree {
            0 => PieceVjp::<0>(inputs, out).run(),
            1 => PieceVjp::<1>(inputs, out).run(),
            2 => PieceVjp::<2>(inputs, out).run(),
            _ => PieceVjp::<3>(inputs, out).run(),
        }
    });
    out
}

/// What the gradients of a piece are made from.
struct Inputs<'a> {
    gaussians: &'a Gaussians<'a, f32>,
    view: &'a View<f32>,
    splats: &'a [f32],
    v_splats: &'a [f32],
    /// The piece's first Gaussian.
    first: usize,
}

/// Where the gradients of a piece go.
struct Piece<'a> {
    v_means: &'a mut [f32],
    v_quats: &'a mut [f32],
    v_scales: &'a mut [f32],
    v_opacities: &'a mut [f32],
    /// Empty where the gradients of SH coefficients are not asked for; so is the next.
    v_sh_dc: &'a mut [f32],
    v_sh_rest: &'a mut [f32],
}

impl<'a> Piece<'a> {
    /// The pieces of all gradients; `width` is that of a row of `v_sh_rest`.
    fn of(all: &'a mut GaussianGradients<f32>, width: usize) -> impl Iterator<Item = Self> {
        let mut v_sh_dc = all.v_sh_dc.chunks_mut(3 * PIECE);
        let mut v_sh_rest = all.v_sh_rest.chunks_mut(width.max(1) * PIECE);
        let rows = all
            .v_means
            .chunks_mut(3 * PIECE)
            .zip(all.v_quats.chunks_mut(4 * PIECE))
            .zip(all.v_scales.chunks_mut(3 * PIECE))
            .zip(all.v_opacities.chunks_mut(PIECE));
        rows.map(move |(((v_means, v_quats), v_scales), v_opacities)| Self {
            v_means,
            v_quats,
            v_scales,
            v_opacities,
            v_sh_dc: v_sh_dc.next().unwrap_or_default(),
            v_sh_rest: v_sh_rest.next().unwrap_or_default(),
        })
    }
}

/// The gradients of a piece whose colours have SH up to `DEGREE`.
struct PieceVjp<'a, const DEGREE: usize>(Inputs<'a>, Piece<'a>);

impl<const DEGREE: usize> Kernel for PieceVjp<'_, DEGREE> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self(inputs, out) = self;
        let (v_dc, _) = out.v_sh_dc.as_chunks_mut::<3>();
        let width = out.v_sh_rest.len() / out.v_opacities.len();
        for (k, v_opacity) in out.v_opacities.iter_mut().enumerate() {
            let i = inputs.first + k;
            let (row, v_row) = (row(inputs.splats, i), row(inputs.v_splats, i));
            if row[splats::RADIUS_X] <= 0.0 {
                continue;
            }
            let sight = Sight::new(inputs.gaussians, i, inputs.view);
            let v_colour = clamped_colour_vjp(row, v_row);
            if let Some(v_dc) = v_dc.get_mut(k)
                && all_finite(&[v_colour])
            {
                let basis = sh_basis(sight.direction, DEGREE);
                *v_dc = v_colour.map(|v| basis[0] * v);
                let (v_rest, _) = out.v_sh_rest[k * width..][..width].as_chunks_mut::<3>();
                for (v, b) in v_rest.iter_mut().zip(&basis[1..N_COEFFS[DEGREE]]) {
                    *v = v_colour.map(|v| b * v);
                }
            }
            let Inputs {
                gaussians, view, ..
            } = inputs;
            let v_direction = sight.direction_vjp::<DEGREE>(gaussians, i, v_colour);
            let Some(v) = project_one_vjp(gaussians, i, view, row, v_row, v_direction) else {
                continue;
            };
            out.v_means[3 * k..3 * k + 3].copy_from_slice(&v.mean);
            out.v_quats[4 * k..4 * k + 4].copy_from_slice(&v.quat);
            out.v_scales[3 * k..3 * k + 3].copy_from_slice(&v.scale);
            *v_opacity = v.opacity;
        }
    }
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

/// How the camera sees a mean.
struct Sight {
    /// Unit vector from the camera's centre to the mean.
    direction: [f32; 3],
    distance: f32,
}

impl Sight {
    #[inline(always)]
    fn new(gaussians: &Gaussians<f32>, i: usize, view: &View<f32>) -> Self {
        let mean = from_origin(gaussians, i, view);
        let offset: [f32; 3] = std::array::from_fn(|k| mean[k] - view.position[k]);
        let distance = dot(offset, offset).sqrt();
        Self {
            direction: offset.map(|o| o / distance),
            distance,
        }
    }

    /// Gradient of the mean through the direction it is seen from.
    #[inline(always)]
    fn direction_vjp<const DEGREE: usize>(
        &self,
        gaussians: &Gaussians<f32>,
        i: usize,
        v_colour: [f32; 3],
    ) -> [f32; 3] {
        if DEGREE == 0 {
            return [0.0; 3];
        }
        let (_, rest) = gaussians.sh_coeffs.row(i, DEGREE);
        // The constant function has no direction.
        let mut v_basis = [0.0; 16];
        for (v, coeffs) in v_basis[1..].iter_mut().zip(rest.as_chunks::<3>().0) {
            *v = dot(v_colour, *coeffs);
        }
        let v_direction = sh_basis_vjp(self.direction, DEGREE, &v_basis);
        let along = dot(v_direction, self.direction);
        std::array::from_fn(|k| (v_direction[k] - along * self.direction[k]) / self.distance)
    }
}

#[inline(always)]
fn vector<const R: usize>(rows: &[f32], i: usize) -> [f32; R] {
    rows[R * i..R * (i + 1)]
        .try_into()
        .expect("the range is R long")
}

#[inline(always)]
fn project_one<const DEGREE: usize>(
    gaussians: &Gaussians<f32>,
    i: usize,
    view: &View<f32>,
) -> Option<[f32; N_COLUMNS]> {
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

    let sight = Sight::new(gaussians, i, view);
    let basis = sh_basis(sight.direction, DEGREE);
    let (dc, rest) = gaussians.sh_coeffs.row(i, DEGREE);
    let mut colour = dc.map(|coeff| 0.5 + basis[0] * coeff);
    for (coeffs, b) in rest
        .as_chunks::<3>()
        .0
        .iter()
        .zip(&basis[1..N_COEFFS[DEGREE]])
    {
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
