//! Exposure in f64, straight from its definition.

use super::{CHANNELS, RESPONSE};
use crate::splats::{N_COLUMNS, RED};

/// `splats [N, C] -> [N, C]`. See [`expose`](super::expose).
pub fn expose(splats: &[f64], response: &[f64]) -> Vec<f64> {
    let (gains, offsets) = response.split_at(CHANNELS);
    let mut out = splats.to_vec();
    for row in out.chunks_exact_mut(N_COLUMNS) {
        for channel in 0..CHANNELS {
            row[RED + channel] = row[RED + channel] * (1.0 + gains[channel]) + offsets[channel];
        }
    }
    out
}

/// Gradients of splats `[N, C]` and response `[2, 3]`.
pub fn expose_vjp(splats: &[f64], response: &[f64], v_out: &[f64]) -> (Vec<f64>, Vec<f64>) {
    let (mut v_splats, mut v_response) = (v_out.to_vec(), vec![0.0; RESPONSE]);
    for (row, v_row) in splats
        .chunks_exact(N_COLUMNS)
        .zip(v_splats.chunks_exact_mut(N_COLUMNS))
    {
        for channel in 0..CHANNELS {
            let v = v_row[RED + channel];
            v_response[channel] += v * row[RED + channel];
            v_response[CHANNELS + channel] += v;
            v_row[RED + channel] = v * (1.0 + response[channel]);
        }
    }
    (v_splats, v_response)
}
