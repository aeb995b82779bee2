//! Rows in f64, straight from their definition.

/// `values [N, width] -> [M, width]`.
pub fn take_rows(values: &[f64], width: usize, rows: &[u32]) -> Vec<f64> {
    let row = |&row: &u32| (0..width).map(move |column| values[row as usize * width + column]);
    rows.iter().flat_map(row).collect()
}

/// `v_out [M, width] -> [N, width]`, where `n` is `N`: what each row took part in, added up.
pub fn take_rows_vjp(v_out: &[f64], n: usize, width: usize, rows: &[u32]) -> Vec<f64> {
    let mut gradient = vec![0.0; n * width];
    for (place, &row) in rows.iter().enumerate() {
        for column in 0..width {
            gradient[row as usize * width + column] += v_out[place * width + column];
        }
    }
    gradient
}

/// `first [N, width]`, `second [M, width] -> [N + M, width]`.
pub fn join_rows(first: &[f64], second: &[f64]) -> Vec<f64> {
    [first, second].concat()
}

/// Gradients of the first, of `n_first` values, and of the second.
pub fn join_rows_vjp(v_out: &[f64], n_first: usize) -> [Vec<f64>; 2] {
    [v_out[..n_first].to_vec(), v_out[n_first..].to_vec()]
}
