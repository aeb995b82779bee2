//! Hidden layers and heads as one network.

use std::collections::BTreeMap;

use burn::module::{Module, Param};
use burn::tensor::{Device, Tensor};
use dash_kernels::mlp::{MlpLayer, MlpLayout, mlp};
use rand::Rng;

use super::Heads;
use crate::ModelError;
use crate::gaussians::to_host;
use crate::parameters::{HostTensor, parameter};

/// Start of the heads' weights: nothing is deformed at first.
const INITIAL_HEAD: f32 = 1e-3;

/// Fully connected hidden layers, each followed by ReLU, and the heads that read the last of them.
///
/// Weights and biases are one parameter, as [`mlp`] wants them, so that neither a picture nor a step of training joins
/// tensors. Files have each layer and each head on its own, see [`Parts`].
#[derive(Module, Debug)]
pub(crate) struct Decoder {
    /// `[P]`, see [`mlp`]; the heads are columns of the last layer.
    parameters: Param<Tensor<1>>,
    #[module(skip)]
    parts: Parts,
}

/// What a decoder's parameter is made of.
#[derive(Debug, Clone)]
pub(crate) struct Parts {
    layout: MlpLayout,
    /// Names and outputs.
    heads: Vec<(&'static str, usize)>,
}

impl Decoder {
    /// Hidden layers of the given widths behind the first, that of the input; weights uniform in +-sqrt(6 / fan-in)
    /// (He), those of heads next to zero, biases zero.
    pub(super) fn new(
        widths: &[usize],
        heads: &Heads,
        rng: &mut impl Rng,
        device: &Device,
    ) -> Result<Self, ModelError> {
        let parts = Parts::new(widths, heads)?;
        let mut named = parts.zeros("");
        let mut fill = |name: &str, bound: f32| {
            let tensor = named.get_mut(&format!("{name}.weight"));
            for value in &mut tensor.expect("one of them").values {
                *value = (rng.random::<f32>() * 2.0 - 1.0) * bound;
            }
        };
        for (index, layer) in parts.hidden().iter().enumerate() {
            fill(&hidden_name(index), (6.0 / layer.n_inputs as f32).sqrt());
        }
        for (head, _) in &parts.heads {
            fill(head, INITIAL_HEAD);
        }
        Ok(Self::from_named(parts, named, device))
    }

    fn from_named(parts: Parts, mut named: BTreeMap<String, HostTensor>, device: &Device) -> Self {
        let values = parts.join("", &mut named).expect("all that it is made of");
        let n = values.len();
        Self {
            parameters: parameter(values, [n], device),
            parts,
        }
    }

    /// What all heads give, side by side.
    ///
    /// # Shapes
    /// `features [N, F] -> [N, sum of the heads' widths]`
    pub(super) fn forward(&self, features: Tensor<2>) -> Result<Tensor<2>, ModelError> {
        Ok(mlp(features, self.parameters.val(), &self.parts.layout)?)
    }

    /// What its parameter is made of.
    pub(crate) fn parts(&self) -> &Parts {
        &self.parts
    }

    /// The decoder with these heads only, which it has.
    pub(super) fn with_heads(&self, heads: &Heads) -> Self {
        let parts = Parts::new(&self.parts.widths(), heads).expect("widths of a decoder");
        Self::from_named(parts, self.named(), &self.parameters.device())
    }

    /// The decoder with some rows only of the first layer's weights; what the others add at `means` of all features
    /// goes into the biases.
    pub(super) fn with_features(
        &self,
        kept: &[bool],
        means: &[f32],
        heads: &Heads,
    ) -> Result<Self, ModelError> {
        let mut named = self.named();
        let name = hidden_name(0);
        let weights = named.get_mut(&format!("{name}.weight"));
        let weights = std::mem::take(&mut weights.expect("the first").values);
        let bias = named.get_mut(&format!("{name}.bias")).expect("the first");
        let mut widths = self.parts.widths();
        let mut left = Vec::new();
        for ((row, &kept), mean) in weights.chunks_exact(widths[1]).zip(kept).zip(means) {
            if kept {
                left.extend_from_slice(row);
                continue;
            }
            for (bias, weight) in bias.values.iter_mut().zip(row) {
                *bias += mean * weight;
            }
        }
        widths[0] = left.len() / widths[1];
        let weight = HostTensor {
            shape: widths[..2].to_vec(),
            values: left,
        };
        named.insert(format!("{name}.weight"), weight);
        let parts = Parts::new(&widths, heads)?;
        Ok(Self::from_named(parts, named, &self.parameters.device()))
    }

    /// Weights and biases of layers and heads.
    fn named(&self) -> BTreeMap<String, HostTensor> {
        self.parts.split("", &to_host(self.parameters.val()))
    }
}

impl Parts {
    fn new(widths: &[usize], heads: &Heads) -> Result<Self, ModelError> {
        let heads: Vec<_> = heads.present().collect();
        let mut widths = widths.to_vec();
        widths.push(heads.iter().map(|(_, width)| width).sum());
        let layout = MlpLayout::new(&widths)?;
        Ok(Self { layout, heads })
    }

    /// Of the input, then of each hidden layer.
    fn widths(&self) -> Vec<usize> {
        let layers = self.layout.layers().iter();
        layers.map(|layer| layer.n_inputs).collect()
    }

    fn hidden(&self) -> &[MlpLayer] {
        let layers = self.layout.layers();
        &layers[..layers.len() - 1]
    }

