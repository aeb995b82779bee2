//! Gradient of a row of tiles, replayed back to front.

use pulp::{Simd, WithSimd};

use crate::splats::{self, ALPHA_MAX, N_DIFFERENTIABLE};

use super::super::tiles::TILE;
use super::super::{CHANNEL_ALPHA, CHANNEL_DEPTH, N_CHANNELS, RasterizeOptions};
use super::band::{Band, Record, TILE_PIXELS};
use super::lanes::{CENTRES, TilePixels, any, exp2};

/// Gradient of the columns that have one.
pub type SplatGradient = [f32; N_DIFFERENTIABLE];

/// Gathers the gradients of a band's splats from its rows of the image's gradient.
pub struct BlendBandVjp<'a> {
    pub band: &'a Band,
    /// The band's rows of the image's gradient `[up to TILE, W, 5]`.
    pub v_pixels: &'a [f32],
    pub options: &'a RasterizeOptions,
}

/// What is known of a tile's pixels while it is replayed.
struct TileVjp {
    /// Transmittance behind the splats still to come.
    transmittance: TilePixels<f32>,
    /// What lies behind those splats, as the loss sees it.
    behind: TilePixels<f32>,
    v_red: TilePixels<f32>,
    v_green: TilePixels<f32>,
    v_blue: TilePixels<f32>,
    v_depth: TilePixels<f32>,
    last: TilePixels<i32>,
    /// The largest `last` of each row.
    row_last: [i32; TILE],
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
                state.replay(
                    simd,
                    record,
                    place,
                    [(tile * TILE) as f32, self.band.top as f32],
                    v_splat,
                );
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
            behind: zero,
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
                let seen = background[0] * v[0] + background[1] * v[1] + background[2] * v[2];
                state.behind.0[i] = state.transmittance.0[i] * (seen - v[CHANNEL_ALPHA]);
            }
        }
        state
    }

    /// Takes one splat off the tile and adds its gradient to `v_splat`.
    #[inline(always)]
    fn replay<S: Simd>(
        &mut self,
        simd: S,
        record: &Record,
        place: i32,
        [left, top]: [f32; 2],
        v_splat: &mut SplatGradient,
    ) {
        let per_row = TILE / S::F32_LANES;
        let zero = simd.splat_f32s(0.0);
        let one = simd.splat_f32s(1.0);
        let threshold = simd.splat_f32s(record.threshold);
        let opacity = simd.splat_f32s(record.opacity);
        let alpha_max = simd.splat_f32s(ALPHA_MAX as f32);
        let (red, green) = (simd.splat_f32s(record.red), simd.splat_f32s(record.green));
        let (blue, depth) = (simd.splat_f32s(record.blue), simd.splat_f32s(record.depth));
        let place_lanes = simd.splat_i32s(place);

        let transmittances = S::as_mut_simd_f32s(&mut self.transmittance.0).0;
        let behinds = S::as_mut_simd_f32s(&mut self.behind.0).0;
        let v_reds = S::as_simd_f32s(&self.v_red.0).0;
        let v_greens = S::as_simd_f32s(&self.v_green.0).0;
        let v_blues = S::as_simd_f32s(&self.v_blue.0).0;
        let v_depths = S::as_simd_f32s(&self.v_depth.0).0;
        let lasts = S::as_simd_i32s(&self.last.0).0;

        let mut v_colour = [zero; 4];
        // Sums of v = alpha v_alpha = -v_sigma times 1, dx, dx^2, dy, dx dy, dy^2.
        let mut moments = [zero; 6];
        let mut any_drawn = false;
        for group in 0..per_row {
            let centres = S::as_simd_f32s(&CENTRES.0).0[group];
            let dx = simd.sub_f32s(simd.splat_f32s(record.x - left), centres);
            let squared = simd.mul_f32s(simd.splat_f32s(record.qa), simd.mul_f32s(dx, dx));
            let mixed = simd.mul_f32s(simd.splat_f32s(record.qb), dx);
            let mut by_dy = [zero; 3];
            let mut rows = record.row_bits();
            while rows != 0 {
                let row = rows.trailing_zeros() as usize;
                rows &= rows - 1;
                if self.row_last[row] <= place {
                    continue;
                }
                let i = row * per_row + group;
                let dy = record.y - top - (row as f32 + 0.5);
                let dy_lanes = simd.splat_f32s(dy);
                let exponent = simd.mul_add_e_f32s(
                    mixed,
                    dy_lanes,
                    simd.add_f32s(squared, simd.splat_f32s(record.qc * dy * dy)),
                );
                let drawn = simd.and_m32s(
                    simd.and_m32s(
                        simd.greater_than_or_equal_f32s(exponent, threshold),
                        simd.less_than_or_equal_f32s(exponent, zero),
                    ),
                    simd.greater_than_i32s(lasts[i], place_lanes),
                );
                if !any::<S>(drawn) {
                    continue;
                }
                any_drawn = true;
                let unclamped = simd.mul_f32s(opacity, exp2(simd, exponent));
                let alpha = simd.min_f32s(unclamped, alpha_max);
                let inverse = simd.div_f32s(one, simd.sub_f32s(one, alpha));
                let after = transmittances[i];
                let before = simd.mul_f32s(after, inverse);
                transmittances[i] = simd.select_f32s(drawn, before, after);
                let weight = simd.select_f32s(drawn, simd.mul_f32s(alpha, before), zero);
                let (v_red, v_green) = (v_reds[i], v_greens[i]);
                let (v_blue, v_depth) = (v_blues[i], v_depths[i]);
                v_colour[0] = simd.mul_add_e_f32s(weight, v_red, v_colour[0]);
                v_colour[1] = simd.mul_add_e_f32s(weight, v_green, v_colour[1]);
                v_colour[2] = simd.mul_add_e_f32s(weight, v_blue, v_colour[2]);
                v_colour[3] = simd.mul_add_e_f32s(weight, v_depth, v_colour[3]);
                let own = simd.mul_f32s(depth, v_depth);
                let own = simd.mul_add_e_f32s(blue, v_blue, own);
                let own = simd.mul_add_e_f32s(green, v_green, own);
                let own = simd.mul_add_e_f32s(red, v_red, own);
                let behind = behinds[i];
                let v_alpha =
                    simd.sub_f32s(simd.mul_f32s(own, before), simd.mul_f32s(behind, inverse));
                behinds[i] = simd.mul_add_e_f32s(weight, own, behind);
                let with_gradient =
                    simd.and_m32s(drawn, simd.less_than_or_equal_f32s(unclamped, alpha_max));
                let v = simd.select_f32s(with_gradient, simd.mul_f32s(v_alpha, unclamped), zero);
                let v_dy = simd.mul_f32s(v, dy_lanes);
                by_dy[0] = simd.add_f32s(by_dy[0], v);
                by_dy[1] = simd.add_f32s(by_dy[1], v_dy);
                by_dy[2] = simd.mul_add_e_f32s(v_dy, dy_lanes, by_dy[2]);
            }
            let by_dx = simd.mul_f32s(by_dy[0], dx);
            moments[0] = simd.add_f32s(moments[0], by_dy[0]);
            moments[1] = simd.add_f32s(moments[1], by_dx);
            moments[2] = simd.mul_add_e_f32s(by_dx, dx, moments[2]);
            moments[3] = simd.add_f32s(moments[3], by_dy[1]);
            moments[4] = simd.mul_add_e_f32s(by_dy[1], dx, moments[4]);
            moments[5] = simd.add_f32s(moments[5], by_dy[2]);
        }
        if !any_drawn {
            return;
        }
        let (m, m_x, m_xx) = (
            simd.reduce_sum_f32s(moments[0]),
            simd.reduce_sum_f32s(moments[1]),
            simd.reduce_sum_f32s(moments[2]),
        );
        let (m_y, m_xy, m_yy) = (
            simd.reduce_sum_f32s(moments[3]),
            simd.reduce_sum_f32s(moments[4]),
            simd.reduce_sum_f32s(moments[5]),
        );
        let [a, b, c] = record.conic();
        v_splat[splats::MEAN_X] -= a * m_x + b * m_y;
        v_splat[splats::MEAN_Y] -= b * m_x + c * m_y;
        v_splat[splats::CONIC_A] -= 0.5 * m_xx;
        v_splat[splats::CONIC_B] -= m_xy;
        v_splat[splats::CONIC_C] -= 0.5 * m_yy;
        v_splat[splats::OPACITY] += m / record.opacity;
        v_splat[splats::RED] += simd.reduce_sum_f32s(v_colour[0]);
        v_splat[splats::GREEN] += simd.reduce_sum_f32s(v_colour[1]);
        v_splat[splats::BLUE] += simd.reduce_sum_f32s(v_colour[2]);
        v_splat[splats::DEPTH] += simd.reduce_sum_f32s(v_colour[3]);
    }
}
