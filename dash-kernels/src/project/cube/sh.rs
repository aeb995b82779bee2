//! View-dependent colour and its gradients; the basis is that of [`sh`](super::super::sh).

use cubecl::prelude::*;

use super::super::sh::{self, C0, C1, C2, C3};
use super::Form;
use super::linear::Vec3;
use super::values::ViewConstants;

/// Functions of the highest degree there is.
const MAX_BASIS: usize = 16;

/// The basis functions at a unit direction; entries beyond the degree are zero.
#[cube]
fn basis_at(direction: &Vec3, #[comptime] degree: usize) -> Array<f32> {
    let (x, y, z) = (direction.x, direction.y, direction.z);
    let mut basis = Array::<f32>::new(MAX_BASIS);
    basis[0] = comptime!(C0 as f32);
    if comptime!(degree >= 1) {
        basis[1] = comptime!(-C1 as f32) * y;
        basis[2] = comptime!(C1 as f32) * z;
        basis[3] = comptime!(-C1 as f32) * x;
    }
    let (xx, yy, zz) = (x * x, y * y, z * z);
    if comptime!(degree >= 2) {
        basis[4] = comptime!(C2[0] as f32) * x * y;
        basis[5] = comptime!(C2[1] as f32) * y * z;
        basis[6] = comptime!(C2[2] as f32) * (zz + zz - xx - yy);
        basis[7] = comptime!(C2[3] as f32) * x * z;
        basis[8] = comptime!(C2[4] as f32) * (xx - yy);
    }
    if comptime!(degree >= 3) {
        basis[9] = comptime!(C3[0] as f32) * y * (3.0f32 * xx - yy);
        basis[10] = comptime!(C3[1] as f32) * x * y * z;
        basis[11] = comptime!(C3[2] as f32) * y * (4.0f32 * zz - xx - yy);
        basis[12] = comptime!(C3[3] as f32) * z * (zz + zz - 3.0f32 * xx - 3.0f32 * yy);
        basis[13] = comptime!(C3[4] as f32) * x * (4.0f32 * zz - xx - yy);
        basis[14] = comptime!(C3[5] as f32) * z * (xx - yy);
        basis[15] = comptime!(C3[6] as f32) * x * (xx - 3.0f32 * yy);
    }
    basis
}

/// The pullback of [`basis_at`], to the direction.
#[cube]
fn basis_vjp(
    direction: &Vec3,
    v: &Array<f32>, // [MAX_BASIS]
    #[comptime] degree: usize,
) -> Vec3 {
    let (x, y, z) = (direction.x, direction.y, direction.z);
    let mut v_x = 0.0f32;
    let mut v_y = 0.0f32;
    let mut v_z = 0.0f32;
    if comptime!(degree >= 1) {
        let c = comptime!(C1 as f32);
        v_x -= c * v[3];
        v_y -= c * v[1];
        v_z += c * v[2];
    }
    if comptime!(degree >= 2) {
        let a = comptime!(C2[0] as f32) * v[4];
        let b = comptime!(C2[1] as f32) * v[5];
        let d = comptime!(C2[2] as f32) * v[6];
        let e = comptime!(C2[3] as f32) * v[7];
        let f = comptime!(C2[4] as f32) * v[8];
        v_x += a * y - 2.0f32 * d * x + e * z + 2.0f32 * f * x;
        v_y += a * x + b * z - 2.0f32 * d * y - 2.0f32 * f * y;
        v_z += b * y + 4.0f32 * d * z + e * x;
    }
    if comptime!(degree >= 3) {
        let (xx, yy, zz) = (x * x, y * y, z * z);
        let a = comptime!(C3[0] as f32) * v[9];
        let b = comptime!(C3[1] as f32) * v[10];
        let c = comptime!(C3[2] as f32) * v[11];
        let d = comptime!(C3[3] as f32) * v[12];
        let e = comptime!(C3[4] as f32) * v[13];
        let f = comptime!(C3[5] as f32) * v[14];
        let g = comptime!(C3[6] as f32) * v[15];
        v_x += a * 6.0f32 * x * y + b * y * z - c * 2.0f32 * x * y - d * 6.0f32 * x * z
            + e * (4.0f32 * zz - 3.0f32 * xx - yy)
            + f * 2.0f32 * x * z
            + g * 3.0f32 * (xx - yy);
        v_y += a * 3.0f32 * (xx - yy) + b * x * z + c * (4.0f32 * zz - xx - 3.0f32 * yy)
            - d * 6.0f32 * y * z
            - e * 2.0f32 * x * y
            - f * 2.0f32 * y * z
            - g * 6.0f32 * x * y;
        v_z += b * x * y
            + c * 8.0f32 * y * z
            + d * (6.0f32 * zz - 3.0f32 * xx - 3.0f32 * yy)
            + e * 8.0f32 * x * z
            + f * (xx - yy);
    }
    Vec3 {
        x: v_x,
        y: v_y,
        z: v_z,
    }
}

