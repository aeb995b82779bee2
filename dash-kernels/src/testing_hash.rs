//! What the tests of ssim, hash encoding and Adam share.

use burn::tensor::{Device, Tensor, TensorData};
use rand::{Rng, SeedableRng};
use rand_pcg::Pcg64;

/// 99 % of an f32 kernel's values lie within this of the f64 reference, relative to the larger of
/// the value itself and the values' root mean square times 1e-3.
pub const P99_RELATIVE: f64 = 1e-3;
/// Cosine between an f32 kernel's values and the f64 reference's.
pub const MIN_COSINE: f64 = 0.999_99;
/// Largest norm of what differs from the reference, as a share of the reference's norm.
pub const RELATIVE_L2: f64 = 1e-3;
/// Central differences of a smooth f64 function with a step of 1e-6 to 1e-5 are this good.
pub const DIFFERENCES_RELATIVE: f64 = 1e-6;

/// Every device that the enabled features bring.
pub fn devices() -> Vec<Device> {
    let devices = Vec::from([
        #[cfg(feature = "ndarray")]
        Device::ndarray(),
        #[cfg(feature = "flex")]
        Device::flex(),
        #[cfg(feature = "wgpu")]
        Device::wgpu(burn::tensor::DeviceKind::DefaultDevice),
        #[cfg(feature = "cuda")]
        Device::cuda(0),
    ]);
    assert!(!devices.is_empty(), "tests need a backend feature");
    devices
}

pub fn rng(seed: u64) -> Pcg64 {
    Pcg64::seed_from_u64(seed)
}

pub fn uniform(rng: &mut Pcg64, n: usize, low: f32, high: f32) -> Vec<f32> {
    (0..n).map(|_| rng.random_range(low..high)).collect()
}

pub fn tensor<const R: usize>(values: &[f32], shape: [usize; R], device: &Device) -> Tensor<R> {
    Tensor::from_data(TensorData::new(values.to_vec(), shape), device)
}

pub fn values<const R: usize>(tensor: Tensor<R>) -> Vec<f32> {
    tensor.into_data().into_vec().expect("an f32 tensor")
}

pub fn to_f64(values: &[f32]) -> Vec<f64> {
    values.iter().map(|&v| f64::from(v)).collect()
}

/// Runs `f` in a pool of `n` threads.
pub fn with_threads<R: Send>(n: usize, f: impl FnOnce() -> R + Send) -> R {
    rayon::ThreadPoolBuilder::new()
        .num_threads(n)
        .build()
        .expect("a thread pool")
        .install(f)
}

/// Bit patterns, so that equality means what it says.
pub fn bits(values: &[f32]) -> Vec<u32> {
    values.iter().map(|v| v.to_bits()).collect()
}

#[track_caller]
pub fn assert_close(got: &[f64], expected: &[f64], relative: f64, absolute: f64) {
    assert_eq!(got.len(), expected.len(), "lengths differ");
    for (i, (&g, &e)) in got.iter().zip(expected).enumerate() {
        assert!(
            g.is_finite() && e.is_finite(),
            "index {i}: got {g}, expected {e}"
        );
        let bound = relative * e.abs().max(g.abs()) + absolute;
        assert!(
            (g - e).abs() <= bound,
            "index {i}: got {g}, expected {e}, bound {bound:e}"
        );
    }
}

/// The worst index of the best 99 % and the cosine, as a sentence when they miss the tolerances.
pub fn disagreement(got: &[f32], expected: &[f64]) -> Option<String> {
    if got.len() != expected.len() {
        return Some(format!("{} values, expected {}", got.len(), expected.len()));
    }
    if let Some(i) = got.iter().position(|v| !v.is_finite()) {
        return Some(format!("index {i} is {}", got[i]));
    }
    let square = |v: f64| v * v;
    let n = expected.len().max(1) as f64;
    let rms = (expected.iter().copied().map(square).sum::<f64>() / n).sqrt();
    let mut errors: Vec<(f64, usize)> = got
        .iter()
        .zip(expected)
        .enumerate()
        .map(|(i, (&g, &e))| {
            let scale = e.abs().max(1e-3 * rms).max(f64::MIN_POSITIVE);
            ((f64::from(g) - e).abs() / scale, i)
        })
        .collect();
    errors.sort_by(|a, b| a.0.total_cmp(&b.0));
    let (error, i) = *errors.get((errors.len() * 99 / 100).min(errors.len().checked_sub(1)?))?;
    if error > P99_RELATIVE {
        return Some(format!(
            "99th percentile of relative errors is {error:e} (index {i}: got {}, expected {})",
            got[i], expected[i]
        ));
    }
    let dot: f64 = got
        .iter()
        .zip(expected)
        .map(|(&g, &e)| f64::from(g) * e)
        .sum();
    let norm: f64 = got
        .iter()
        .map(|&g| square(f64::from(g)))
        .sum::<f64>()
        .sqrt();
    let cosine = dot / (norm * rms * n.sqrt());
    // Two zero vectors agree.
    if norm + rms > 0.0 && (cosine.is_nan() || cosine < MIN_COSINE) {
        return Some(format!("cosine is {cosine}"));
    }
    let off = relative_l2(got, expected);
    (off > RELATIVE_L2).then(|| format!("relative L2 error is {off:e}"))
}

/// The norm of the difference over the expectation's.
pub fn relative_l2(got: &[f32], expected: &[f64]) -> f64 {
    let square = |v: f64| v * v;
    let pairs = got.iter().zip(expected);
    let off: f64 = pairs.map(|(&g, e)| square(f64::from(g) - e)).sum();
    let norm: f64 = expected.iter().copied().map(square).sum();
    (off / norm.max(f64::MIN_POSITIVE)).sqrt()
}

#[track_caller]
pub fn assert_agrees(got: &[f32], expected: &[f64]) {
    if let Some(what) = disagreement(got, expected) {
        panic!("{what}");
    }
}

/// The gradient of `f` at `x` by central differences.
pub fn central_differences(x: &[f64], step: f64, mut f: impl FnMut(&[f64]) -> f64) -> Vec<f64> {
    (0..x.len())
        .map(|i| {
            let mut moved = x.to_vec();
            moved[i] = x[i] + step;
            let above = f(&moved);
            moved[i] = x[i] - step;
            (above - f(&moved)) / (2.0 * step)
        })
        .collect()
}

pub fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
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
