//! What blending needs beyond the SIMD operations of `pulp`.
//!
//! Code that uses those operations must be inlined into `with_simd`, closures included: a closure
//! handed to `array::map` is not, and then each operation becomes a call.

use pulp::{Simd, bytemuck};

use crate::splats::EXPONENT_ROUNDING;

use super::super::tiles::TILE;
use super::band::{NeedleInTile, Record, TILE_PIXELS};

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
            simd.less_than_or_equal_f32s(exponent, simd.splat_f32s(EXPONENT_ROUNDING)),
        )
    }
}

/// The exponents of a splat in a group of a tile's columns.
pub trait Exponents<S: Simd> {
    /// The form of the splat that all groups share.
    type Shape: Copy;

    /// Of one group.
    fn new(simd: S, shape: &Self::Shape, group: usize) -> Self;

    /// Offset of the splat's point of reference from the centres of a row.
    fn dy(shape: &Self::Shape, row: usize) -> f32;

    /// `log2(alpha / opacity)` in the row at offset `dy`.
    fn exponent(&self, simd: S, shape: &Self::Shape, dy: f32) -> S::f32s;

    /// Takes the gradient `v` of a row into `by_row`, or into the moments.
    fn add_row(
        &self,
        simd: S,
        shape: &Self::Shape,
        v: S::f32s,
        dy: f32,
        by_row: &mut [S::f32s; 3],
        moments: &mut Moments<S>,
    );

    /// Adds what `by_row` holds of the group's rows to the moments.
    fn add_group(&self, simd: S, by_row: [S::f32s; 3], moments: &mut Moments<S>);
}

/// Sums of a gradient times 1, x, x^2, y, x y, y^2, with x and y the offset from the splat's centre; of a needle the
/// distances across and along, so that small differences of large sums are not needed.
pub type Moments<S> = [<S as Simd>::f32s; 6];

/// An ordinary splat in a tile; its point of reference is the centre.
#[derive(Clone, Copy)]
pub struct Conic<'a> {
    record: &'a Record,
    left: f32,
    top: f32,
}

impl<'a> Conic<'a> {
    /// In the tile with this corner.
    #[inline(always)]
    pub fn new(record: &'a Record, [left, top]: [f32; 2]) -> Self {
        Self { record, left, top }
    }
}

/// The part of an ordinary splat's exponents that a group of columns shares.
pub struct ConicLanes<'a, S: Simd> {
    dx: S::f32s,
    squared: S::f32s,
    mixed: S::f32s,
    shape: std::marker::PhantomData<&'a Record>,
}

impl<'a, S: Simd> Exponents<S> for ConicLanes<'a, S> {
    type Shape = Conic<'a>;

    #[inline(always)]
    fn new(simd: S, shape: &Conic<'a>, group: usize) -> Self {
        let record = shape.record;
        let centres = S::as_simd_f32s(&CENTRES.0).0[group];
        let dx = simd.sub_f32s(simd.splat_f32s(record.x - shape.left), centres);
        Self {
            dx,
            squared: simd.mul_f32s(simd.splat_f32s(record.qa), simd.mul_f32s(dx, dx)),
            mixed: simd.mul_f32s(simd.splat_f32s(record.qb), dx),
            shape: std::marker::PhantomData,
        }
    }

    #[inline(always)]
    fn dy(shape: &Conic<'a>, row: usize) -> f32 {
        shape.record.y - shape.top - (row as f32 + 0.5)
    }

    #[inline(always)]
    fn exponent(&self, simd: S, shape: &Conic<'a>, dy: f32) -> S::f32s {
        simd.mul_add_e_f32s(
            self.mixed,
            simd.splat_f32s(dy),
            simd.add_f32s(self.squared, simd.splat_f32s(shape.record.qc * dy * dy)),
        )
    }