/// A coefficient, but for the constant one, of the three channels.
#[cube]
fn coefficient(
    sh_rest: &[f32], // [N, K - 1, 3]
    i: usize,
    k: usize,
    #[comptime] n_coeffs: usize,
) -> Vec3 {
    Vec3::read(sh_rest, i * comptime!(n_coeffs - 1) + k - 1)
}

/// The colour of Gaussian `i` before it is clamped at zero.
#[cube]
pub(super) fn colour(
    means: &[f32],   // [N, 3]
    sh_dc: &[f32],   // [N, 1, 3]
    sh_rest: &[f32], // [N, K - 1, 3]
    i: usize,
    view: &ViewConstants,
    #[comptime] form: Form,
) -> Vec3 {
    let offset = view.offset(&Vec3::read(means, i));
    let direction = offset.scaled(1.0f32 / offset.dot(&offset).sqrt());
    let basis = basis_at(&direction, form.sh_degree);
    let constant = Vec3::read(sh_dc, i);
    let mut red = 0.5f32 + constant.x * basis[0];
    let mut green = 0.5f32 + constant.y * basis[0];
    let mut blue = 0.5f32 + constant.z * basis[0];
    #[unroll]
    for k in 1..comptime!(sh::N_COEFFS[form.sh_degree]) {
        let coefficient = coefficient(sh_rest, i, k, form.n_coeffs);
        red += coefficient.x * basis[k];
        green += coefficient.y * basis[k];
        blue += coefficient.z * basis[k];
    }
    Vec3 {
        x: red,
        y: green,
        z: blue,
    }
}

/// Gradients of colour coefficients.
#[derive(CubeType, CubeLaunch)]
pub(super) struct ShGradients {
    v_sh_dc: Box<[f32]>,   // [N, 1, 3]
    v_sh_rest: Box<[f32]>, // [N, K - 1, 3]
}

#[cube]
impl ShGradients {
    /// Those of Gaussian `i`, of a colour's gradient; zero beyond the degree.
    fn write(
        &mut self,
        i: usize,
        basis: &Array<f32>, // [MAX_BASIS]
        v_colour: &Vec3,
        #[comptime] form: Form,
    ) {
        let n_seen = comptime!(sh::N_COEFFS[form.sh_degree]);
        v_colour.scaled(basis[0]).write(&mut self.v_sh_dc, i);
        #[unroll]
        for k in 1..comptime!(form.n_coeffs) {
            let row = i * comptime!(form.n_coeffs - 1) + k - 1;
            if comptime!(k < n_seen) {
                v_colour.scaled(basis[k]).write(&mut self.v_sh_rest, row);
            } else {
                Vec3::zero().write(&mut self.v_sh_rest, row);
            }
        }
    }

    /// Those of Gaussian `i`, which is not seen.
    pub fn write_zeros(&mut self, i: usize, #[comptime] form: Form) {
        Vec3::zero().write(&mut self.v_sh_dc, i);
        #[unroll]
        for k in 1..comptime!(form.n_coeffs) {
            let row = i * comptime!(form.n_coeffs - 1) + k - 1;
            Vec3::zero().write(&mut self.v_sh_rest, row);
        }
    }
}

/// The pullback of [`colour`]: to the mean through the direction it is seen from. The coefficients' gradient is written
/// to `v_sh` where it is asked for: zero where `v_colour` is not finite.
#[cube]
pub(super) fn colour_vjp(
    means: &[f32],   // [N, 3]
    sh_rest: &[f32], // [N, K - 1, 3]
    v_sh: &mut ShGradients,
    i: usize,
    view: &ViewConstants,
    v_colour: &Vec3,
    #[comptime] form: Form,
    #[comptime] with_sh_coeffs: bool,
) -> Vec3 {
    let offset = view.offset(&Vec3::read(means, i));
    let inverse_distance = 1.0f32 / offset.dot(&offset).sqrt();
    let direction = offset.scaled(inverse_distance);
    if comptime!(with_sh_coeffs) {
        if v_colour.is_finite() {
            let basis = basis_at(&direction, form.sh_degree);
            v_sh.write(i, &basis, v_colour, form);
        } else {
            v_sh.write_zeros(i, form);
        }
    }
    let mut v_mean = Vec3::zero();
    if comptime!(form.sh_degree > 0) {
        // The constant function has no direction.
        let mut v_basis = Array::<f32>::new(MAX_BASIS);
        #[unroll]
        for k in 1..comptime!(sh::N_COEFFS[form.sh_degree]) {
            v_basis[k] = coefficient(sh_rest, i, k, form.n_coeffs).dot(v_colour);
        }
        let v_direction = basis_vjp(&direction, &v_basis, form.sh_degree);
        let along = v_direction.dot(&direction);
        v_mean.x = (v_direction.x - along * direction.x) * inverse_distance;
        v_mean.y = (v_direction.y - along * direction.y) * inverse_distance;
        v_mean.z = (v_direction.z - along * direction.z) * inverse_distance;
    }
    v_mean
}
