//! The encoders in float64, from parameters by name.

use dash_kernels::hash_encode::{HashGridLayout, reference};

use super::{N, Values};
use crate::{DeformationConfig, HashEncoderConfig, Representation};

/// Features `[N, ..]` of points `[N, 4]`.
pub(super) fn features(
    config: &DeformationConfig,
    values: &Values,
    points: &[f64],
    embeddings: &[f64],
) -> Vec<f64> {
    let hashed = config.encoder.log2_hashmap_size;
    let of = |encoder: &HashEncoderConfig, axes: &[usize], log2: u32, table: &str| {
        grid_features(encoder, axes, log2, &values[table], points)
    };
    let grid = |axes: &[usize], log2: u32, table: &str| of(&config.encoder, axes, log2, table);
    let width = config.encoder.n_levels * config.encoder.n_features_per_level;
    match config.representation {
        Representation::Hash => grid(&[0, 1, 2, 3], hashed, "table"),
        Representation::HexPlane => {
            let pairs = [[0, 1], [0, 2], [1, 2], [0, 3], [1, 3], [2, 3]];
            let planes = pairs
                .iter()
                .enumerate()
                .map(|(k, pair)| grid(pair, 31, &format!("planes.{k}.table")));
            planes
                .reduce(|a, b| a.iter().zip(&b).map(|(a, b)| a * b).collect())
                .expect("six planes")
        }
        Representation::Grid4d => {
            let spatial = grid(&[0, 1, 2], hashed, "spatial.table");
            let with_time = config.temporal.as_ref().unwrap_or(&config.encoder);
            let (log2, of_time) = (
                with_time.log2_hashmap_size,
                with_time.n_levels * with_time.n_features_per_level,
            );
            let temporal: Vec<Vec<f64>> = [[0, 1, 3], [1, 2, 3], [0, 2, 3]]
                .iter()
                .enumerate()
                .map(|(k, axes)| of(with_time, axes, log2, &format!("temporal.{k}.table")))
                .collect();
            let joined: Vec<f64> = (0..N)
                .flat_map(|row| {
                    let grids = temporal.iter();
                    grids.flat_map(move |grid| &grid[row * of_time..(row + 1) * of_time])
                })
                .copied()
                .collect();
            let weights = layer(values, &spatial, width, "attention.layers.0");
            let weighted = layer(values, &joined, 3 * of_time, "decoder.layers.0");
            weights
                .iter()
                .zip(&weighted)
                .map(|(w, v)| (2.0 / (1.0 + (-w).exp()) - 1.0) * v.max(0.0))
                .collect()
        }
        Representation::Embedding => {
            let mut rows = Vec::new();
            for (row, point) in points.chunks_exact(4).enumerate() {
                rows.extend(&embeddings[row * width..(row + 1) * width]);
                for k in 0..2 {
                    let table = &values[&format!("times.{k}")];
                    rows.extend(interpolated(table, 8 * width, point[3]));
                }
            }
            rows
        }
    }
}

/// Features of a grid over some axes.
fn grid_features(
    encoder: &HashEncoderConfig,
    axes: &[usize],
    log2_hashmap_size: u32,
    table: &[f64],
    points: &[f64],
) -> Vec<f64> {
    let pick = |resolution: &[u32]| axes.iter().map(|&a| resolution[a]).collect();
    let over_axes = HashEncoderConfig {
        log2_hashmap_size,
        base_resolution: pick(&encoder.base_resolution),
        finest_resolution: pick(&encoder.finest_resolution),
        ..encoder.clone()
    };
    let layout = HashGridLayout::new(&over_axes.grid()).expect("valid");
    let chosen: Vec<f64> = points
        .chunks_exact(4)
        .flat_map(|p| axes.iter().map(|&a| p[a]))
        .collect();
    reference::hash_encode(&chosen, table, &layout)
}

/// Outputs of the linear layer `name` for rows of `width` inputs.
fn layer(values: &Values, input: &[f64], width: usize, name: &str) -> Vec<f64> {
    let weight = &values[&format!("{name}.weight")];
    let bias = &values[&format!("{name}.bias")];
    let outputs = bias.len();
    input
        .chunks_exact(width)
        .flat_map(|row| {
            (0..outputs).map(|o| {
                let sum: f64 = (0..width).map(|i| row[i] * weight[i * outputs + o]).sum();
                sum + bias[o]
            })
        })
        .collect()
}

/// A table's row at a time, between its vertices.
fn interpolated(table: &[f64], columns: usize, time: f64) -> Vec<f64> {
    let cells = table.len() / columns - 1;
    let place = time * cells as f64;
    let cell = (place.floor() as usize).min(cells - 1);
    let share = place - cell as f64;
    (0..columns)
        .map(|c| {
            (1.0 - share) * table[cell * columns + c] + share * table[(cell + 1) * columns + c]
        })
        .collect()
}
