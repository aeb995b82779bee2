//! Exposure on the CPU. Sums over pieces of rows are added in their order, so any number of threads gives the same bits.

use rayon::prelude::*;

use super::{CHANNELS, RESPONSE};
use crate::splats::{N_COLUMNS, RED};

/// Splats of a parallel piece.
const PIECE: usize = 4096;

/// In place. See [`expose`](super::expose).
pub fn expose(splats: &mut [f32], response: &[f32]) {
    let (gains, offsets) = response.split_at(CHANNELS);
    let (splats, _) = splats.as_chunks_mut::<N_COLUMNS>();
    let rows = splats.par_iter_mut().with_min_len(PIECE);
    rows.for_each(|row| {
        for channel in 0..CHANNELS {
            row[RED + channel] = row[RED + channel] * (1.0 + gains[channel]) + offsets[channel];
        }
    });
}

/// Gradients of splats `[N, C]` and response.
pub fn expose_vjp(splats: &[f32], response: &[f32], v_out: &[f32]) -> (Vec<f32>, [f32; RESPONSE]) {
    let mut v_splats = v_out.to_vec();
    let pieces: Vec<[f64; RESPONSE]> = v_splats
        .par_chunks_mut(PIECE * N_COLUMNS)
        .zip(splats.par_chunks(PIECE * N_COLUMNS))
        .map(|(v_splats, splats)| {
            let (splats, _) = splats.as_chunks::<N_COLUMNS>();
            let (v_splats, _) = v_splats.as_chunks_mut::<N_COLUMNS>();
            let mut sums = [0.0; RESPONSE];
            for (v_row, row) in v_splats.iter_mut().zip(splats) {
                for channel in 0..CHANNELS {
                    let v = v_row[RED + channel];
                    let (v_gain, v_offset) = (f64::from(v) * f64::from(row[RED + channel]), v);
                    if v_gain.is_finite() {
                        sums[channel] += v_gain;
                        sums[CHANNELS + channel] += f64::from(v_offset);
                    }
                    v_row[RED + channel] = v * (1.0 + response[channel]);
                }
            }
            sums
        })
        .collect();
    let v_response = std::array::from_fn(|k| pieces.iter().map(|sums| sums[k]).sum::<f64>() as f32);
    (v_splats, v_response)
}
