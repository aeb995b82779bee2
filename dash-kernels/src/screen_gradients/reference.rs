//! Sums of screen-space gradients in f64, straight from their definition.

use crate::splats::{MEAN_X, MEAN_Y, N_COLUMNS, RADIUS_X};

/// The sums with a view added. See [`add_screen_gradients`](super::add_screen_gradients).
pub fn add_screen_gradients(
    sums: &[f64],
    v_splats: &[f64],
    splats: &[f64],
    half_size: [f64; 2],
) -> Vec<f64> {
    let rows = v_splats
        .chunks_exact(N_COLUMNS)
        .zip(splats.chunks_exact(N_COLUMNS));
    let rows = sums.chunks_exact(2).zip(rows);
    rows.flat_map(|(sums, (v, splat))| {
        let (x, y) = (v[MEAN_X] * half_size[0], v[MEAN_Y] * half_size[1]);
        let length = (x * x + y * y).sqrt();
        match splat[RADIUS_X] > 0.0 && length.is_finite() {
            true => [sums[0] + length, sums[1] + 1.0],
            false => [sums[0], sums[1]],
        }
    })
    .collect()
}
