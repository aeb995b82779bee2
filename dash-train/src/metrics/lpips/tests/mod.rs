//! LPIPS against f64 loops on every backend, by hand, and against the published architecture.

mod architecture;
mod published;
mod values;

use std::collections::BTreeMap;

use super::Network;
use dash_model::parameters::HostTensor;

/// Uniform in [0, 1), and the same in the script that runs the published implementation.
fn hashed(seed: usize, index: usize) -> f32 {
    let start = (index as u32).wrapping_mul(2_654_435_761);
    let mut x = start.wrapping_add((seed as u32).wrapping_mul(40_503));
    for (shift, factor) in [(16, 2_246_822_519), (13, 3_266_489_917)] {
        x = (x ^ (x >> shift)).wrapping_mul(factor);
    }
    x ^= x >> 16;
    (x >> 8) as f32 / (1 << 24) as f32
}

/// Weights with which features keep their size from layer to layer; those of the comparison are
/// positive, as the published ones are.
pub fn generated(network: Network, seed: usize) -> BTreeMap<String, HostTensor> {
    let tensors = network.expected_tensors().into_iter().enumerate();
    let tensors = tensors.map(|(at, expected)| {
        let fan_in: usize = expected.shape[1..].iter().product();
        let bound = (6.0 / fan_in as f32).sqrt();
        let is_linear = expected.name.starts_with("lin");
        let values = (0..expected.shape.iter().product())
            .map(|index| {
                let value = hashed(100 * seed + at, index);
                match (is_linear, expected.shape.len()) {
                    (true, _) => value,
                    (false, 1) => 0.1 * (value - 0.5),
                    (false, _) => bound * (2.0 * value - 1.0),
                }
            })
            .collect();
        let shape = expected.shape;
        (expected.name, HostTensor { shape, values })
    });
    tensors.collect()
}

/// A picture of noise over a ramp.
pub fn picture(seed: usize, width: usize, height: usize) -> Vec<f32> {
    (0..width * height * 3)
        .map(|index| {
            let ramp = (index / 3 % width) as f32 / width as f32;
            0.6 * ramp + 0.4 * hashed(seed, index)
        })
        .collect()
}