    /// Weights and biases out of a parameter's values, by name behind `prefix`: `decoder.layers.0.weight`,
    /// `head_means.bias` and the like.
    pub(crate) fn split(&self, prefix: &str, values: &[f32]) -> BTreeMap<String, HostTensor> {
        let mut named = self.zeros(prefix);
        for part in self.list(prefix) {
            let tensor = named.get_mut(&part.name).expect("of the same parts");
            let rows = tensor.values.chunks_exact_mut(part.width);
            for (row, first) in rows.zip(part.rows()) {
                row.copy_from_slice(&values[first..][..part.width]);
            }
        }
        named
    }

    /// The values of a parameter; takes weights and biases out of `named`, where they are behind `prefix`.
    ///
    /// # Errors
    /// What is missing or of another shape.
    pub(crate) fn join(
        &self,
        prefix: &str,
        named: &mut BTreeMap<String, HostTensor>,
    ) -> Result<Vec<f32>, String> {
        let mut values = vec![0.0; self.layout.n_parameters()];
        for part in self.list(prefix) {
            let name = &part.name;
            let tensor = named.remove(name).ok_or_else(|| format!("no `{name}`"))?;
            if tensor.shape != part.shape() {
                let (found, expected) = (tensor.shape, part.shape());
                return Err(format!("`{name}` of shape {found:?}, not {expected:?}"));
            }
            for (row, first) in tensor.values.chunks_exact(part.width).zip(part.rows()) {
                values[first..][..part.width].copy_from_slice(row);
            }
        }
        Ok(values)
    }

    fn zeros(&self, prefix: &str) -> BTreeMap<String, HostTensor> {
        let zeros = |part: Part| {
            let (shape, values) = (part.shape(), vec![0.0; part.n_rows * part.width]);
            (part.name, HostTensor { shape, values })
        };
        self.list(prefix).map(zeros).collect()
    }

    /// Where each named tensor lies in the parameter.
    fn list(&self, prefix: &str) -> impl Iterator<Item = Part> {
        let hidden = self.hidden().iter().enumerate();
        let whole = move |(index, &layer): (usize, &MlpLayer)| {
            let name = format!("{prefix}{}", hidden_name(index));
            Part::both(name, layer, 0, layer.n_outputs)
        };
        let last = *self.layout.layers().last().expect("has two or more");
        let mut column = 0;
        let heads = self.heads.iter().flat_map(move |&(name, width)| {
            column += width;
            Part::both(format!("{prefix}{name}"), last, column - width, width)
        });
        hidden.flat_map(whole).chain(heads)
    }
}

/// Some neighbouring columns of a layer's weights, or of its biases.
struct Part {
    name: String,
    /// `None` of biases, which have no rows.
    n_inputs: Option<usize>,
    n_rows: usize,
    width: usize,
    first: usize,
    stride: usize,
}

impl Part {
    fn both(name: String, layer: MlpLayer, column: usize, width: usize) -> [Self; 2] {
        let weights = Self {
            name: format!("{name}.weight"),
            n_inputs: Some(layer.n_inputs),
            n_rows: layer.n_inputs,
            width,
            first: layer.first + column,
            stride: layer.n_outputs,
        };
        let biases = Self {
            name: format!("{name}.bias"),
            n_inputs: None,
            n_rows: 1,
            width,
            first: layer.first_bias() + column,
            stride: layer.n_outputs,
        };
        [weights, biases]
    }

    fn shape(&self) -> Vec<usize> {
        self.n_inputs.into_iter().chain([self.width]).collect()
    }

    /// Where each of its rows starts.
    fn rows(&self) -> impl Iterator<Item = usize> + use<> {
        let (first, stride) = (self.first, self.stride);
        (0..self.n_rows).map(move |row| first + row * stride)
    }
}

fn hidden_name(index: usize) -> String {
    format!("decoder.layers.{index}")
}

#[cfg(test)]
mod tests {
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
        Decoder::from_named(decoder.parts, named, &Device::flex())
    }

    /// What layers and heads give by name, without the packed parameter.
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
            ..Heads::default()
        };
        let (decoder, features) = (decoder(&heads), [0.3, -0.8, 0.5]);
        let named = decoder.named();
        let names = ["head_means", "head_quats", "head_scales", "head_appearance"];
        let expected = names.map(|head| by_name(&named, &features, head)).concat();
        assert_near(&outputs(&decoder, &features), &expected);
        // Without a head the others are what they were.
        let fewer = Heads {
            rotation: false,
            ..heads
        };
        let expected = [&expected[..3], &expected[7..]].concat();
        assert_near(&outputs(&decoder.with_heads(&fewer), &features), &expected);
    }

    #[test]
    fn a_feature_left_out_goes_on_as_its_mean() {
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
            decoder.parts.split("field.", &values)
        };
        let refused = |mut named| {
            decoder
                .parts
                .join("field.", &mut named)
                .expect_err("refused")
        };
        let mut missing = named();
        missing.remove("field.head_quats.bias");
        assert_eq!(refused(missing), "no `field.head_quats.bias`");
        let mut other = named();
        let weight = other.get_mut("field.decoder.layers.1.weight");
        weight.expect("there").shape = vec![4, 5];
        let expected = "`field.decoder.layers.1.weight` of shape [4, 5], not [5, 4]";
        assert_eq!(refused(other), expected);
    }
}
