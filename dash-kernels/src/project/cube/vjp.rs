//! Gradients of one Gaussian's projection.

use cubecl::prelude::*;

use crate::cube::is_finite;
use crate::splats::{self, N_COLUMNS};

use super::Form;
use super::footprint::{footprint_of, footprint_vjp};
use super::linear::{Quat, Vec3};
use super::sh::{ShGradients, colour_vjp};
use super::values::{Ellipsoids, ViewConstants};

/// Gradient of the colour before it was clamped at zero.
#[cube]
fn clamped_colour_vjp(
    splats: &[f32],   // [N, C]
    v_splats: &[f32], // [N, C]
    at: usize,
) -> Vec3 {
    let red = splats[at + splats::RED] > 0.0f32;
    let green = splats[at + splats::GREEN] > 0.0f32;
    let blue = splats[at + splats::BLUE] > 0.0f32;
    Vec3 {
        x: select(red, v_splats[at + splats::RED], 0.0f32),
        y: select(green, v_splats[at + splats::GREEN], 0.0f32),
        z: select(blue, v_splats[at + splats::BLUE], 0.0f32),
    }
}

/// The gradient of a scale from that of its logarithm; the gradient of a scale of zero is zero.
#[cube]
fn per_scale(v_log: f32, scale: f32) -> f32 {
    let is_zero = scale == 0.0f32;
    select(is_zero, 0.0f32, v_log / select(is_zero, 1.0f32, scale))
}

/// The gradients that the kernel writes.
#[derive(CubeType, CubeLaunch)]
pub(super) struct Gradients {
    v_means: Box<[f32]>,     // [N, 3]
    v_quats: Box<[f32]>,     // [N, 4]
    v_scales: Box<[f32]>,    // [N, 3]
    v_opacities: Box<[f32]>, // [N]
    v_sh: ShGradients,
}

/// The gradients of one Gaussian but for its colour.
#[derive(CubeType, Clone, Copy)]
struct GaussianGradient {
    mean: Vec3,
    quat: Quat,
    scale: Vec3,
    opacity: f32,
}

#[cube]
impl GaussianGradient {
    fn zero() -> GaussianGradient {
        GaussianGradient {
            mean: Vec3::zero(),
            quat: Quat::zero(),
            scale: Vec3::zero(),
            opacity: 0.0f32,
        }
    }

    fn is_finite(&self) -> bool {
        self.mean.is_finite()
            && self.scale.is_finite()
            && is_finite(self.opacity)
            && self.quat.is_finite()
    }

    fn write(&self, gradients: &mut Gradients, i: usize) {
        self.mean.write(&mut gradients.v_means, i);
        self.quat.write(&mut gradients.v_quats, i);
        self.scale.write(&mut gradients.v_scales, i);
        gradients.v_opacities[i] = self.opacity;
    }
}

#[cube(launch)]
pub(super) fn project_vjp_kernel(
    gaussians: Ellipsoids,
    sh_rest: &[f32],  // [N, K - 1, 3]
    splats: &[f32],   // [N, C]
    v_splats: &[f32], // [N, C]
    mut gradients: Gradients,
    view: ViewConstants,
    n: u32,
    #[comptime] form: Form,
    #[comptime] with_sh_coeffs: bool,
) {
    let i = ABSOLUTE_POS;
    if i >= n as usize {
        terminate!();
    }
    let at = i * N_COLUMNS;
    GaussianGradient::zero().write(&mut gradients, i);
    if splats[at + splats::RADIUS_X] > 0.0f32 {
        let f = footprint_of(&gaussians, i, &view, form.exp);
        let v = footprint_vjp(&gaussians, i, &f, splats, v_splats, &view);
        let v_colour = clamped_colour_vjp(splats, v_splats, at);
        let v_direction = colour_vjp(
            &gaussians.means,
            sh_rest,
            &mut gradients.v_sh,
            i,
            &view,
            &v_colour,
            form,
            with_sh_coeffs,
        );
        let v_mean = view.rotation.transposed_times_vector(&v.v_point);
        let mut own = GaussianGradient {
            mean: v_mean.plus(&v_direction),
            quat: v.v_quat,
            scale: v.v_log_scale,
            opacity: v_splats[at + splats::OPACITY],
        };
        if comptime!(form.exp) {
            let opacity = splats[at + splats::OPACITY];
            own.opacity *= opacity * (1.0f32 - opacity);
        } else {
            own.scale.x = per_scale(own.scale.x, f.scale.x);
            own.scale.y = per_scale(own.scale.y, f.scale.y);
            own.scale.z = per_scale(own.scale.z, f.scale.z);
        }
        if f.drawn && own.is_finite() {
            own.write(&mut gradients, i);
        }
    } else if comptime!(with_sh_coeffs) {
        gradients.v_sh.write_zeros(i, form);
    }
}
