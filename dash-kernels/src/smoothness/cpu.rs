//! Smoothness on the CPU: few rows, one after the other; distances are added up in f64.

/// The cost. See [`smoothness`](super::smoothness).
pub fn smoothness(features: &[f32], width: usize, n: usize, rows: &[u32]) -> f32 {
    let mut sum = 0.0;
    for (&row, beside) in rows.iter().zip(features[n * width..].chunks_exact(width)) {
        let own = &features[row as usize * width..][..width];
        for (a, b) in own.iter().zip(beside) {
            sum += (f64::from(*a) - f64::from(*b)).powi(2);
        }
    }
    (sum / rows.len() as f64) as f32
}

/// The gradient of the features, from those of the points' and of further rows' features, and of the cost.
pub fn smoothness_vjp(
    features: &[f32],
    width: usize,
    [v_own, v_others]: [Option<&[f32]>; 2],
    v_cost: f32,
    n: usize,
    rows: &[u32],
) -> Vec<f32> {
    let mut v_features = vec![0.0; features.len()];
    if let Some(v_own) = v_own {
        v_features[..n * width].copy_from_slice(v_own);
    }
    if let Some(v_others) = v_others {
        v_features[(n + rows.len()) * width..].copy_from_slice(v_others);
    }
    let factor = 2.0 * v_cost / rows.len() as f32;
    for (k, &row) in rows.iter().enumerate() {
        let (own, beside) = (row as usize * width, (n + k) * width);
        for column in 0..width {
            let v = factor * (features[own + column] - features[beside + column]);
            v_features[own + column] += v;
            v_features[beside + column] = -v;
        }
    }
    v_features
}
