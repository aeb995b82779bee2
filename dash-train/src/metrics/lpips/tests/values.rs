//! The distance: by hand, against the reference, and its properties.

use std::collections::BTreeMap;

use burn::tensor::Device;
use dash_kernels::testing::named_devices;
use dash_model::parameters::HostTensor;

use super::super::{Lpips, Network, reference};
use super::{generated, picture};
use crate::Error;

/// Largest relative error of the distance on a backend: sums of some thousand products in f32.
const TOLERANCE: f64 = 1e-4;

#[track_caller]
fn assert_close(got: f64, expected: f64, tolerance: f64, case: &str) {
    let error = (got - expected).abs() / expected.abs();
    assert!(
        error <= tolerance,
        "{case}: got {got}, expected {expected}, relative error {error:e}"
    );
}

fn agrees_with_the_reference(network: Network, sizes: &[[usize; 2]]) {
    let weights = generated(network, 3);
    for &[width, height] in sizes {
        let (a, b) = (picture(1, width, height), picture(2, width, height));
        let expected = reference::lpips(network, &weights, [&a, &b], [height, width]);
        assert!(
            expected > 0.01,
            "{network}: too little to compare: {expected}"
        );
        for (name, device) in named_devices() {
            let lpips = Lpips::new(network, weights.clone(), &device);
            let got = lpips.distance(&a, &b, width, height).expect("large enough");
            let case = format!("{network} at {width}x{height} on {name}");
            assert_close(got, expected, TOLERANCE, &case);
        }
    }
}

#[test]
fn alexnet_on_every_backend_is_the_reference() {
    agrees_with_the_reference(Network::AlexNet, &[[67, 75], [31, 31], [64, 33]]);
}

#[test]
fn vgg16_on_every_backend_is_the_reference() {
    agrees_with_the_reference(Network::Vgg16, &[[37, 35], [16, 17]]);
}

#[test]
fn what_is_compared_tells_weights_apart() {
    let (width, height) = (33, 31);
    let (a, b) = (picture(1, width, height), picture(2, width, height));
    let distance = |seed| {
        let weights = generated(Network::AlexNet, seed);
        reference::lpips(Network::AlexNet, &weights, [&a, &b], [height, width])
    };
    let (one, other) = (distance(3), distance(4));
    let change = (one - other).abs() / one;
    assert!(change > 10.0 * TOLERANCE, "{one} and {other}");
}

/// AlexNet with weights of 0 but for these, by tensor and index.
fn alexnet_with(weights: &[(&str, &[usize], f32)]) -> BTreeMap<String, HostTensor> {
    let zeros = Network::AlexNet.expected_tensors().into_iter();
    let mut tensors: BTreeMap<String, HostTensor> = zeros
        .map(|expected| {
            let values = vec![0.0; expected.shape.iter().product()];
            let shape = expected.shape;
            (expected.name, HostTensor { shape, values })
        })
        .collect();
    for (name, index, value) in weights {
        let tensor = tensors.get_mut(*name).expect("one of the network's");
        let flat = index
            .iter()
            .zip(&tensor.shape)
            .fold(0, |flat, (i, side)| flat * side + i);
        tensor.values[flat] = *value;
    }
    tensors
}

/// The first layer gives red at every fourth pixel, scaled, and a constant 1; the second what the
/// pooling leaves of that red; the others nothing.
fn red_network() -> BTreeMap<String, HostTensor> {
    alexnet_with(&[
        // The tap at 2 of a kernel with 2 pixels of padding is on the picture.
        ("features.0.weight", &[0, 0, 2, 2], 1.0),
        ("features.0.bias", &[1], 1.0),
        ("features.3.weight", &[7, 0, 2, 2], 1.0),
        ("lin0.model.1.weight", &[0, 0, 0, 0], 2.0),
        ("lin0.model.1.weight", &[0, 1, 0, 0], 5.0),
        ("lin1.model.1.weight", &[0, 7, 0, 0], 3.0),
    ])
}

/// Red that is scaled to less than 0, of which the ReLU leaves 0.
const RED_OF_0: f32 = 0.3;
/// Red that is scaled to 3/4: (2 v - 1 + 0.030) / 0.458.
const RED_OF_3_4: f32 = 0.65675;

#[test]
fn a_distance_worked_out_by_hand() {
    let side = 31;
    let plain: Vec<f32> = [RED_OF_0, 0.3, 0.9].repeat(side * side);
    let redder: Vec<f32> = [RED_OF_3_4, 0.3, 0.9].repeat(side * side);
    let mut one_pixel = plain.clone();
    one_pixel[0] = RED_OF_3_4;
    for (name, device) in named_devices() {
        let lpips = Lpips::new(Network::AlexNet, red_network(), &device);
        let distance = |other: &[f32]| {
            lpips
                .distance(&plain, other, side, side)
                .expect("large enough")
        };
        // First layer: (0, 1) against (3/4, 1) / (5/4), 2 * 0.6^2 + 5 * 0.2^2 = 0.92. Second layer:
        // nothing, which has no direction, against 3/4, which becomes 1: 3 * 1^2.
        assert_close(distance(&redder), 0.92 + 3.0, 1e-5, name);
        // Only the first of 7x7 pixels, and after pooling of 3x3.
        assert_close(distance(&one_pixel), 0.92 / 49.0 + 3.0 / 9.0, 1e-5, name);
    }
}

#[test]
fn the_same_picture_has_no_distance_and_the_order_does_not_matter() {
    let (width, height) = (35, 33);
    let (a, b) = (picture(4, width, height), picture(5, width, height));
    for network in [Network::AlexNet, Network::Vgg16] {
        let lpips = Lpips::new(network, generated(network, 8), &Device::flex());
        let distance = |a, b| lpips.distance(a, b, width, height).expect("large enough");
        assert_eq!(distance(&a, &a), 0.0);
        assert_eq!(distance(&a, &b), distance(&b, &a));
        assert!(distance(&a, &b) > 0.0);
        let mut nan = a.clone();
        nan[0] = f32::NAN;
        assert!(
            distance(&nan, &b).is_nan(),
            "{network}: a NaN must not look good"
        );
    }
}

#[test]
fn pictures_that_are_too_small_are_refused() {
    for network in [Network::AlexNet, Network::Vgg16] {
        let lpips = Lpips::new(network, generated(network, 0), &Device::flex());
        let min = network.min_side_px();
        for (width, height) in [(min - 1, min), (min, min - 1), (0, 0)] {
            let a = vec![0.5; width * height * 3];
            let refused = lpips.distance(&a, &a, width, height);
            assert!(
                matches!(refused, Err(Error::PictureTooSmall { .. })),
                "{network} at {width}x{height}"
            );
        }
        let a = vec![0.5; min * min * 3];
        let least = lpips.distance(&a, &a, min, min);
        assert_eq!(least.expect("just large enough"), 0.0);
    }
}
