//! Extents of trajectories in f64, straight from their definition.

/// Shares of the spans that lie between the anchor and a time, negative where that is earlier.
fn shares(n_spans: usize, anchor: f64, time: f64) -> Vec<f64> {
    let way = |time: f64, k: usize| (time * n_spans as f64 - k as f64).clamp(0.0, 1.0);
    (0..n_spans)
        .map(|k| way(time, k) - way(anchor, k))
        .collect()
}

/// The knots' times.
fn knots(n_spans: usize) -> impl Iterator<Item = f64> {
    (0..=n_spans).map(move |knot| knot as f64 / n_spans as f64)
}

/// One over what a steady motion of length one gives.
fn inverse_steady(n_spans: usize, anchor: f64) -> f64 {
    1.0 / knots(n_spans)
        .map(|time| (time - anchor).powi(2))
        .sum::<f64>()
}

/// `coefficients [N, B * 3] -> [N]`.
pub fn squared_extent(coefficients: &[f64], n_spans: usize, anchor: f64) -> Vec<f64> {
    let rows = coefficients.chunks_exact(3 * n_spans);
    rows.map(|row| {
        let mut sum = 0.0;
        for time in knots(n_spans) {
            let shares = shares(n_spans, anchor, time);
            for axis in 0..3 {
                let spans = row[axis..].iter().step_by(3);
                sum += spans
                    .zip(&shares)
                    .map(|(c, share)| c * share)
                    .sum::<f64>()
                    .powi(2);
            }
        }
        sum * inverse_steady(n_spans, anchor)
    })
    .collect()
}

/// `coefficients [N, B * 3], v_out [N] -> [N, B * 3]`.
pub fn squared_extent_vjp(
    coefficients: &[f64],
    v_out: &[f64],
    n_spans: usize,
    anchor: f64,
) -> Vec<f64> {
    let inverse_steady = inverse_steady(n_spans, anchor);
    let mut gradient = vec![0.0; coefficients.len()];
    let rows = coefficients.chunks_exact(3 * n_spans).zip(v_out);
    for ((row, v), gradient) in rows.zip(gradient.chunks_exact_mut(3 * n_spans)) {
        for time in knots(n_spans) {
            let shares = shares(n_spans, anchor, time);
            for axis in 0..3 {
                let spans = row[axis..].iter().step_by(3);
                let at: f64 = spans.zip(&shares).map(|(c, share)| c * share).sum();
                for (k, share) in shares.iter().enumerate() {
                    gradient[3 * k + axis] += 2.0 * v * at * share * inverse_steady;
                }
            }
        }
    }
    gradient
}