    #[inline(always)]
    fn add_row(
        &self,
        simd: S,
        _: &Conic<'a>,
        v: S::f32s,
        dy: f32,
        by_row: &mut [S::f32s; 3],
        _: &mut Moments<S>,
    ) {
        let dy = simd.splat_f32s(dy);
        let v_dy = simd.mul_f32s(v, dy);
        by_row[0] = simd.add_f32s(by_row[0], v);
        by_row[1] = simd.add_f32s(by_row[1], v_dy);
        by_row[2] = simd.mul_add_e_f32s(v_dy, dy, by_row[2]);
    }

    #[inline(always)]
    fn add_group(&self, simd: S, by_row: [S::f32s; 3], moments: &mut Moments<S>) {
        let by_dx = simd.mul_f32s(by_row[0], self.dx);
        moments[0] = simd.add_f32s(moments[0], by_row[0]);
        moments[1] = simd.add_f32s(moments[1], by_dx);
        moments[2] = simd.mul_add_e_f32s(by_dx, self.dx, moments[2]);
        moments[3] = simd.add_f32s(moments[3], by_row[1]);
        moments[4] = simd.mul_add_e_f32s(by_row[1], self.dx, moments[4]);
        moments[5] = simd.add_f32s(moments[5], by_row[2]);
    }
}

/// The part of a needle's distances across and along that a group of columns shares; the point of reference is the
/// axis' point next to the tile's middle, from where all of them are small.
pub struct NeedleLanes<S: Simd> {
    across: S::f32s,
    along: S::f32s,
}

impl<S: Simd> NeedleLanes<S> {
    /// The distances in a row.
    #[inline(always)]
    fn distances(&self, simd: S, shape: &NeedleInTile, dy: f32) -> [S::f32s; 2] {
        let [nx, ny] = shape.normal;
        [
            simd.add_f32s(self.across, simd.splat_f32s(ny * dy)),
            simd.add_f32s(self.along, simd.splat_f32s(nx * dy)),
        ]
    }
}

impl<S: Simd> Exponents<S> for NeedleLanes<S> {
    type Shape = NeedleInTile;

    #[inline(always)]
    fn new(simd: S, shape: &NeedleInTile, group: usize) -> Self {
        let centres = S::as_simd_f32s(&CENTRES.0).0[group];
        let [nx, ny] = shape.normal;
        let dx = simd.sub_f32s(simd.splat_f32s(shape.foot[0]), centres);
        let far = simd.splat_f32s(shape.far);
        Self {
            across: simd.mul_f32s(simd.splat_f32s(nx), dx),
            along: simd.sub_f32s(far, simd.mul_f32s(simd.splat_f32s(ny), dx)),
        }
    }

    #[inline(always)]
    fn dy(shape: &NeedleInTile, row: usize) -> f32 {
        shape.foot[1] - (row as f32 + 0.5)
    }

    #[inline(always)]
    fn exponent(&self, simd: S, shape: &NeedleInTile, dy: f32) -> S::f32s {
        let [w, z] = self.distances(simd, shape, dy);
        let [across, along] = shape.factors;
        let across = simd.mul_f32s(simd.splat_f32s(across), simd.mul_f32s(w, w));
        let along = simd.mul_f32s(simd.splat_f32s(along), simd.mul_f32s(z, z));
        simd.add_f32s(across, along)
    }

    #[inline(always)]
    fn add_row(
        &self,
        simd: S,
        shape: &NeedleInTile,
        v: S::f32s,
        dy: f32,
        _: &mut [S::f32s; 3],
        moments: &mut Moments<S>,
    ) {
        let [w, z] = self.distances(simd, shape, dy);
        let (v_w, v_z) = (simd.mul_f32s(v, w), simd.mul_f32s(v, z));
        moments[0] = simd.add_f32s(moments[0], v);
        moments[1] = simd.add_f32s(moments[1], v_w);
        moments[2] = simd.mul_add_e_f32s(v_w, w, moments[2]);
        moments[3] = simd.add_f32s(moments[3], v_z);
        moments[4] = simd.mul_add_e_f32s(v_w, z, moments[4]);
        moments[5] = simd.mul_add_e_f32s(v_z, z, moments[5]);
    }

    #[inline(always)]
    fn add_group(&self, _: S, _: [S::f32s; 3], _: &mut Moments<S>) {}
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
