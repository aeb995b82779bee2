//! Every encoder against float64, value and gradient.

mod reference;

use std::collections::BTreeMap;

use burn::module::ModuleVisitor;
use burn::module::Param;
use burn::tensor::{Gradients, TensorData};
use dash_kernels::testing::devices;
use rand::SeedableRng;
use rand_pcg::Pcg64;

use super::*;
use crate::gaussians::to_host;
use crate::parameters::{Path, named_parameters, with_parameters};
use crate::{HashEncoderConfig, Heads};

const N: usize = 7;
const HIDDEN: usize = 5;
/// Features are sums and products of a few rounded values of about 1.
const VALUE: f64 = 2e-6;
/// Tolerance for gradients in f32, as in the kernels' tests.
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
            pruned_levels: Vec::new(),
        },
        temporal: None,
        heads: Heads::default(),
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

/// Other sizes for the grids with time.
fn with_temporal(representation: Representation) -> DeformationConfig {
    let mut config = config(representation);
    config.temporal = Some(HashEncoderConfig {
        n_levels: 4,
        log2_hashmap_size: 5,
        base_resolution: vec![1, 2, 3, 2],
        finest_resolution: vec![4, 6, 5, 7],
        ..config.encoder.clone()
    });
    config
}

#[test]
fn grids_with_time_may_have_sizes_of_their_own() {
    for device in devices() {
        check(&with_temporal(Representation::Grid4d), &device.autodiff());
    }
    let refused = with_temporal(Representation::Hash).validate();
    let refused = refused.expect_err("one grid").to_string();
    assert!(refused.contains("temporal"), "{refused}");
}

/// Features of zero, nearly, are weighted: otherwise no grid would learn.
#[test]
fn the_attention_of_grid4d_begins_with_biases() {
    let device = devices().remove(0);
    let config = config(Representation::Grid4d);
    let grid = Grid4d::new(&config, &mut Pcg64::seed_from_u64(1), &device).expect("valid");
    let bias = grid.attention.layers[0].bias.as_ref().expect("biases");
    let bias = to_host(bias.val());
    let bound = 1.0 / 6f32.sqrt();
    assert!(bias.iter().all(|b| b.abs() <= bound), "{bias:?}");
    let largest = bias.iter().fold(0.0f32, |most, b| most.max(b.abs()));
    assert!(largest > 0.1 * bound, "{bias:?}");
}

fn wide(values: &[f32]) -> Vec<f64> {
    values.iter().map(|&v| f64::from(v)).collect()
}

fn dot(values: &[f64], weights: &[f32]) -> f64 {
    let pairs = values.iter().zip(weights);
    pairs.map(|(v, w)| v * f64::from(*w)).sum()
}

/// The encoder with values of about 1 everywhere: the small initial values would hide a wrong factor.
fn with_random_values(
    config: &DeformationConfig,
    encoder: SpaceTimeEncoder,
    mut random: impl FnMut(usize) -> Vec<f32>,
) -> (SpaceTimeEncoder, Values) {
    let mut parameters = named_parameters(&encoder);
    for tensor in parameters.values_mut() {
        tensor.values = random(tensor.values.len());
    }
    let n_values: usize = parameters.values().map(|t| t.values.len()).sum();
    let expected = SpaceTimeEncoder::n_values(config).expect("valid");
    assert_eq!(n_values as u128, expected);
    let values = parameters
        .iter()
        .map(|(name, tensor)| (name.clone(), wide(&tensor.values)))
        .collect();
    let encoder = with_parameters(encoder, parameters).expect("its own names");
    (encoder, values)
}

fn assert_features(got: &[f64], truth: &[f64], config: &DeformationConfig) {
    assert_eq!(got.len(), truth.len());
    for (i, (got, expected)) in got.iter().zip(truth).enumerate() {
        assert!(
            (got - expected).abs() <= VALUE * (1.0 + expected.abs()),
            "{:?} feature {i}: {got}, expected {expected}",
            config.representation
        );
    }
}

fn check(config: &DeformationConfig, device: &Device) {
    let mut rng = Pcg64::seed_from_u64(3);
    let encoder = SpaceTimeEncoder::new(config, &mut rng, device).expect("valid");
    let mut random =
        |n: usize, low: f32| -> Vec<f32> { (0..n).map(|_| rng.random_range(low..1.0)).collect() };
    let (encoder, values) = with_random_values(config, encoder, |n| random(n, -1.0));
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
    let (points, embeddings) = (wide(&points), wide(&embeddings));
    let truth = reference::features(config, &values, &points, &embeddings);
    let got = wide(&to_host(features.clone()));
    assert_features(&got, &truth, config);

    let cotangent = random(N * n_features, -1.0);
    let loss = (features * tensor(&cotangent, n_features)).sum();
    let gradients = loss.backward();
    let mut collector = Collector {
        path: Path::default(),
        gradients: &gradients,
        found: Values::new(),
    };
    encoder.visit(&mut collector);
    let names = |values: &Values| values.keys().cloned().collect::<Vec<_>>();
    assert_eq!(
        names(&collector.found),
        names(&values),
        "every parameter is used"
    );
    let loss = |values: &Values, embeddings: &[f64]| {
        let features = reference::features(config, values, &points, embeddings);
        dot(&features, &cotangent)
    };
    for (name, gradient) in &collector.found {
        let direction = random(gradient.len(), -1.0);
        let along = |step: f64| {
            let mut values = values.clone();
            let moved = moved(&values[name], &direction, step);
            values.insert(name.clone(), moved);
            loss(&values, &embeddings)
        };
        let what = format!("{:?} {name}", config.representation);
        assert_slope(&what, dot(gradient, &direction), along);
    }
    if let Some(own) = own {
        let gradient = wide(&to_host(own.grad(&gradients).expect("used")));
        let direction = random(gradient.len(), -1.0);
        let along = |step: f64| loss(&values, &moved(&embeddings, &direction, step));
        assert_slope("embeddings", dot(&gradient, &direction), along);
    }
}

fn moved(values: &[f64], direction: &[f32], step: f64) -> Vec<f64> {
    let pairs = values.iter().zip(direction);
    pairs.map(|(v, d)| v + step * f64::from(*d)).collect()
}

/// The gradient along a direction is the central difference of the reference.
fn assert_slope(what: &str, gradient: f64, along: impl Fn(f64) -> f64) {
    const STEP: f64 = 1e-5;
    let slope = (along(STEP) - along(-STEP)) / (2.0 * STEP);
    assert!(
        (gradient - slope).abs() <= GRADIENT * (1.0 + slope.abs()),
        "{what}: {gradient}, expected {slope}"
    );
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
    assert!(
        error
            .to_string()
            .contains("expected 4 values (x, y, z, t), found 3"),
        "{error}"
    );
}
