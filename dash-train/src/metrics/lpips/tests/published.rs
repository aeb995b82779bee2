//! The values of the published implementation, by `tests/published_lpips.py`: PyPI's lpips 0.1.4.

use std::path::PathBuf;

use dash_kernels::testing::named_devices;

use super::super::{Lpips, Network};
use super::{generated, picture};

/// Largest relative error: sums of some thousand products in f32 against f64.
const TOLERANCE: f64 = 1e-4;

type Expected = (Network, [usize; 2], f64);

/// With [`generated`] weights.
const GENERATED: [Expected; 3] = [
    (Network::AlexNet, [67, 75], 0.5606657),
    (Network::AlexNet, [64, 33], 0.5294571),
    (Network::Vgg16, [64, 33], 0.4582178),
];

/// With the published weights.
const PUBLISHED: [Expected; 4] = [
    (Network::AlexNet, [67, 75], 0.0988005),
    (Network::AlexNet, [64, 33], 0.0636473),
    (Network::Vgg16, [67, 75], 0.2960835),
    (Network::Vgg16, [64, 33], 0.2996605),
];

fn assert_is(lpips: &Lpips, [width, height]: [usize; 2], expected: f64, case: &str) {
    let (a, b) = (picture(1, width, height), picture(2, width, height));
    let got = lpips.distance(&a, &b, width, height).expect("large enough");
    let error = (got - expected).abs() / expected;
    assert!(
        error <= TOLERANCE,
        "{case}: got {got}, the published implementation has {expected}"
    );
}

#[test]
fn the_distance_is_the_published_implementations() {
    for (network, size, expected) in GENERATED {
        for (name, device) in named_devices() {
            let lpips = Lpips::new(network, generated(network, 3), &device);
            assert_is(&lpips, size, expected, &format!("{network}, {name}"));
        }
    }
}

/// `DASH_TEST_LPIPS` names a folder with the files that `dash eval` takes; they are not ours to ship.
#[test]
fn with_the_published_weights_it_is_too() {
    let Some(folder) = std::env::var_os("DASH_TEST_LPIPS").map(PathBuf::from) else {
        return;
    };
    for (network, size, expected) in PUBLISHED {
        let file = match network {
            Network::AlexNet => "lpips_alexnet.safetensors",
            Network::Vgg16 => "lpips_vgg16.safetensors",
        };
        for (name, device) in named_devices() {
            let lpips = Lpips::load(network, &[folder.join(file)], &device).expect("is there");
            assert_is(&lpips, size, expected, &format!("{network}, {name}"));
        }
    }
}
