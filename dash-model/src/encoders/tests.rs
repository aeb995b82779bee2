//! Every encoder against float64, value and gradient.

use std::collections::BTreeMap;

use burn::module::ModuleVisitor;
use burn::module::Param;
use burn::tensor::{Gradients, TensorData};
use dash_kernels::hash_encode::{HashGridLayout, reference};
use dash_kernels::testing::devices;
use rand::SeedableRng;
use rand_pcg::Pcg64;

use super::*;
use crate::gaussians::to_host;
use crate::parameters::{HostTensor, Path, named_parameters, with_parameters};
use crate::{HashEncoderConfig, Heads};

const N: usize = 7;
const HIDDEN: usize = 5;
/// Features are sums and products of a few rounded values of about 1.
const VALUE: f64 = 2e-6;
/// What others allow for gradients in f32.
const GRADIENT: f64 = 1e-4;

type Values = BTreeMap<String, Vec<f64>>;

fn config(representation: Representation) -> DeformationConfig {
    DeformationConfig {
        representation,
        hidden: HIDDEN,
        layers: 1,
        encoder: HashEncoderConfig {
            n_levels: 3,
            n_features_per_level: 2,
            log2_hashmap_size: 6,
            base_resolution: vec![2, 3, 2, 3],
            finest_resolution: vec![7, 5, 6, 9],
            smoothstep: false,
            reference_sizing: false,
            left_out_levels: Vec::new(),
        },
        heads: Heads::default(),
    }
}

/// Features `[N, ..]` in float64 from parameters by name.
fn expected(
    config: &DeformationConfig,
    values: &Values,
    points: &[f64],
    embeddings: &[f64],
) -> Vec<f64> {
    let grid = |axes: &[usize], log2: u32, table: &str| {
        let part = HashEncoderConfig {
            log2_hashmap_size: log2,
            base_resolution: axes
                .iter()
                .map(|&a| config.encoder.base_resolution[a])
                .collect(),
            finest_resolution: axes
                .iter()
                .map(|&a| config.encoder.finest_resolution[a])
                .collect(),
            ..config.encoder.clone()
        };
        let layout = HashGridLayout::new(&part.grid()).expect("valid");
        let chosen: Vec<f64> = points
            .chunks_exact(4)
            .flat_map(|p| axes.iter().map(|&a| p[a]))
            .collect();
        reference::hash_encode(&chosen, &values[table], &layout)
    };
    let layer = |input: &[f64], width: usize, name: &str| -> Vec<f64> {
        let (weight, bias) = (
            &values[&format!("{name}.weight")],
            &values[&format!("{name}.bias")],
        );
        let outputs = bias.len();
        input
            .chunks_exact(width)
            .flat_map(|row| {
                (0..outputs).map(|o| {
                    let sum: f64 = (0..width).map(|i| row[i] * weight[i * outputs + o]).sum();
                    sum + bias[o]
                })
            })
            .collect()
    };
    let width = config.encoder.n_levels * config.encoder.n_features_per_level;
    match config.representation {
        Representation::Hash => grid(&[0, 1, 2, 3], config.encoder.log2_hashmap_size, "table"),
        Representation::HexPlane => {
            let pairs = [[0, 1], [0, 2], [1, 2], [0, 3], [1, 3], [2, 3]];
            let planes = pairs
                .iter()
                .enumerate()
                .map(|(k, pair)| grid(pair, 31, &format!("planes.{k}.table")));
            planes
                .reduce(|a, b| a.iter().zip(&b).map(|(a, b)| a * b).collect())
                .expect("six planes")
        }
        Representation::Grid4d => {
            let log2 = config.encoder.log2_hashmap_size;
            let spatial = grid(&[0, 1, 2], log2, "spatial.table");
            let parts: Vec<Vec<f64>> = [[0, 1, 3], [1, 2, 3], [0, 2, 3]]
                .iter()
                .enumerate()
                .map(|(k, axes)| grid(axes, log2, &format!("temporal.{k}.table")))
                .collect();
            let joined: Vec<f64> = (0..N)
                .flat_map(|row| {
                    parts
                        .iter()
                        .flat_map(move |part| &part[row * width..(row + 1) * width])
                })
                .copied()
                .collect();
            let weights = layer(&spatial, width, "attention.layers.0");
            let weighed = layer(&joined, 3 * width, "decoder.layers.0");
            weights
                .iter()
                .zip(&weighed)
                .map(|(w, v)| (2.0 / (1.0 + (-w).exp()) - 1.0) * v)
                .collect()
        }
        Representation::Embedding => {
            let mut rows = Vec::new();
            for (row, point) in points.chunks_exact(4).enumerate() {
                rows.extend(&embeddings[row * width..(row + 1) * width]);
                for k in 0..2 {
                    let table = &values[&format!("times.{k}")];
                    let columns = width.div_ceil(2);
                    let cells = table.len() / columns - 1;
                    let place = point[3] * cells as f64;
                    let cell = (place.floor() as usize).min(cells - 1);
                    let share = place - cell as f64;
                    rows.extend((0..columns).map(|c| {
                        (1.0 - share) * table[cell * columns + c]
                            + share * table[(cell + 1) * columns + c]
                    }));
                }
            }
            rows
        }
    }
}

