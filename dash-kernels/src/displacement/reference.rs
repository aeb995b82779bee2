//! Displacements in f64, straight from their definition.

/// `coefficients [N, B * 3] -> [N, 3]`.
pub fn displacement(coefficients: &[f64], basis: &[f64]) -> Vec<f64> {
    let rows = coefficients.chunks_exact(3 * basis.len());
    rows.flat_map(|row| {
        [0, 1, 2].map(|axis| {
            let spans = row[axis..].iter().step_by(3);
            spans.zip(basis).map(|(c, value)| c * value).sum()
        })
    })
    .collect()
}

/// `v_out [N, 3] -> [N, B * 3]`.
pub fn displacement_vjp(v_out: &[f64], basis: &[f64]) -> Vec<f64> {
    let rows = v_out.chunks_exact(3);
    rows.flat_map(|v| {
        basis
            .iter()
            .flat_map(move |value| v.iter().map(move |v| v * value))
    })
    .collect()
}
