//! Comparison of kernels with references.

use super::to_f64;

/// Largest 99th percentile of the relative error of an `f32` kernel against the `f64` reference.
pub const P99: f64 = 1e-3;

/// Central differences of a smooth f64 function with a step of 1e-6 to 1e-5 are this good.
pub const DIFFERENCES_RELATIVE: f64 = 1e-6;

/// Smallest cosine between a kernel's values and the reference's.
pub const COSINE: f64 = 0.999_99;

/// Largest norm of the difference from the reference, as a share of the reference's norm.
pub const RELATIVE_L2: f64 = 1e-3;

/// Fails unless every value is finite.
#[track_caller]
pub fn assert_finite(name: &str, got: &[f32]) {
    if let Some(index) = got.iter().position(|value| !value.is_finite()) {
        panic!("{name}[{index}] is {}", got[index]);
    }
}

/// Fails unless every value is within `absolute + relative * |expected|` of its expectation.
#[track_caller]
pub fn assert_close(name: &str, got: &[f64], expected: &[f64], absolute: f64, relative: f64) {
    assert_eq!(got.len(), expected.len(), "{name}: lengths differ");
    for (index, (&got, &expected)) in got.iter().zip(expected).enumerate() {
        let tolerance = absolute + relative * expected.abs();
        // In the positive form, so that NaN fails.
        let close = expected.is_finite() && (got - expected).abs() <= tolerance;
        assert!(
            close,
            "{name}[{index}]: got {got}, expected {expected} within {tolerance}"
        );
    }
}

/// The scalar product.
pub fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// The cosine of the angle between two vectors; 1 when both are zero.
pub fn cosine(a: &[f64], b: &[f64]) -> f64 {
    let norms = (dot(a, a) * dot(b, b)).sqrt();
    if norms == 0.0 {
        return f64::from(u8::from(dot(a, a) == dot(b, b)));
    }
    dot(a, b) / norms
}

/// The norm of the difference over the expectation's.
pub fn relative_l2(got: &[f64], expected: &[f64]) -> f64 {
    let square = |v: f64| v * v;
    let off: f64 = got.iter().zip(expected).map(|(g, e)| square(g - e)).sum();
    let norm: f64 = expected.iter().copied().map(square).sum();
    (off / norm.max(f64::MIN_POSITIVE)).sqrt()
}

/// The 99th percentile of `|got - expected| / max(|expected|, floor)`, where `floor` is a thousandth
/// of the expectation's root mean square: relative errors of values next to zero say nothing.
pub fn p99(got: &[f64], expected: &[f64]) -> f64 {
    let mean_square = dot(expected, expected) / expected.len().max(1) as f64;
    let floor = (1e-3 * mean_square.sqrt()).max(f64::MIN_POSITIVE);
    let mut errors: Vec<f64> = got
        .iter()
        .zip(expected)
        .map(|(got, expected)| (got - expected).abs() / expected.abs().max(floor))
        .collect();
    errors.sort_by(f64::total_cmp);
    errors.get(errors.len() * 99 / 100).copied().unwrap_or(0.0)
}

/// What is wrong with `got`, where it misses the reference: a value that is not finite, the 99th percentile of the
/// relative error, the cosine, or the norm of the difference.
pub fn disagreement(got: &[f32], expected: &[f64]) -> Option<String> {
    if got.len() != expected.len() {
        return Some(format!("{} values, expected {}", got.len(), expected.len()));
    }
    if let Some(index) = got.iter().position(|value| !value.is_finite()) {
        return Some(format!("[{index}] is {}", got[index]));
    }
    let got = to_f64(got);
    let (p99, cosine) = (p99(&got, expected), cosine(&got, expected));
    let off = relative_l2(&got, expected);
    if p99 <= P99 && cosine >= COSINE && off <= RELATIVE_L2 {
        return None;
    }
    let error = |&index: &usize| (got[index] - expected[index]).abs();
    let worst = (0..got.len()).max_by(|a, b| error(a).total_cmp(&error(b)));
    let worst = worst.map(|i| format!("[{i}]: got {}, expected {}", got[i], expected[i]));
    Some(format!(
        "p99 {p99:e}, cosine {cosine}, relative L2 {off:e}; largest difference at {worst:?}"
    ))
}

/// Fails unless `got` agrees with the reference; see [`disagreement`].
#[track_caller]
pub fn assert_agrees(name: &str, got: &[f32], expected: &[f64]) {
    if let Some(what) = disagreement(got, expected) {
        panic!("{name}: {what}");
    }
}

/// Bit patterns, whose equality tells NaN and the zeros apart.
pub fn bits(values: &[f32]) -> Vec<u32> {
    values.iter().map(|value| value.to_bits()).collect()
}

/// Runs `work` in a pool of `n` threads.
pub fn with_threads<R: Send>(n: usize, work: impl FnOnce() -> R + Send) -> R {
    rayon::ThreadPoolBuilder::new()
        .num_threads(n)
        .build()
        .expect("the machine can start a few threads")
        .install(work)
}

/// Runs `work` on pools of 1, 2 and 8 threads and fails unless the results have the same bits.
#[track_caller]
pub fn assert_same_for_any_thread_count(name: &str, work: impl Fn() -> Vec<f32> + Sync) {
    let on = |threads: usize| bits(&with_threads(threads, &work));
    let expected = on(1);
    for threads in [2, 8] {
        let got = on(threads);
        let differing = got.iter().zip(&expected).position(|(a, b)| a != b);
        assert!(
            got.len() == expected.len() && differing.is_none(),
            "{name}: {threads} threads differ from 1 at {differing:?}"
        );
    }
}

/// Gradient of `loss` at `at` by central differences.
pub fn central_differences(at: &[f64], step: f64, mut loss: impl FnMut(&[f64]) -> f64) -> Vec<f64> {
    let mut moved = at.to_vec();
    (0..at.len())
        .map(|i| {
            let mut side = |sign: f64| {
                moved[i] = at[i] + sign * step;
                loss(&moved)
            };
            let slope = (side(1.0) - side(-1.0)) / (2.0 * step);
            moved[i] = at[i];
            slope
        })
        .collect()
}

#[test]
fn a_wrong_result_is_noticed() {
    let expected: Vec<f64> = (0..200).map(|i| f64::from(i) - 77.0).collect();
    let right: Vec<f32> = expected.iter().map(|&v| v as f32).collect();
    assert_eq!(disagreement(&right, &expected), None);
    let off: Vec<f32> = right.iter().map(|v| v * 1.002).collect();
    assert!(disagreement(&off, &expected).is_some());
    let mut poisoned = right.clone();
    poisoned[3] = f32::NAN;
    assert!(disagreement(&poisoned, &expected).is_some());
    assert!(disagreement(&right[1..], &expected).is_some());
    assert!(disagreement(&vec![0.0; 200], &expected).is_some());
}
