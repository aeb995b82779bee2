//! Gradient of a row of tiles, replayed back to front.

use pulp::{Simd, WithSimd};

use crate::splats::{self, ALPHA_MAX, N_DIFFERENTIABLE};

use super::super::tiles::TILE;
use super::super::{CHANNEL_ALPHA, CHANNEL_DEPTH, N_CHANNELS, RasterizeOptions};
use super::band::{Band, LOG2_E, NeedleInTile, Record, TILE_PIXELS};
use super::lanes::{
    Conic, ConicLanes, Exponents, Moments, NeedleLanes, SplatLanes, TilePixels, any, exp2,
};

/// Gradient of the columns that have one.
pub type SplatGradient = [f32; N_DIFFERENTIABLE];

/// Gathers the gradients of a band's splats from its rows of the image's gradient.
pub struct BlendBandVjp<'a> {
    pub band: &'a Band,
    /// The band's rows of the image's gradient `[up to TILE, W, 5]`.
    pub v_pixels: &'a [f32],
    pub options: &'a RasterizeOptions,
}

/// A tile's pixels while splats are taken off them.
struct TileVjp {
    /// Transmittance behind the splats still to come.
    transmittance: TilePixels<f32>,
    /// Colour and depth accumulated behind those splats, times their gradients.
    accumulated: TilePixels<f32>,
    v_red: TilePixels<f32>,
    v_green: TilePixels<f32>,
    v_blue: TilePixels<f32>,
    v_depth: TilePixels<f32>,
    last: TilePixels<i32>,
    /// The largest `last` of each row.
    row_last: [i32; TILE],
}

/// Takes one needle off a tile.
struct ReplayNeedle<'a> {
    tile: &'a mut TileVjp,
    record: &'a Record,
    shape: NeedleInTile,
    place: i32,
    v_splat: &'a mut SplatGradient,
}

impl WithSimd for ReplayNeedle<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let (record, shape) = (self.record, &self.shape);
        let tile = self.tile;
        if let Some(sums) = tile.replay::<S, NeedleLanes<S>>(simd, record, shape, self.place) {
            sums.add_needle_to(simd, record, shape, self.v_splat);
        }
    }
}

/// Needles are few: the loop over splats has no code of theirs.
#[cold]
#[inline(never)]
fn replay_needle<S: Simd>(simd: S, needle: ReplayNeedle) {
    simd.vectorize(needle)
}

impl WithSimd for BlendBandVjp<'_> {
    type Output = Vec<SplatGradient>;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Vec<SplatGradient> {
        let mut v_splats = vec![[0.0; N_DIFFERENTIABLE]; self.band.records.len()];
        for tile in 0..self.options.width.div_ceil(TILE) {
            let mut state = TileVjp::new(&self, tile);
            let entries = self.band.tile(tile);
            let n_drawn = state.row_last.iter().fold(0, |most, &last| most.max(last));
            for place in (0..n_drawn).rev() {
                let index = entries[place as usize] as usize;
                let record = &self.band.records[index];
                let v_splat = &mut v_splats[index];
                let corner = [(tile * TILE) as f32, self.band.top as f32];
                match self.band.needle_in_tile(record, corner[0]) {
                    None => {
                        let shape = Conic::new(record, corner);
                        if let Some(sums) =
                            state.replay::<S, ConicLanes<S>>(simd, record, &shape, place)
                        {
                            sums.add_to(simd, record, v_splat);
                        }
                    }
                    Some(shape) => {
                        let tile = &mut state;
                        let needle = ReplayNeedle {
                            tile,
                            record,
                            shape,
                            place,
                            v_splat,
                        };
                        replay_needle(simd, needle);
                    }
                }
            }
        }
        v_splats
    }
}

