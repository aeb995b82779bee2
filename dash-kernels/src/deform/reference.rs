//! Deformation in f64, straight from its definition.

use super::{Columns, MEAN, QUAT, SCALE};

/// Means, quaternions and scales of `[N, 3]`, `[N, 4]`, `[N, 3]` with `path [N, 3]` and `offsets [N, width]`.
/// See [`deform`](super::deform).
pub fn deform(
    [means, quats, scales]: [&[f64]; 3],
    path: &[f64],
    offsets: &[f64],
    width: usize,
    columns: Columns,
) -> [Vec<f64>; 3] {
    let n = means.len() / MEAN;
    let plus = |values: &[f64], size: usize, first: Option<usize>, factor: f64| -> Vec<f64> {
        let offset = |i: usize, k: usize| first.map_or(0.0, |first| offsets[i * width + first + k]);
        (0..n)
            .flat_map(|i| (0..size).map(move |k| (i, k)))
            .map(|(i, k)| values[i * size + k] + factor * offset(i, k))
            .collect()
    };
    let along: Vec<f64> = means.iter().zip(path).map(|(a, b)| a + b).collect();
    [
        plus(&along, MEAN, Some(0), f64::from(columns.mean_factor)),
        plus(quats, QUAT, columns.quats, 1.0),
        plus(scales, SCALE, columns.scales, 1.0),
    ]
}
