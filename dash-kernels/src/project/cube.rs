//! Projection on CubeCL devices.
//!
//! A unit owns one Gaussian, forward and backward. No shared memory, no atomics; deterministic.
//! The determinant is the sum of the CPU kernel, in which nothing cancels. The few that are needles in the picture are
//! projected once more in numbers of two floats.

mod footprint;
mod linear;
mod needle;
mod sh;
#[cfg(test)]
mod tests;
mod values;
mod vjp;

use burn_cubecl::CubeBackend;
use burn_cubecl::tensor::CubeTensor;
use cubecl::prelude::*;

use crate::cube::{arg, contiguous, is_finite, uninitialised, units};
use crate::splats::{self, ALPHA_MIN, N_COLUMNS};

use super::{Activation, GaussianTensors, Project, ProjectVjp, View};
use footprint::footprint_of;
use linear::{Mat3Launch, Vec3, Vec3Launch};
use needle::{is_needle, needle_of};
use sh::{ShGradientsLaunch, colour};
use values::{
    Ellipsoids, EllipsoidsLaunch, Footprint, ViewConstants, ViewConstantsLaunch, view_rest,
};
use vjp::{GradientsLaunch, project_vjp_kernel};

/// Columns that every splat has; those of needles follow.
const N_BEFORE_NEEDLES: usize = splats::ACROSS_X;

impl Project for CubeBackend {
    fn project(
        means: CubeTensor,
        quats: CubeTensor,
        scales: CubeTensor,
        opacities: CubeTensor,
        sh_dc: CubeTensor,
        sh_rest: CubeTensor,
        view: View<f32>,
    ) -> CubeTensor {
        let [means, quats, scales, opacities] = [means, quats, scales, opacities].map(contiguous);
        let form = form(&view, &sh_rest);
        let [sh_dc, sh_rest] = bound(sh_dc, sh_rest);
        let n = means.meta.shape()[0];
        let splats = uninitialised(&means, [n, N_COLUMNS]);
        let (count, dim) = units(&means.client, n);
        project_kernel::launch(
            &means.client,
            count,
            dim,
            EllipsoidsLaunch::new(arg(&means), arg(&quats), arg(&scales)),
            arg(&opacities),
            arg(&sh_dc),
            arg(&sh_rest),
            arg(&splats),
            constants(&view),
            n as u32,
            form,
        );
        splats
    }
}

impl ProjectVjp for CubeBackend {
    fn project_vjp(
        gaussians: GaussianTensors<Self>,
        view: View<f32>,
        splats: CubeTensor,
        v_splats: CubeTensor,
        with_sh_coeffs: bool,
    ) -> [Option<CubeTensor>; 6] {
        let means = contiguous(gaussians.means);
        let quats = contiguous(gaussians.quats);
        let scales = contiguous(gaussians.scales);
        let form = form(&view, &gaussians.sh_rest);
        let [_, sh_rest] = bound(gaussians.sh_dc, gaussians.sh_rest);
        let [splats, v_splats] = [splats, v_splats].map(contiguous);
        let n = means.meta.shape()[0];
        let v_means = uninitialised(&means, [n, 3]);
        let v_quats = uninitialised(&means, [n, 4]);
        let v_scales = uninitialised(&means, [n, 3]);
        let v_opacities = uninitialised(&means, [n]);
        let others = form.n_coeffs - 1;
        // Bound even where they are not written to.
        let gradient = |width| match with_sh_coeffs && width > 0 {
            true => uninitialised(&means, [n, width, 3]),
            false => uninitialised(&means, [1, 1, 1]),
        };
        let (v_sh_dc, v_sh_rest) = (gradient(1), gradient(others));
        let (count, dim) = units(&means.client, n);
        project_vjp_kernel::launch(
            &means.client,
            count,
            dim,
            EllipsoidsLaunch::new(arg(&means), arg(&quats), arg(&scales)),
            arg(&sh_rest),
            arg(&splats),
            arg(&v_splats),
            GradientsLaunch::new(
                arg(&v_means),
                arg(&v_quats),
                arg(&v_scales),
                arg(&v_opacities),
                ShGradientsLaunch::new(arg(&v_sh_dc), arg(&v_sh_rest)),
            ),
            constants(&view),
            n as u32,
            form,
            with_sh_coeffs,
        );
        [
            Some(v_means),
            Some(v_quats),
            Some(v_scales),
            Some(v_opacities),
            with_sh_coeffs.then_some(v_sh_dc),
            (with_sh_coeffs && others > 0).then_some(v_sh_rest),
        ]
    }
}

/// Constants that the kernels are compiled for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
struct Form {
    /// Scales and opacities are logarithms and logits.
    exp: bool,
    sh_degree: usize,
    n_coeffs: usize,
}

/// Coefficients as kernels take them: no device binds an empty buffer, and where there are only constant ones nothing
/// of the second is read.
fn bound(sh_dc: CubeTensor, sh_rest: CubeTensor) -> [CubeTensor; 2] {
    let sh_dc = contiguous(sh_dc);
    let sh_rest = match sh_rest.meta.num_elements() {
        0 => sh_dc.clone(),
        _ => contiguous(sh_rest),
    };
    [sh_dc, sh_rest]
}

