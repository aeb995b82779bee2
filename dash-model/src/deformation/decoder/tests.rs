//! The decoder against its layers and heads one by one.

use rand::SeedableRng;
use rand_pcg::Pcg64;

use super::*;

const WIDTHS: [usize; 3] = [3, 5, 4];

fn decoder(heads: &Heads) -> Decoder {
    let mut rng = Pcg64::seed_from_u64(1);
    let decoder = Decoder::new(&WIDTHS, heads, &mut rng, &Device::flex()).expect("good widths");
    let mut named = decoder.named();
    // Biases that are not zero, heads that are not small.
    for values in named.values_mut().map(|tensor| &mut tensor.values) {
        values.fill_with(|| rng.random_range(-1.0..1.0));
    }
    Decoder::from_named(decoder.packing, named, &Device::flex())
}

/// A head's outputs from the tensors by name, without the packed parameter.
fn by_name(named: &BTreeMap<String, HostTensor>, features: &[f32], head: &str) -> Vec<f32> {
    let layer = |input: &[f32], name: &str| -> Vec<f32> {
        let weight = &named[&format!("{name}.weight")];
        let bias = &named[&format!("{name}.bias")].values;
        assert_eq!(weight.shape, [input.len(), bias.len()]);
        let column = |j: usize| weight.values.iter().skip(j).step_by(bias.len());
        let sum = |j: usize| -> f32 { column(j).zip(input).map(|(w, x)| w * x).sum() };
        (0..bias.len()).map(|j| bias[j] + sum(j)).collect()
    };
    let relu = |values: Vec<f32>| values.into_iter().map(|v| v.max(0.0)).collect::<Vec<_>>();
    let hidden = (0..2).fold(features.to_vec(), |input, index| {
        relu(layer(&input, &format!("decoder.layers.{index}")))
    });
    layer(&hidden, head)
}

fn outputs(decoder: &Decoder, features: &[f32]) -> Vec<f32> {
    let features = Tensor::<1>::from_floats(features, &Device::flex()).unsqueeze();
    to_host(decoder.forward(features).expect("fits"))
}

fn assert_near(found: &[f32], expected: &[f32]) {
    assert_eq!(found.len(), expected.len());
    for (found, expected) in found.iter().zip(expected) {
        assert!((found - expected).abs() < 1e-5, "{found} for {expected}");
    }
}

#[test]
fn heads_side_by_side_are_the_heads_by_name() {
    let heads = Heads {
        appearance: true,
        sh_rest: 3,
        ..Heads::default()
    };
    let (decoder, features) = (decoder(&heads), [0.3, -0.8, 0.5]);
    let named = decoder.named();
    let names = [
        "head_means",
        "head_quats",
        "head_scales",
        "head_appearance",
        "head_sh_rest",
    ];
    let expected = names.map(|head| by_name(&named, &features, head)).concat();
    assert_near(&outputs(&decoder, &features), &expected);
    // Pruning a head leaves the others unchanged.
    let fewer = Heads {
        rotation: false,
        ..heads
    };
    let expected = [&expected[..3], &expected[7..]].concat();
    assert_near(&outputs(&decoder.with_heads(&fewer), &features), &expected);
}

#[test]
fn a_pruned_feature_keeps_contributing_its_mean() {
    let heads = Heads::default();
    let (decoder, means) = (decoder(&heads), [9.0, -0.8, 9.0]);
    let fewer = decoder.with_features(&[true, false, true], &means, &heads);
    let fewer = fewer.expect("two are left");
    let (all, left) = ([0.3, -0.8, 0.5], [0.3, 0.5]);
    assert_near(&outputs(&fewer, &left), &outputs(&decoder, &all));
}

#[test]
fn what_is_missing_or_of_another_shape_is_named() {
    let decoder = decoder(&Heads::default());
    let named = || {
        let values = to_host(decoder.parameters.val());
        decoder.packing.unpack("field.", &values)
    };
    let refused = |mut named| {
        let error = decoder.packing.pack("field.", &mut named);
        error.expect_err("refused").to_string()
    };
    let mut missing = named();
    missing.remove("field.head_quats.bias");
    let expected = "parameter `field.head_quats.bias`: expected shape [4], found none";
    assert_eq!(refused(missing), expected);
    let mut other = named();
    let weight = other.get_mut("field.decoder.layers.1.weight");
    weight.expect("there").shape = vec![4, 5];
    let expected =
        "parameter `field.decoder.layers.1.weight`: expected shape [5, 4], found shape [4, 5]";
    assert_eq!(refused(other), expected);
}
