//! LPIPS against f64 loops on every backend, by hand, and against the published architecture.

mod architecture;
mod values;

use std::collections::BTreeMap;

use dash_model::parameters::HostTensor;
use rand::{Rng, SeedableRng};
use rand_pcg::Pcg64;

use super::Network;

/// Weights with which features keep their size from layer to layer; those of the comparison are
/// positive, as the published ones are.
pub fn generated(network: Network, seed: u64) -> BTreeMap<String, HostTensor> {
    let mut rng = Pcg64::seed_from_u64(seed);
    let tensors = network.expected_tensors().into_iter().map(|expected| {
        let fan_in: usize = expected.shape[1..].iter().product();
        let bound = (6.0 / fan_in as f32).sqrt();
        let is_linear = expected.name.starts_with("lin");
        let values = (0..expected.shape.iter().product::<usize>())
            .map(|_| {
                let value: f32 = rng.random();
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
pub fn picture(seed: u64, width: usize, height: usize) -> Vec<f32> {
    let mut rng = Pcg64::seed_from_u64(seed);
    (0..width * height * 3)
        .map(|index| {
            let ramp = (index / 3 % width) as f32 / width as f32;
            0.6 * ramp + 0.4 * rng.random::<f32>()
        })
        .collect()
}
