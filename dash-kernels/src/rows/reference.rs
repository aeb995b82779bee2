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
