//! What the tests of operations share, here and in the crates that build on this one.

mod compare;

use burn::tensor::{Device, Tensor, TensorData};
use rand::{Rng, SeedableRng};
use rand_pcg::Pcg64;

pub use compare::{
    COSINE, DIFFERENCES_RELATIVE, P99, RELATIVE_L2, assert_agrees, assert_close, assert_finite,
    assert_same_for_any_thread_count, bits, central_differences, cosine, disagreement, dot, p99,
    relative_l2, with_threads,
};

/// The devices of the enabled backends by name.
///
/// # Panics
/// When no backend is enabled, or a GPU that was asked for is missing.
pub fn named_devices() -> Vec<(&'static str, Device)> {
    let devices = Vec::from([
        #[cfg(feature = "ndarray")]
        ("ndarray", Device::ndarray()),
        #[cfg(feature = "flex")]
        ("flex", Device::flex()),
        #[cfg(feature = "wgpu")]
        (
            "wgpu",
            Device::wgpu(burn::tensor::DeviceKind::DefaultDevice),
        ),
        #[cfg(feature = "cuda")]
        ("cuda", Device::cuda(0)),
    ]);
    assert!(!devices.is_empty(), "tests need a backend feature");
    devices
}

/// The devices of the enabled backends.
///
/// # Panics
/// As [`named_devices`].
pub fn devices() -> Vec<Device> {
    let devices = named_devices().into_iter();
    devices.map(|(_, device)| device).collect()
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

/// Values of a standard normal distribution, by seed, in the precision of the kernels.
pub fn random(seed: u64, n: usize) -> Vec<f32> {
    to_f32(&normals(&mut rng(seed), n))
}

/// Values between `low` and `high`.
pub fn uniform(rng: &mut Pcg64, n: usize, low: f32, high: f32) -> Vec<f32> {
    (0..n).map(|_| rng.random_range(low..high)).collect()
}

/// One column of rows `[N, n_columns]`.
pub fn column(values: &[f64], column: usize, n_columns: usize) -> Vec<f64> {
    values
        .iter()
        .skip(column)
        .step_by(n_columns)
        .copied()
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
    tensor.into_data().try_into_vec().expect("an f32 tensor")
}

/// A tensor's values, all of them finite.
#[track_caller]
pub fn finite_values<const R: usize>(tensor: Tensor<R>) -> Vec<f32> {
    let values = values(tensor);
    assert_finite("values", &values);
    values
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
