//! Blending of a row of tiles, front to back.

use pulp::{Simd, WithSimd};

use crate::splats::{ALPHA_MAX, TRANSMITTANCE_STOP};

use super::super::tiles::TILE;
use super::super::{CHANNEL_ALPHA, CHANNEL_DEPTH, N_CHANNELS, RasterizeOptions};
use super::band::{Band, NeedleInTile, Record, TILE_PIXELS};
use super::lanes::{Conic, ConicLanes, Exponents, NeedleLanes, SplatLanes, TilePixels, any, exp2};

/// Draws a band's splats into its rows of the image.
pub struct BlendBand<'a> {
    pub band: &'a mut Band,
    /// The band's rows of the image `[up to TILE, W, 5]`.
    pub pixels: &'a mut [f32],
    pub options: &'a RasterizeOptions,
    /// Whether to leave transmittances and last splats in the band.
    pub save: bool,
}

/// A tile's pixels while splats are blended over them.
struct Tile {
    /// Transmittance behind the splats so far, negative once the pixel is finished.
    transmittance: TilePixels<f32>,
    /// Accumulated colour.
    red: TilePixels<f32>,
    green: TilePixels<f32>,
    blue: TilePixels<f32>,
    /// Accumulated depth.
    depth: TilePixels<f32>,
    /// One past the place of the last splat blended.
    last: TilePixels<i32>,
}

/// Draws one needle as [`Tile::draw_splat`] does.
struct DrawNeedle<'a> {
    tile: &'a mut Tile,
    record: &'a Record,
    shape: NeedleInTile,
    place: i32,
    alive: &'a mut [u32],
}

impl WithSimd for DrawNeedle<'_> {
    type Output = u32;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> u32 {
        self.tile.draw_splat::<S, NeedleLanes<S>>(
            simd,
            self.record,
            &self.shape,
            self.place,
            self.alive,
        )
    }
}

/// Needles are few: the loop over splats has no code of theirs.
#[cold]
#[inline(never)]
fn draw_needle<S: Simd>(simd: S, needle: DrawNeedle) -> u32 {
    simd.vectorize(needle)
}

impl WithSimd for BlendBand<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let width = self.options.width;
        let n_rows = self.pixels.len() / (width * N_CHANNELS);
        let n_tiles = width.div_ceil(TILE);
        if self.save {
            self.band.transmittance = vec![0.0; n_tiles * TILE_PIXELS];
            self.band.last = vec![0; n_tiles * TILE_PIXELS];
        }
        for tile in 0..n_tiles {
            let left = tile * TILE;
            let n_columns = TILE.min(width - left);
            let mut state = Tile::new(n_rows, n_columns);
            state.draw(simd, self.band, tile, n_rows);
            for row in 0..n_rows {
                let line = &mut self.pixels[(row * width + left) * N_CHANNELS..];
                state.write(row, &mut line[..n_columns * N_CHANNELS], self.options);
            }
            if self.save {
                let range = tile * TILE_PIXELS..(tile + 1) * TILE_PIXELS;
                let transmittance = &mut self.band.transmittance[range.clone()];
                for (to, from) in transmittance.iter_mut().zip(&state.transmittance.0) {
                    *to = from.abs();
                }
                self.band.last[range].copy_from_slice(&state.last.0);
            }
        }
    }
}

impl Tile {
    /// Pixels outside the image are finished from the start.
    #[inline(always)]
    fn new(n_rows: usize, n_columns: usize) -> Self {
        let mut transmittance = TilePixels([-1.0; TILE_PIXELS]);
        for row in 0..n_rows {
            transmittance.0[row * TILE..][..n_columns].fill(1.0);
        }
        let zero = TilePixels([0.0; TILE_PIXELS]);
        Self {
            transmittance,
            red: zero,
            green: zero,
            blue: zero,
            depth: zero,
            last: TilePixels([0; TILE_PIXELS]),
        }
    }

    #[inline(always)]
    fn draw<S: Simd>(&mut self, simd: S, band: &Band, tile: usize, n_rows: usize) {
        let per_row = TILE / S::F32_LANES;
        let left = (tile * TILE) as f32;
        // Rows that still have an unfinished pixel, for each group of columns.
        let mut alive = [0u32; TILE];
        alive[..per_row].fill((1 << n_rows) - 1);
        for (place, &index) in (1i32..).zip(band.tile(tile)) {
            let record = &band.records[index as usize];
            let any_alive = match band.needle_in_tile(record, left) {
                None => {
                    let shape = Conic::new(record, [left, band.top as f32]);
                    self.draw_splat::<S, ConicLanes<S>>(
                        simd,
                        record,
                        &shape,
                        place,
                        &mut alive[..per_row],
                    )
                }
                Some(shape) => draw_needle(
                    simd,
                    DrawNeedle {
                        tile: self,
                        record,
                        shape,
                        place,
                        alive: &mut alive[..per_row],
                    },
                ),
            };
            if any_alive == 0 {
                break;
            }
        }
    }

