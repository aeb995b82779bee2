//! Names, shapes and counts as published.

use super::super::{ExpectedTensor, Network};

/// torchvision's `vgg16().features` and LPIPS's `vgg.pth`.
const VGG16: [(&str, &[usize]); 18] = [
    ("features.0", &[64, 3, 3, 3]),
    ("features.2", &[64, 64, 3, 3]),
    ("features.5", &[128, 64, 3, 3]),
    ("features.7", &[128, 128, 3, 3]),
    ("features.10", &[256, 128, 3, 3]),
    ("features.12", &[256, 256, 3, 3]),
    ("features.14", &[256, 256, 3, 3]),
    ("features.17", &[512, 256, 3, 3]),
    ("features.19", &[512, 512, 3, 3]),
    ("features.21", &[512, 512, 3, 3]),
    ("features.24", &[512, 512, 3, 3]),
    ("features.26", &[512, 512, 3, 3]),
    ("features.28", &[512, 512, 3, 3]),
    ("lin0.model.1", &[1, 64, 1, 1]),
    ("lin1.model.1", &[1, 128, 1, 1]),
    ("lin2.model.1", &[1, 256, 1, 1]),
    ("lin3.model.1", &[1, 512, 1, 1]),
    ("lin4.model.1", &[1, 512, 1, 1]),
];

/// torchvision's `alexnet().features` and LPIPS's `alex.pth`.
const ALEXNET: [(&str, &[usize]); 10] = [
    ("features.0", &[64, 3, 11, 11]),
    ("features.3", &[192, 64, 5, 5]),
    ("features.6", &[384, 192, 3, 3]),
    ("features.8", &[256, 384, 3, 3]),
    ("features.10", &[256, 256, 3, 3]),
    ("lin0.model.1", &[1, 64, 1, 1]),
    ("lin1.model.1", &[1, 192, 1, 1]),
    ("lin2.model.1", &[1, 384, 1, 1]),
    ("lin3.model.1", &[1, 256, 1, 1]),
    ("lin4.model.1", &[1, 256, 1, 1]),
];

fn published(table: &[(&str, &[usize])]) -> Vec<ExpectedTensor> {
    let tensors = table.iter().flat_map(|(module, shape)| {
        let weight = ExpectedTensor {
            name: format!("{module}.weight"),
            shape: shape.to_vec(),
        };
        let bias = module.starts_with("features").then(|| ExpectedTensor {
            name: format!("{module}.bias"),
            shape: vec![shape[0]],
        });
        [Some(weight), bias].into_iter().flatten()
    });
    tensors.collect()
}

#[test]
fn the_tensors_are_those_of_the_published_networks() {
    assert_eq!(Network::Vgg16.expected_tensors(), published(&VGG16));
    assert_eq!(Network::AlexNet.expected_tensors(), published(&ALEXNET));
}

#[test]
fn the_counts_are_those_of_the_published_networks() {
    let count = |network: Network, prefix: &str| -> usize {
        let tensors = network.expected_tensors();
        let of_prefix = tensors.iter().filter(|t| t.name.starts_with(prefix));
        of_prefix.map(|t| t.shape.iter().product::<usize>()).sum()
    };
    assert_eq!(count(Network::Vgg16, "features."), 14_714_688);
    assert_eq!(count(Network::AlexNet, "features."), 2_469_696);
    assert_eq!(count(Network::Vgg16, "lin"), 1_472);
    assert_eq!(count(Network::AlexNet, "lin"), 1_152);
}

#[test]
fn the_smallest_pictures_leave_the_last_layer_one_pixel() {
    // Four poolings by 2. 31 -> 7 -> 3 -> 3 -> 1.
    assert_eq!(Network::Vgg16.min_side_px(), 16);
    assert_eq!(Network::AlexNet.min_side_px(), 31);
}
