//! What blending needs beyond the SIMD operations of `pulp`.
//!
//! Code that uses those operations must be inlined into `with_simd`, closures included: a closure
//! handed to `array::map` is not, and then each operation becomes a call.

use pulp::{Simd, bytemuck};

use super::super::tiles::TILE;
use super::band::{Record, TILE_PIXELS};

/// A value for every pixel of a tile, row by row.
#[derive(Clone, Copy)]
#[repr(C, align(64))]
pub struct TilePixels<T>(pub [T; TILE_PIXELS]);

/// Offsets of the pixel centres of a row from the left edge of its tile.
pub const CENTRES: TilePixels<f32> = {
    let mut centres = [0.0; TILE_PIXELS];
    let mut i = 0;
    while i < TILE_PIXELS {
        centres[i] = (i % TILE) as f32 + 0.5;
        i += 1;
    }
    TilePixels(centres)
};

/// Whether any lane is set.
#[inline(always)]
pub fn any<S: Simd>(mask: S::m32s) -> bool {
    bytemuck::bytes_of(&mask)
        .iter()
        .fold(0, |or, byte| or | byte)
        != 0
}

/// 2^x to 2e-7 for x in [-126, 127]; anything elsewhere.
#[inline(always)]
pub fn exp2<S: Simd>(simd: S, x: S::f32s) -> S::f32s {
    // Adding 1.5 * 2^23 rounds to the nearest integer and leaves it in the lowest bits.
    let magic = simd.splat_f32s(12_582_912.0);
    let shifted = simd.add_f32s(x, magic);
    let fraction = simd.sub_f32s(x, simd.sub_f32s(shifted, magic));
    // Taylor coefficients of 2^f; |f| <= 1/2 leaves an error under 1.3e-7.
    let mut power = simd.splat_f32s(1.540_353e-4);
    for coefficient in [
        1.333_355_8e-3,
        9.618_129e-3,
        5.550_411e-2,
        2.402_265e-1,
        std::f32::consts::LN_2,
        1.0,
    ] {
        power = simd.mul_add_e_f32s(power, fraction, simd.splat_f32s(coefficient));
    }
    let exponent = simd.wrapping_dyn_shl_u32s(
        simd.transmute_u32s_f32s(shifted),
        simd.splat_u32s(f32::MANTISSA_DIGITS - 1),
    );
    simd.transmute_f32s_u32s(simd.add_u32s(simd.transmute_u32s_f32s(power), exponent))
}

/// A splat's values that all pixels share.
pub struct SplatLanes<S: Simd> {
    pub opacity: S::f32s,
    /// The exponent where alpha is 1/255.
    threshold: S::f32s,
    pub red: S::f32s,
    pub green: S::f32s,
    pub blue: S::f32s,
    pub depth: S::f32s,
}

impl<S: Simd> SplatLanes<S> {
    #[inline(always)]
    pub fn new(simd: S, record: &Record) -> Self {
        Self {
            opacity: simd.splat_f32s(record.opacity),
            threshold: simd.splat_f32s(record.threshold),
            red: simd.splat_f32s(record.red),
            green: simd.splat_f32s(record.green),
            blue: simd.splat_f32s(record.blue),
            depth: simd.splat_f32s(record.depth),
        }
    }

    /// Whether a pixel with this exponent shows the splat.
    #[inline(always)]
    pub fn is_drawn(&self, simd: S, exponent: S::f32s) -> S::m32s {
        simd.and_m32s(
            simd.greater_than_or_equal_f32s(exponent, self.threshold),
            simd.less_than_or_equal_f32s(exponent, simd.splat_f32s(0.0)),
        )
    }
}

/// The part of a splat's exponents that a group of columns shares.
pub struct ColumnLanes<S: Simd> {
    /// Offset of the splat's centre from the columns'.
    pub dx: S::f32s,
    squared: S::f32s,
    mixed: S::f32s,
}

impl<S: Simd> ColumnLanes<S> {
    /// Of one group of the tile whose left edge is at `left`.
    #[inline(always)]
    pub fn new(simd: S, record: &Record, left: f32, group: usize) -> Self {
        let centres = S::as_simd_f32s(&CENTRES.0).0[group];
        let dx = simd.sub_f32s(simd.splat_f32s(record.x - left), centres);
        Self {
            dx,
            squared: simd.mul_f32s(simd.splat_f32s(record.qa), simd.mul_f32s(dx, dx)),
            mixed: simd.mul_f32s(simd.splat_f32s(record.qb), dx),
        }
    }

    /// `log2(alpha / opacity)` in the row at offset `dy`.
    #[inline(always)]
    pub fn exponent(&self, simd: S, record: &Record, dy: f32) -> S::f32s {
        simd.mul_add_e_f32s(
            self.mixed,
            simd.splat_f32s(dy),
            simd.add_f32s(self.squared, simd.splat_f32s(record.qc * dy * dy)),
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Exp2<'a>(&'a mut [f32]);

    impl pulp::WithSimd for Exp2<'_> {
        type Output = ();

        #[inline(always)]
        fn with_simd<S: Simd>(self, simd: S) {
            let (head, tail) = S::as_mut_simd_f32s(self.0);
            assert!(tail.is_empty(), "the lanes divide the length");
            for values in head {
                *values = exp2(simd, *values);
            }
        }
    }

    #[test]
    fn exp2_is_accurate_over_the_exponents_of_alpha() {
        let arguments: Vec<f32> = (0..4096).map(|i| -12.0 * i as f32 / 4095.0).collect();
        let mut values = arguments.clone();
        pulp::Arch::new().dispatch(Exp2(&mut values));
        for (x, got) in arguments.iter().zip(values) {
            let expected = f64::from(*x).exp2();
            let error = (f64::from(got) / expected - 1.0).abs();
            assert!(error < 3e-7, "2^{x}: {got} instead of {expected}");
        }
    }
}