    /// Draws one splat; takes the rows that it finishes from those `alive` in each group of columns, and returns what
    /// is left in any of them.
    #[inline(always)]
    fn draw_splat<S: Simd, E: Exponents<S>>(
        &mut self,
        simd: S,
        record: &Record,
        shape: &E::Shape,
        place: i32,
        alive: &mut [u32],
    ) -> u32 {
        let rows = record.row_bits();
        let mut any_alive = 0;
        for (group, alive) in alive.iter_mut().enumerate() {
            if *alive & rows != 0 {
                *alive &=
                    !self.draw_group::<S, E>(simd, record, shape, place, group, *alive & rows);
            }
            any_alive |= *alive;
        }
        any_alive
    }

    /// Draws one splat into the rows given as bits, in one group of columns; returns the rows that
    /// it finished.
    #[inline(always)]
    fn draw_group<S: Simd, E: Exponents<S>>(
        &mut self,
        simd: S,
        record: &Record,
        shape: &E::Shape,
        place: i32,
        group: usize,
        mut rows: u32,
    ) -> u32 {
        let per_row = TILE / S::F32_LANES;
        let zero = simd.splat_f32s(0.0);
        let alpha_max = simd.splat_f32s(ALPHA_MAX as f32);
        let stop = simd.splat_f32s(TRANSMITTANCE_STOP as f32);
        let splat = SplatLanes::new(simd, record);
        let columns = E::new(simd, shape, group);
        let place = simd.splat_i32s(place);

        let transmittances = S::as_mut_simd_f32s(&mut self.transmittance.0).0;
        let reds = S::as_mut_simd_f32s(&mut self.red.0).0;
        let greens = S::as_mut_simd_f32s(&mut self.green.0).0;
        let blues = S::as_mut_simd_f32s(&mut self.blue.0).0;
        let depths = S::as_mut_simd_f32s(&mut self.depth.0).0;
        let lasts = S::as_mut_simd_i32s(&mut self.last.0).0;
        let mut finished = 0;
        while rows != 0 {
            let row = rows.trailing_zeros() as usize;
            rows &= rows - 1;
            let exponent = columns.exponent(simd, shape, E::dy(shape, row));
            let drawn = splat.is_drawn(simd, exponent);
            if !any::<S>(drawn) {
                continue;
            }
            let i = row * per_row + group;
            let unclamped = simd.mul_f32s(splat.opacity, exp2(simd, exponent));
            let alpha = simd.min_f32s(unclamped, alpha_max);
            let before = transmittances[i];
            let visibility = simd.mul_f32s(alpha, before);
            let after = simd.sub_f32s(before, visibility);
            let unfinished = simd.greater_than_or_equal_f32s(after, stop);
            let taken = simd.and_m32s(drawn, unfinished);
            let visibility = simd.select_f32s(taken, visibility, zero);
            reds[i] = simd.mul_add_e_f32s(visibility, splat.red, reds[i]);
            greens[i] = simd.mul_add_e_f32s(visibility, splat.green, greens[i]);
            blues[i] = simd.mul_add_e_f32s(visibility, splat.blue, blues[i]);
            depths[i] = simd.mul_add_e_f32s(visibility, splat.depth, depths[i]);
            lasts[i] = simd.select_i32s(taken, place, lasts[i]);
            let stopped = simd.and_m32s(drawn, simd.not_m32s(unfinished));
            let negative = simd.min_f32s(before, simd.sub_f32s(zero, before));
            let kept = simd.select_f32s(stopped, negative, before);
            let now = simd.select_f32s(taken, after, kept);
            transmittances[i] = now;
            if any::<S>(stopped) && !any::<S>(simd.greater_than_f32s(now, zero)) {
                finished |= 1 << row;
            }
        }
        finished
    }

    #[inline(always)]
    fn write(&self, row: usize, line: &mut [f32], options: &RasterizeOptions) {
        for (column, pixel) in line.chunks_exact_mut(N_CHANNELS).enumerate() {
            let i = row * TILE + column;
            let transmittance = self.transmittance.0[i].abs();
            let colour = [self.red.0[i], self.green.0[i], self.blue.0[i]];
            for channel in 0..3 {
                pixel[channel] = colour[channel] + transmittance * options.background[channel];
            }
            pixel[CHANNEL_ALPHA] = 1.0 - transmittance;
            pixel[CHANNEL_DEPTH] = self.depth.0[i];
        }
    }
}