/// Gradients of all parameters by name.
struct Collector<'a> {
    path: Path,
    gradients: &'a Gradients,
    found: Values,
}

impl ModuleVisitor for Collector<'_> {
    fn enter_module(&mut self, name: &str, container_type: &str) {
        self.path.enter(name, container_type);
    }

    fn exit_module(&mut self, _name: &str, container_type: &str) {
        self.path.exit(container_type);
    }

    fn visit_float<const D: usize>(&mut self, param: &Param<Tensor<D>>) {
        let gradient = param.val().grad(self.gradients).expect("used");
        let values = to_host(gradient).into_iter().map(f64::from).collect();
        self.found.insert(self.path.name(), values);
    }
}

#[test]
fn every_encoder_is_the_reference_with_its_gradients() {
    for representation in [
        Representation::Hash,
        Representation::HexPlane,
        Representation::Grid4d,
        Representation::Embedding,
    ] {
        for device in devices() {
            check(&config(representation), &device.autodiff());
        }
    }
}

fn check(config: &DeformationConfig, device: &Device) {
    let mut rng = Pcg64::seed_from_u64(3);
    let encoder = SpaceTimeEncoder::new(config, &mut rng, device).expect("valid");
    // Values of about 1 everywhere: started values hide errors of factors.
    let mut random =
        |n: usize, low: f32| -> Vec<f32> { (0..n).map(|_| rng.random_range(low..1.0)).collect() };
    let parameters: BTreeMap<String, HostTensor> = named_parameters(&encoder)
        .into_iter()
        .map(|(name, tensor)| {
            let values = random(tensor.values.len(), -1.0);
            (name, HostTensor { values, ..tensor })
        })
        .collect();
    let encoder = with_parameters(encoder, parameters.clone()).expect("its own names");
    assert_eq!(
        SpaceTimeEncoder::n_values(config).expect("valid"),
        parameters
            .values()
            .map(|t| t.values.len() as u128)
            .sum::<u128>()
    );
    let points = random(4 * N, 0.0);
    let width = config.embedding_width();
    let embeddings = random(N * width, -1.0);
    let tensor = |values: &[f32], columns: usize| {
        Tensor::<2>::from_data(TensorData::new(values.to_vec(), [N, columns]), device)
    };
    let own = (width > 0).then(|| tensor(&embeddings, width).require_grad());
    let features = encoder
        .forward(tensor(&points, 4), own.clone())
        .expect("fits");
    let n_features = features.dims()[1];
    assert_eq!(n_features, SpaceTimeEncoder::n_output_features_of(config));

    let wide = |values: &[f32]| -> Vec<f64> { values.iter().map(|&v| f64::from(v)).collect() };
    let (points, embeddings) = (wide(&points), wide(&embeddings));
    let values: Values = parameters
        .iter()
        .map(|(n, t)| (n.clone(), wide(&t.values)))
        .collect();
    let truth = expected(config, &values, &points, &embeddings);
    let got = wide(&to_host(features.clone()));
    for (i, (got, expected)) in got.iter().zip(&truth).enumerate() {
        assert!(
            (got - expected).abs() <= VALUE * (1.0 + expected.abs()),
            "{:?} feature {i}: {got}, expected {expected}",
            config.representation
        );
    }

    // Along a random direction, the gradient is what the reference changes by.
    let cotangent = random(N * n_features, -1.0);
    let loss = (features * tensor(&cotangent, n_features)).sum();
    let gradients = loss.backward();
    let mut collector = Collector {
        path: Path::default(),
        gradients: &gradients,
        found: Values::new(),
    };
    encoder.visit(&mut collector);
    assert_eq!(
        collector.found.len(),
        values.len(),
        "every parameter is used"
    );
    let judge = |values: &Values, embeddings: &[f64]| -> f64 {
        let features = expected(config, values, &points, embeddings);
        features
            .iter()
            .zip(&cotangent)
            .map(|(f, c)| f * f64::from(*c))
            .sum()
    };
    const STEP: f64 = 1e-5;
    let moved = |of: &[f64], direction: &[f32], step: f64| -> Vec<f64> {
        of.iter()
            .zip(direction)
            .map(|(v, d)| v + step * f64::from(*d))
            .collect()
    };
    let compare = |name: &str, gradient: &[f64], direction: &[f32], slope: f64| {
        let along: f64 = gradient
            .iter()
            .zip(direction)
            .map(|(g, d)| g * f64::from(*d))
            .sum();
        assert!(
            (along - slope).abs() <= GRADIENT * (1.0 + slope.abs()),
            "{:?} {name}: {along}, expected {slope}",
            config.representation
        );
    };
    for (name, gradient) in &collector.found {
        let direction = random(gradient.len(), -1.0);
        let at = |step: f64| {
            let mut values = values.clone();
            let changed = moved(&values[name], &direction, step);
            values.insert(name.clone(), changed);
            judge(&values, &embeddings)
        };
        compare(
            name,
            gradient,
            &direction,
            (at(STEP) - at(-STEP)) / (2.0 * STEP),
        );
    }
    if let Some(own) = own {
        let gradient = wide(&to_host(own.grad(&gradients).expect("used")));
        let direction = random(gradient.len(), -1.0);
        let at = |step: f64| judge(&values, &moved(&embeddings, &direction, step));
        compare(
            "embeddings",
            &gradient,
            &direction,
            (at(STEP) - at(-STEP)) / (2.0 * STEP),
        );
    }
}

#[test]
fn a_field_that_needs_embeddings_says_so() {
    let device = devices().remove(0);
    let mut rng = Pcg64::seed_from_u64(1);
    let config = config(Representation::Embedding);
    let encoder = SpaceTimeEncoder::new(&config, &mut rng, &device).expect("valid");
    let points = Tensor::zeros([N, 4], &device);
    let error = encoder.forward(points, None).expect_err("no embeddings");
    assert!(error.to_string().contains("embeddings"), "{error}");
}

#[test]
fn a_grid_of_three_axes_is_refused() {
    let device = devices().remove(0);
    let mut config = config(Representation::HexPlane);
    config.encoder.base_resolution.pop();
    let error = SpaceTimeEncoder::new(&config, &mut Pcg64::seed_from_u64(1), &device)
        .expect_err("three axes");
    assert!(error.to_string().contains("4 resolutions"), "{error}");
}