impl TileVjp {
    #[inline(always)]
    fn new(pass: &BlendBandVjp, tile: usize) -> Self {
        let zero = TilePixels([0.0; TILE_PIXELS]);
        let mut state = Self {
            transmittance: zero,
            accumulated: zero,
            v_red: zero,
            v_green: zero,
            v_blue: zero,
            v_depth: zero,
            last: TilePixels([0; TILE_PIXELS]),
            row_last: [0; TILE],
        };
        let range = tile * TILE_PIXELS..(tile + 1) * TILE_PIXELS;
        state
            .transmittance
            .0
            .copy_from_slice(&pass.band.transmittance[range.clone()]);
        state.last.0.copy_from_slice(&pass.band.last[range]);
        for (row_last, last) in state
            .row_last
            .iter_mut()
            .zip(state.last.0.chunks_exact(TILE))
        {
            *row_last = last.iter().fold(0, |most, &last| most.max(last));
        }
        let width = pass.options.width;
        let left = tile * TILE;
        let n_columns = TILE.min(width - left);
        let background = pass.options.background;
        for (row, line) in pass.v_pixels.chunks_exact(width * N_CHANNELS).enumerate() {
            let line = &line[left * N_CHANNELS..(left + n_columns) * N_CHANNELS];
            for (column, v) in line.chunks_exact(N_CHANNELS).enumerate() {
                let i = row * TILE + column;
                state.v_red.0[i] = v[0];
                state.v_green.0[i] = v[1];
                state.v_blue.0[i] = v[2];
                state.v_depth.0[i] = v[CHANNEL_DEPTH];
                let behind = background[0] * v[0] + background[1] * v[1] + background[2] * v[2];
                state.accumulated.0[i] = state.transmittance.0[i] * (behind - v[CHANNEL_ALPHA]);
            }
        }
        state
    }

    /// Takes one splat off the tile; `None` where it was not drawn.
    #[inline(always)]
    fn replay<S: Simd, E: Exponents<S>>(
        &mut self,
        simd: S,
        record: &Record,
        shape: &E::Shape,
        place: i32,
    ) -> Option<Sums<S>> {
        let per_row = TILE / S::F32_LANES;
        let zero = simd.splat_f32s(0.0);
        let splat = SplatLanes::new(simd, record);
        let place_lanes = simd.splat_i32s(place);
        let mut sums = Sums::<S>::zero(simd);
        let mut any_drawn = false;
        for group in 0..per_row {
            let columns = E::new(simd, shape, group);
            let mut by_row = [zero; 3];
            let mut rows = record.row_bits();
            while rows != 0 {
                let row = rows.trailing_zeros() as usize;
                rows &= rows - 1;
                if self.row_last[row] <= place {
                    continue;
                }
                let i = row * per_row + group;
                let dy = E::dy(shape, row);
                let exponent = columns.exponent(simd, shape, dy);
                let drawn = simd.and_m32s(
                    splat.is_drawn(simd, exponent),
                    simd.greater_than_i32s(S::as_simd_i32s(&self.last.0).0[i], place_lanes),
                );
                if !any::<S>(drawn) {
                    continue;
                }
                any_drawn = true;
                let v = self.replay_pixels(simd, &splat, i, exponent, drawn, &mut sums);
                columns.add_row(simd, shape, v, dy, &mut by_row, &mut sums.moments);
            }
            columns.add_group(simd, by_row, &mut sums.moments);
        }
        any_drawn.then_some(sums)
    }

    /// Takes one splat off the pixels at `i` where it is `drawn`: `alpha v_alpha`.
    #[inline(always)]
    fn replay_pixels<S: Simd>(
        &mut self,
        simd: S,
        splat: &SplatLanes<S>,
        i: usize,
        exponent: S::f32s,
        drawn: S::m32s,
        sums: &mut Sums<S>,
    ) -> S::f32s {
        let zero = simd.splat_f32s(0.0);
        let one = simd.splat_f32s(1.0);
        let alpha_max = simd.splat_f32s(ALPHA_MAX as f32);
        let transmittance = &mut S::as_mut_simd_f32s(&mut self.transmittance.0).0[i];
        let accumulated = &mut S::as_mut_simd_f32s(&mut self.accumulated.0).0[i];
        let v_red = S::as_simd_f32s(&self.v_red.0).0[i];
        let v_green = S::as_simd_f32s(&self.v_green.0).0[i];
        let v_blue = S::as_simd_f32s(&self.v_blue.0).0[i];
        let v_depth = S::as_simd_f32s(&self.v_depth.0).0[i];

        let unclamped = simd.mul_f32s(splat.opacity, exp2(simd, exponent));
        let alpha = simd.min_f32s(unclamped, alpha_max);
        let inverse = simd.div_f32s(one, simd.sub_f32s(one, alpha));
        let after = *transmittance;
        let before = simd.mul_f32s(after, inverse);
        *transmittance = simd.select_f32s(drawn, before, after);
        let visibility = simd.select_f32s(drawn, simd.mul_f32s(alpha, before), zero);
        let v_colour = &mut sums.v_colour;
        v_colour[0] = simd.mul_add_e_f32s(visibility, v_red, v_colour[0]);
        v_colour[1] = simd.mul_add_e_f32s(visibility, v_green, v_colour[1]);
        v_colour[2] = simd.mul_add_e_f32s(visibility, v_blue, v_colour[2]);
        v_colour[3] = simd.mul_add_e_f32s(visibility, v_depth, v_colour[3]);
        let v_visibility = simd.mul_f32s(splat.depth, v_depth);
        let v_visibility = simd.mul_add_e_f32s(splat.blue, v_blue, v_visibility);
        let v_visibility = simd.mul_add_e_f32s(splat.green, v_green, v_visibility);
        let v_visibility = simd.mul_add_e_f32s(splat.red, v_red, v_visibility);
        let v_alpha = simd.sub_f32s(
            simd.mul_f32s(v_visibility, before),
            simd.mul_f32s(*accumulated, inverse),
        );
        *accumulated = simd.mul_add_e_f32s(visibility, v_visibility, *accumulated);
        let with_gradient =
            simd.and_m32s(drawn, simd.less_than_or_equal_f32s(unclamped, alpha_max));
        simd.select_f32s(with_gradient, simd.mul_f32s(v_alpha, unclamped), zero)
    }
}

