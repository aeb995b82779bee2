//! Random inputs with fixed seeds, and tensors of them.

use burn::tensor::{Device, Gradients, Tensor, TensorData};
use rand::{Rng, SeedableRng};
use rand_pcg::Pcg64;

pub(super) use crate::train::core::to_host;

/// A generator with a fixed seed.
pub(super) fn rng(seed: u64) -> Pcg64 {
    Pcg64::seed_from_u64(seed)
}

/// `n` values between two others.
pub(super) fn uniform(rng: &mut Pcg64, n: usize, low: f32, high: f32) -> Vec<f32> {
    (0..n).map(|_| rng.random_range(low..high)).collect()
}

/// The same values in the precision of the references.
pub(super) fn widen(values: &[f32]) -> Vec<f64> {
    values.iter().map(|&value| f64::from(value)).collect()
}

/// A tensor of `values` on a device.
pub(super) fn tensor<const R: usize>(
    values: &[f32],
    shape: [usize; R],
    device: &Device,
) -> Tensor<R> {
    Tensor::from_data(TensorData::new(values.to_vec(), shape), device)
}

/// A tensor whose gradient is asked for.
pub(super) fn tracked<const R: usize>(
    values: &[f32],
    shape: [usize; R],
    device: &Device,
) -> Tensor<R> {
    tensor(values, shape, &device.clone().autodiff()).require_grad()
}

/// The gradient of a tracked tensor; zeros where there is none.
pub(super) fn gradient<const R: usize>(tensor: &Tensor<R>, gradients: &Gradients) -> Vec<f32> {
    match tensor.grad(gradients) {
        Some(gradient) => to_host(gradient),
        None => vec![0.0; tensor.dims().iter().product()],
    }
}
