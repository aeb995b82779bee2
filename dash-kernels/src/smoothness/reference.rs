//! Smoothness in f64, straight from its definition.

/// The cost. See [`smoothness`](super::smoothness).
pub fn smoothness(features: &[f64], width: usize, n: usize, rows: &[u32]) -> f64 {
    let distance = |(k, &row): (usize, &u32)| {
        let columns = 0..width;
        let of = |row: usize, column: usize| features[row * width + column];
        let squares = columns.map(|c| (of(row as usize, c) - of(n + k, c)).powi(2));
        squares.sum::<f64>()
    };
    rows.iter().enumerate().map(distance).sum::<f64>() / rows.len() as f64
}