fn form(view: &View<f32>, sh_rest: &CubeTensor) -> Form {
    Form {
        exp: view.activation == Activation::Exp,
        sh_degree: view.sh_degree,
        n_coeffs: 1 + sh_rest.meta.shape()[1],
    }
}

fn constants(view: &View<f32>) -> ViewConstantsLaunch {
    let vector = |[x, y, z]: [f32; 3]| Vec3Launch::new(x, y, z);
    let [x, y, z] = view.rotation.map(vector);
    ViewConstantsLaunch::new(
        vector(view.origin),
        Mat3Launch::new(x, y, z),
        vector(view.translation),
        vector(view.position),
        view.focal[0],
        view.focal[1],
        view.principal[0],
        view.principal[1],
        view.size[0],
        view.size[1],
        view.lowest[0],
        view.lowest[1],
        view.highest[0],
        view.highest[1],
        view.near_plane,
        view.low_pass,
        view_rest(view),
    )
}

/// Whether a splat is in the image and finite, and whether it is a needle.
#[derive(CubeType, Clone, Copy)]
struct Packed {
    seen: bool,
    is_needle: bool,
    /// The square of the Mahalanobis distance that is drawn.
    extent: f32,
}

/// The splat of a footprint.
#[cube]
fn pack(
    row: &mut Array<f32>, // [C]
    f: &Footprint,
    opacity: f32,
    raw_colour: &Vec3,
    view: &ViewConstants,
) -> Packed {
    let alpha_min = comptime!(ALPHA_MIN as f32);
    let g00 = f.row0.dot(&f.row0);
    let g11 = f.row1.dot(&f.row1);
    let xx = g00 + view.low_pass;
    let xy = f.row0.dot(&f.row1);
    let yy = g11 + view.low_pass;
    let normal = f.row0.cross(&f.row1);
    let det = normal.dot(&normal) + view.low_pass * (g00 + g11) + view.low_pass * view.low_pass;
    let extent = 2.0f32 * (opacity / alpha_min).ln();
    let radius_x = (extent * xx).sqrt();
    let radius_y = (extent * yy).sqrt();
    let x = view.focal_x * f.ratio_x + view.principal_x;
    let y = view.focal_y * f.ratio_y + view.principal_y;
    row[splats::MEAN_X] = x;
    row[splats::MEAN_Y] = y;
    row[splats::CONIC_A] = yy / det;
    row[splats::CONIC_B] = -xy / det;
    row[splats::CONIC_C] = xx / det;
    row[splats::OPACITY] = opacity;
    row[splats::RED] = f32::max(raw_colour.x, 0.0f32);
    row[splats::GREEN] = f32::max(raw_colour.y, 0.0f32);
    row[splats::BLUE] = f32::max(raw_colour.z, 0.0f32);
    row[splats::DEPTH] = f.point.z;
    row[splats::RADIUS_X] = radius_x;
    row[splats::RADIUS_Y] = radius_y;
    #[unroll]
    for column in N_BEFORE_NEEDLES..N_COLUMNS {
        row[column] = 0.0f32;
    }
    Packed {
        seen: x + radius_x > 0.0f32
            && x - radius_x < view.width
            && y + radius_y > 0.0f32
            && y - radius_y < view.height
            && is_finite(det),
        is_needle: is_needle(xx + yy, det),
        extent,
    }
}

#[cube(launch)]
fn project_kernel(
    gaussians: Ellipsoids,
    opacities: &[f32],  // [N]
    sh_dc: &[f32],      // [N, 1, 3]
    sh_rest: &[f32],    // [N, K - 1, 3]
    splats: &mut [f32], // [N, C]
    view: ViewConstants,
    n: u32,
    #[comptime] form: Form,
) {
    let i = ABSOLUTE_POS;
    if i >= n as usize {
        terminate!();
    }
    let raw_opacity = opacities[i];
    let mut opacity = raw_opacity;
    if comptime!(form.exp) {
        opacity = 1.0f32 / (1.0f32 + (-raw_opacity).exp());
    }
    let f = footprint_of(&gaussians, i, &view, form.exp);
    let raw_colour = colour(&gaussians.means, sh_dc, sh_rest, i, &view, form);
    let mut row = Array::<f32>::new(N_COLUMNS);
    let packed = pack(&mut row, &f, opacity, &raw_colour, &view);
    let opaque = opacity >= comptime!(ALPHA_MIN as f32) && is_finite(raw_opacity);
    let mut drawn = f.drawn && opaque && packed.seen && raw_colour.is_finite();
    if drawn && packed.is_needle {
        needle_of(&gaussians, i, &f, &view).write(&mut row, packed.extent);
    }
    #[unroll]
    for column in 0..N_COLUMNS {
        drawn = drawn && is_finite(row[column]);
    }
    #[unroll]
    for column in 0..N_COLUMNS {
        splats[i * N_COLUMNS + column] = select(drawn, row[column], 0.0f32);
    }
}
