//! What a unit sums of a splat's gradient.

use cubecl::prelude::*;

use crate::splats;

use super::tile::{Splat, across_along};

/// Sums over a unit's pixels of the gradient of sigma times 1, x, y and their products, with (x, y) the offset from a
/// pixel; of a needle the distances across and along, so that small differences of large sums are not needed. The pixels
/// lie below each other: without a needle the sums with x follow from the others.
#[derive(CubeType, Clone, Copy)]
pub(super) struct Moments {
    pub v: f32,
    x: f32,
    y: f32,
    xx: f32,
    xy: f32,
    yy: f32,
}

#[cube]
impl Moments {
    pub fn zero() -> Moments {
        Moments {
            v: 0.0f32,
            x: 0.0f32,
            y: 0.0f32,
            xx: 0.0f32,
            xy: 0.0f32,
            yy: 0.0f32,
        }
    }

    pub fn add_conic(&mut self, v: f32, dy: f32) {
        self.v += v;
        self.y += v * dy;
        self.yy += v * dy * dy;
    }

    pub fn add_needle(&mut self, v: f32, splat: &Splat, dx: f32, dy: f32) {
        let (w, z) = across_along(splat, dx, dy);
        self.v += v;
        self.x += v * w;
        self.y += v * z;
        self.xx += v * w * w;
        self.xy += v * w * z;
        self.yy += v * z * z;
    }

    pub fn write_conic(
        &self,
        v: &mut Array<f32>, // [N_DIFFERENTIABLE]
        splat: &Splat,
        dx: f32,
    ) {
        let x = self.v * dx;
        v[splats::MEAN_X] = splat.a * x + splat.b * self.y;
        v[splats::MEAN_Y] = splat.b * x + splat.c * self.y;
        v[splats::CONIC_A] = 0.5f32 * x * dx;
        v[splats::CONIC_B] = self.y * dx;
        v[splats::CONIC_C] = 0.5f32 * self.yy;
    }

    /// The shape's gradient in the frame of its axes stands in place of the conic's.
    pub fn write_needle(
        &self,
        v: &mut Array<f32>, // [N_DIFFERENTIABLE]
        splat: &Splat,
    ) {
        let (v_w, v_z) = (splat.across * self.x, splat.along * self.y);
        v[splats::MEAN_X] = splat.a * v_w - splat.b * v_z;
        v[splats::MEAN_Y] = splat.b * v_w + splat.a * v_z;
        v[splats::CONIC_A] = 0.5f32 * self.xx;
        v[splats::CONIC_B] = self.xy;
        v[splats::CONIC_C] = 0.5f32 * self.yy;
    }
}
