//! Hash encoders over several tables, and without some of their levels.

use burn::tensor::{Device, TensorData};
use dash_kernels::hash_encode::reference;
use dash_kernels::testing::named_devices;
use rand::{Rng, SeedableRng};
use rand_pcg::Pcg64;

use super::*;
use crate::parameters::named_parameters;

/// All but ndarray, whose tensors have no limit of their own and which is slow with these sizes.
fn devices() -> impl Iterator<Item = Device> {
    let devices = named_devices().into_iter();
    devices.filter_map(|(name, device)| (name != "ndarray").then_some(device))
}

/// 160 MiB of hashed levels, more than many devices bind at once.
fn large() -> HashEncoderConfig {
    HashEncoderConfig {
        n_levels: 20,
        n_features_per_level: 2,
        log2_hashmap_size: 20,
        base_resolution: vec![1025, 1025],
        finest_resolution: vec![4096, 3000],
        smoothstep: false,
        reference_sizing: false,
        pruned_levels: Vec::new(),
    }
}

#[test]
fn a_table_over_the_binding_limit_is_split_by_level() {
    const N: usize = 50;
    let mut rng = Pcg64::seed_from_u64(1);
    let positions: Vec<f32> = (0..2 * N).map(|_| rng.random_range(0.0..1.0)).collect();
    for device in devices() {
        let device = device.autodiff();
        let encoder = large()
            .init(&mut Pcg64::seed_from_u64(2), &device)
            .expect("a good configuration");
        let sizes: Vec<usize> = encoder.tables().map(|t| t.dims()[0]).collect();
        assert_eq!(sizes, [16 << 20, 4 << 20]);
        for name in named_parameters(&encoder).keys() {
            assert!(HashEncoder::is_table(name), "{name}");
        }

        let tensor = Tensor::<2>::from_data(TensorData::new(positions.clone(), [N, 2]), &device);
        let features = encoder.forward(tensor).expect("fits");
        let grads = features.clone().sum().backward();
        let table: Vec<f64> = encoder
            .tables()
            .flat_map(|t| to_host(t.val()))
            .map(f64::from)
            .collect();
        let wide: Vec<f64> = positions.iter().map(|&x| f64::from(x)).collect();
        let expected = reference::hash_encode(&wide, &table, encoder.layout());
        for (i, (got, expected)) in to_host(features).iter().zip(&expected).enumerate() {
            // Weights of a fine level are rounded to a few 1e-7 of the largest feature.
            let error = (f64::from(*got) - expected).abs();
            assert!(
                error <= 1e-6 * 1e-4,
                "feature {i}: {got}, expected {expected}"
            );
        }
        // Each point's weights on a level add up to 1, whichever table holds the level.
        for (table, levels) in encoder.tables().zip([16, 4]) {
            let gradient = to_host(table.val().grad(&grads).expect("a table is trained"));
            let sum: f64 = gradient.iter().map(|&v| f64::from(v)).sum();
            let expected = (N * 2 * levels) as f64;
            assert!((sum - expected).abs() < 1e-3, "{sum}, expected {expected}");
        }
    }
}

#[test]
fn without_a_level_the_features_of_the_others_are_the_same() {
    let config = HashEncoderConfig {
        n_levels: 4,
        log2_hashmap_size: 6,
        base_resolution: vec![4, 3],
        finest_resolution: vec![20, 30],
        ..large()
    };
    let device = Device::flex();
    let init = |config: &HashEncoderConfig| config.init(&mut Pcg64::seed_from_u64(4), &device);
    let all = init(&config).expect("a good configuration");
    let points = Tensor::<2>::from_data([[0.1, 0.9], [0.33, 0.5], [1.0, 0.0]], &device);
    let features = |encoder: &HashEncoder| {
        let features = encoder.forward(points.clone()).expect("fits");
        to_host(features)
    };
    let fewer = all.without(&[0, 2]).expect("two levels stay");
    let expected: Vec<f32> = features(&all)
        .chunks_exact(8)
        .flat_map(|row| [row[2], row[3], row[6], row[7]])
        .collect();
    assert_eq!(features(&fewer), expected);
    // As a file describes it.
    let pruned_levels = vec![0, 2];
    let read = HashEncoderConfig {
        pruned_levels,
        ..config.clone()
    };
    let read = init(&read).expect("a good configuration");
    assert_eq!(read.layout(), fewer.layout());
    for pruned_levels in [vec![4], vec![0, 1, 2, 3], vec![2, 0], vec![1, 1]] {
        let config = HashEncoderConfig {
            pruned_levels,
            ..config.clone()
        };
        assert!(init(&config).is_err(), "{config:?}");
    }
}

#[test]
fn tables_are_told_from_other_parameters() {
    for name in ["table", "field.encoder.table", "encoder.further_tables.12"] {
        assert!(HashEncoder::is_table(name), "{name}");
    }
    for name in [
        "field.trunk.layers.0.weight",
        "static.means",
        "encoder.further_tables",
        "stable",
    ] {
        assert!(!HashEncoder::is_table(name), "{name}");
    }
}
