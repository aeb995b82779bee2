//! What the tests of the operations share.

use burn::tensor::{Device, Tensor, TensorData};
use rand::{Rng, SeedableRng};
use rand_pcg::Pcg64;

/// Largest 99th percentile of the relative error of an `f32` kernel against the `f64` reference.
pub const P99: f64 = 1e-3;

/// Smallest cosine between a kernel's gradient and the reference's.
pub const COSINE: f64 = 0.999_99;

/// Largest norm of what differs from the reference, as a share of the reference's norm.
pub const RELATIVE_L2: f64 = 1e-3;

/// The devices of the enabled backends.
pub fn devices() -> Vec<Device> {
    vec![
        #[cfg(feature = "ndarray")]
        Device::ndarray(),
        #[cfg(feature = "flex")]
        Device::flex(),
        #[cfg(feature = "wgpu")]
        Device::wgpu(burn::tensor::DeviceKind::DefaultDevice),
        #[cfg(feature = "cuda")]
        Device::cuda(0),
    ]
}

/// A random generator with a fixed seed.
pub fn rng(seed: u64) -> Pcg64 {
    Pcg64::seed_from_u64(seed)
}

/// Values of a standard normal distribution.
pub fn normals(rng: &mut Pcg64, n: usize) -> Vec<f64> {
    (0..n)
        .map(|_| {
            // Box-Muller; 1 - u keeps the logarithm finite.
            let radius = (-2.0 * (1.0 - rng.random::<f64>()).ln()).sqrt();
            radius * (rng.random::<f64>() * std::f64::consts::TAU).cos()
        })
        .collect()
}

/// The same values in the precision of the kernels.
pub fn to_f32(values: &[f64]) -> Vec<f32> {
    values.iter().map(|&value| value as f32).collect()
}

/// The same values in the precision of the reference.
pub fn to_f64(values: &[f32]) -> Vec<f64> {
    values.iter().map(|&value| f64::from(value)).collect()
}

/// A tensor of `values`.
pub fn tensor<const R: usize>(values: &[f32], shape: [usize; R], device: &Device) -> Tensor<R> {
    Tensor::from_data(TensorData::new(values.to_vec(), shape), device)
}

/// A tensor's values.
pub fn values<const R: usize>(tensor: Tensor<R>) -> Vec<f32> {
    tensor
        .into_data()
        .to_vec()
        .expect("the tensors of these tests are f32")
}

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
        let close = (got - expected).abs() <= tolerance;
        assert!(
            close,
            "{name}[{index}]: got {got}, expected {expected} within {tolerance}"
        );
    }
}

/// The cosine of the angle between two vectors; 1 when both are zero.
pub fn cosine(a: &[f64], b: &[f64]) -> f64 {
    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
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

/// The 99th percentile of `|got - expected| / (|expected| + floor)`, where `floor` is a thousandth
/// of the expectation's root mean square: relative errors of values next to zero say nothing.
pub fn p99(got: &[f64], expected: &[f64]) -> f64 {
    let mean_square = expected.iter().map(|e| e * e).sum::<f64>() / expected.len().max(1) as f64;
    let floor = 1e-3 * mean_square.sqrt() + f64::MIN_POSITIVE;
    let mut errors: Vec<f64> = got
        .iter()
        .zip(expected)
        .map(|(got, expected)| (got - expected).abs() / (expected.abs() + floor))
        .collect();
    errors.sort_by(f64::total_cmp);
    errors.get(errors.len() * 99 / 100).copied().unwrap_or(0.0)
}

/// Fails unless `got` agrees with the reference as the house asks for: 99th percentile of the
/// relative error, cosine, and norm of the difference.
#[track_caller]
pub fn assert_agrees(name: &str, got: &[f32], expected: &[f64]) {
    assert_eq!(got.len(), expected.len(), "{name}: lengths differ");
    assert_finite(name, got);
    let got = to_f64(got);
    let (p99, cosine) = (p99(&got, expected), cosine(&got, expected));
    let off = relative_l2(&got, expected);
    let worst = (0..got.len())
        .max_by(|&a, &b| {
            let error = |i: usize| (got[i] - expected[i]).abs();
            error(a).total_cmp(&error(b))
        })
        .map(|i| format!("[{i}]: got {}, expected {}", got[i], expected[i]));
    assert!(
        p99 <= P99 && cosine >= COSINE && off <= RELATIVE_L2,
        "{name}: p99 {p99:e}, cosine {cosine}, relative L2 {off:e}; largest difference at {worst:?}"
    );
}

/// Runs `work` on pools of 1, 2 and 8 threads and fails unless the results have the same bits.
#[track_caller]
pub fn assert_same_for_any_thread_count(name: &str, work: impl Fn() -> Vec<f32> + Sync) {
    let on = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .expect("the machine can start a few threads");
        let bits: Vec<u32> = pool.install(&work).iter().map(|v| v.to_bits()).collect();
        bits
    };
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
pub fn central_differences(at: &[f64], step: f64, loss: impl Fn(&[f64]) -> f64) -> Vec<f64> {
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

/// Values that kernels have got wrong elsewhere: not numbers, infinite, denormal, huge, and one
/// step beside the thresholds of drawing.
pub fn poison() -> [f32; 22] {
    let alpha_min = crate::splats::ALPHA_MIN as f32;
    let near = crate::splats::NEAR_PLANE as f32;
    [
        f32::NAN,
        -f32::NAN,
        f32::INFINITY,
        f32::NEG_INFINITY,
        0.0,
        -0.0,
        f32::from_bits(1),
        -f32::from_bits(1),
        f32::MIN_POSITIVE,
        -f32::MIN_POSITIVE,
        f32::MAX,
        f32::MIN,
        1e30,
        -1e30,
        alpha_min.next_down(),
        alpha_min.next_up(),
        near.next_down(),
        near.next_up(),
        1f32.next_down(),
        1f32.next_up(),
        -1.0,
        88.8,
    ]
}
