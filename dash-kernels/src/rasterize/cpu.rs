//! Rasterization on the CPU.
//!
//! One depth sort of the visible splats, then a stable counting sort into bands (rows of tiles);
//! each band is one piece of parallel work that sorts its splats into its tiles and blends them,
//! a row of a tile per SIMD step. No two pieces share a sum: a band keeps its own gradient of
//! every splat it draws, and a splat's gradients are added up over its bands from top to bottom,
//! so results do not depend on the number of threads.

mod band;
mod blend;
mod blend_vjp;
mod lanes;

use std::sync::Arc;

use rayon::prelude::*;

use crate::splats::{self, N_COLUMNS, N_DIFFERENTIABLE, is_finite};

use super::tiles::{Bands, Footprint, TILE, depth_order};
use super::{N_CHANNELS, RasterizeOptions};
use band::Band;
use blend::BlendBand;
use blend_vjp::{BlendBandVjp, SplatGradient};

/// Rows per parallel piece of per-splat work.
const PIECE: usize = 1024;

/// State of the forward pass for the backward pass.
#[derive(Debug, Clone)]
pub struct Saved(Arc<Pass>);

#[derive(Debug)]
struct Pass {
    n_splats: usize,
    options: RasterizeOptions,
    bands: Bands,
    blended: Vec<Band>,
}

impl Saved {
    /// Rows of the packed splats.
    pub fn n_splats(&self) -> usize {
        self.0.n_splats
    }
}

/// The image `[H, W, 5]` of `splats [N, C]`.
pub fn rasterize(splats: &[f32], options: &RasterizeOptions) -> Vec<f32> {
    let (footprints, bands) = sort(splats, options);
    let mut image = vec![0.0; options.height * options.width * N_CHANNELS];
    image
        .par_chunks_mut(TILE * options.width * N_CHANNELS)
        .enumerate()
        .for_each(|(index, pixels)| {
            let mut band = Band::new(splats, &footprints, bands.ids(index), index, options);
            pulp::Arch::new().dispatch(BlendBand {
                band: &mut band,
                pixels,
                options,
                save: false,
            });
        });
    image
}

/// The image, and what [`rasterize_vjp`] needs.
pub fn rasterize_saving(splats: &[f32], options: &RasterizeOptions) -> (Vec<f32>, Saved) {
    let (footprints, bands) = sort(splats, options);
    let mut image = vec![0.0; options.height * options.width * N_CHANNELS];
    let blended = image
        .par_chunks_mut(TILE * options.width * N_CHANNELS)
        .enumerate()
        .map(|(index, pixels)| {
            let mut band = Band::new(splats, &footprints, bands.ids(index), index, options);
            pulp::Arch::new().dispatch(BlendBand {
                band: &mut band,
                pixels,
                options,
                save: true,
            });
            band
        })
        .collect();
    let saved = Pass {
        n_splats: footprints.len(),
        options: *options,
        bands,
        blended,
    };
    (image, Saved(Arc::new(saved)))
}

/// Gradient of the splats `[N, C]` from `v_image [H, W, 5]`.
///
/// A row whose gradient is not finite becomes zero.
pub fn rasterize_vjp(saved: &Saved, v_image: &[f32]) -> Vec<f32> {
    let pass = &*saved.0;
    let by_band: Vec<Vec<SplatGradient>> = pass
        .blended
        .par_iter()
        .zip(v_image.par_chunks(TILE * pass.options.width * N_CHANNELS))
        .map(|(band, v_pixels)| {
            pulp::Arch::new().dispatch(BlendBandVjp {
                band,
                v_pixels,
                options: &pass.options,
            })
        })
        .collect();
    let (starts, parts) = parts_by_splat(&pass.bands, pass.n_splats);
    let mut v_splats = vec![0.0; pass.n_splats * N_COLUMNS];
    v_splats
        .par_chunks_mut(PIECE * N_COLUMNS)
        .enumerate()
        .for_each(|(piece, rows)| {
            let (rows, _) = rows.as_chunks_mut::<N_COLUMNS>();
            for (k, v_row) in rows.iter_mut().enumerate() {
                let id = piece * PIECE + k;
                let own_parts = &parts[starts[id] as usize..starts[id + 1] as usize];
                let mut sum = [0.0; N_DIFFERENTIABLE];
                for &(band, index) in own_parts {
                    let part = &by_band[band as usize][index as usize];
                    for (sum, value) in sum.iter_mut().zip(part) {
                        *sum += value;
                    }
                }
                // Without a branch per value.
                if sum.iter().fold(true, |all, &value| all & is_finite(value)) {
                    v_row[..N_DIFFERENTIABLE].copy_from_slice(&sum);
                }
            }
        });
    let bands = pass.blended.iter().enumerate();
    let mut needles: Vec<u32> = bands
        .flat_map(|(index, band)| band.needle_ids(pass.bands.ids(index)))
        .collect();
    needles.sort_unstable();
    needles.dedup();
    for id in needles {
        let v_row = &mut v_splats[id as usize * N_COLUMNS..][..N_COLUMNS];
        v_row.copy_within(splats::CONIC_A..=splats::CONIC_C, splats::ACROSS_X);
        v_row[splats::CONIC_A..=splats::CONIC_C].fill(0.0);
    }
    v_splats
}

fn sort(splats: &[f32], options: &RasterizeOptions) -> (Vec<Footprint>, Bands) {
    let footprints: Vec<Footprint> = splats
        .par_chunks_exact(N_COLUMNS)
        .with_min_len(PIECE)
        .map(|row| Footprint::new(row, options.width, options.height))
        .collect();
    let order = depth_order(&footprints);
    let bands = Bands::new(&order, &footprints, options.height.div_ceil(TILE));
    (footprints, bands)
}

/// For every splat its bands from top to bottom and its index in them, as one list and where each
/// splat's part starts.
fn parts_by_splat(bands: &Bands, n_splats: usize) -> (Vec<u32>, Vec<(u32, u32)>) {
    let mut starts = vec![0u32; n_splats + 1];
    for &id in &bands.ids {
        starts[id as usize + 1] += 1;
    }
    for id in 0..n_splats {
        starts[id + 1] += starts[id];
    }
    let mut ends = starts.clone();
    let mut parts = vec![(0, 0); bands.ids.len()];
    for band in 0..bands.len() {
        for (index, &id) in (0u32..).zip(bands.ids(band)) {
            let end = &mut ends[id as usize];
            parts[*end as usize] = (band as u32, index);
            *end += 1;
        }
    }
    (starts, parts)
}