/// Sums over a tile's pixels that a splat's gradient is made of.
struct Sums<S: Simd> {
    /// Gradients of red, green, blue and depth.
    v_colour: [S::f32s; 4],
    /// Of v = alpha v_alpha = -v_sigma.
    moments: Moments<S>,
}

impl<S: Simd> Sums<S> {
    #[inline(always)]
    fn zero(simd: S) -> Self {
        let zero = simd.splat_f32s(0.0);
        Self {
            v_colour: [zero; 4],
            moments: [zero; 6],
        }
    }

    /// The moments summed over the lanes.
    #[inline(always)]
    fn reduced(&self, simd: S) -> [f32; 6] {
        let mut reduced = [0.0; 6];
        for (sum, &moment) in reduced.iter_mut().zip(&self.moments) {
            *sum = simd.reduce_sum_f32s(moment);
        }
        reduced
    }

    /// Adds the gradient that the sums make of an ordinary splat to `v_splat`.
    #[inline(always)]
    fn add_to(&self, simd: S, record: &Record, v_splat: &mut SplatGradient) {
        let [m, m_x, m_xx, m_y, m_xy, m_yy] = self.reduced(simd);
        let [a, b, c] = record.conic();
        v_splat[splats::MEAN_X] -= a * m_x + b * m_y;
        v_splat[splats::MEAN_Y] -= b * m_x + c * m_y;
        v_splat[splats::CONIC_A] -= 0.5 * m_xx;
        v_splat[splats::CONIC_B] -= m_xy;
        v_splat[splats::CONIC_C] -= 0.5 * m_yy;
        self.add_colour(simd, record, m, v_splat);
    }

    /// The same of a needle; its shape's in the frame of its axes stands in place of the conic's.
    #[inline(always)]
    fn add_needle_to(
        &self,
        simd: S,
        record: &Record,
        shape: &NeedleInTile,
        v_splat: &mut SplatGradient,
    ) {
        let [m, m_w, m_ww, m_z, m_wz, m_zz] = self.reduced(simd);
        let [nx, ny] = shape.normal;
        let [across, along] = shape.factors.map(|factor| factor * (-2.0 / LOG2_E));
        let (v_w, v_z) = (across * m_w, along * m_z);
        v_splat[splats::MEAN_X] -= nx * v_w - ny * v_z;
        v_splat[splats::MEAN_Y] -= ny * v_w + nx * v_z;
        v_splat[splats::CONIC_A] -= 0.5 * m_ww;
        v_splat[splats::CONIC_B] -= m_wz;
        v_splat[splats::CONIC_C] -= 0.5 * m_zz;
        self.add_colour(simd, record, m, v_splat);
    }

    #[inline(always)]
    fn add_colour(&self, simd: S, record: &Record, m: f32, v_splat: &mut SplatGradient) {
        v_splat[splats::OPACITY] += m / record.opacity;
        v_splat[splats::RED] += simd.reduce_sum_f32s(self.v_colour[0]);
        v_splat[splats::GREEN] += simd.reduce_sum_f32s(self.v_colour[1]);
        v_splat[splats::BLUE] += simd.reduce_sum_f32s(self.v_colour[2]);
        v_splat[splats::DEPTH] += simd.reduce_sum_f32s(self.v_colour[3]);
    }
}
