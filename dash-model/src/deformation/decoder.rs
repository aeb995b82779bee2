//! Hidden layers and heads as one network.

use std::collections::BTreeMap;

use burn::module::{Module, Param};
use burn::tensor::{Device, Tensor};
use dash_kernels::mlp::mlp;
use rand::Rng;

use super::Heads;
use super::packing::{Packing, hidden_name};
use crate::ModelError;
use crate::gaussians::to_host;
use crate::parameters::{HostTensor, parameter};

/// Start of the heads' weights: nothing is deformed at first.
const INITIAL_HEAD: f32 = 1e-3;

/// Fully connected hidden layers, each followed by ReLU, and the heads that read the last of them.
///
/// Weights and biases are one parameter, the form that [`mlp`] takes, so that no forward pass concatenates tensors. Files
/// hold one tensor per layer and head, see [`Packing`].
#[derive(Module, Debug)]
pub(crate) struct Decoder {
    /// `[P]`, see [`mlp`]; the heads are columns of the last layer.
    parameters: Param<Tensor<1>>,
    #[module(skip)]
    packing: Packing,
}

impl Decoder {
    /// A decoder of the given widths: the input's, then those of the hidden layers. Weights start uniform in
    /// +-sqrt(6 / fan-in) (He), those of the heads near zero, biases at zero.
    pub(super) fn new(
        widths: &[usize],
        heads: &Heads,
        rng: &mut impl Rng,
        device: &Device,
    ) -> Result<Self, ModelError> {
        let packing = Packing::new(widths, heads)?;
        let mut named = packing.zeros("");
        let mut fill = |name: &str, bound: f32| {
            let tensor = named.get_mut(&format!("{name}.weight"));
            for value in &mut tensor.expect("named by the same packing").values {
                *value = (rng.random::<f32>() * 2.0 - 1.0) * bound;
            }
        };
        for (index, layer) in packing.hidden().iter().enumerate() {
            fill(&hidden_name(index), (6.0 / layer.n_inputs as f32).sqrt());
        }
        for (head, _) in packing.heads() {
            fill(head, INITIAL_HEAD);
        }
        Ok(Self::from_named(packing, named, device))
    }

    fn from_named(
        packing: Packing,
        mut named: BTreeMap<String, HostTensor>,
        device: &Device,
    ) -> Self {
        let values = packing
            .pack("", &mut named)
            .expect("tensors of the same packing");
        let n = values.len();
        Self {
            parameters: parameter(values, [n], device),
            packing,
        }
    }

    /// The outputs of all heads, side by side.
    ///
    /// # Shapes
    /// `features [N, F] -> [N, sum of the heads' widths]`
    pub(super) fn forward(&self, features: Tensor<2>) -> Result<Tensor<2>, ModelError> {
        Ok(mlp(features, self.parameters.val(), self.packing.layout())?)
    }

    /// Where the parameter holds each layer and head.
    pub(crate) fn packing(&self) -> &Packing {
        &self.packing
    }

    /// The decoder with these of its heads only.
    pub(super) fn with_heads(&self, heads: &Heads) -> Self {
        let packing = Packing::new(&self.packing.widths(), heads).expect("widths of a decoder");
        Self::from_named(packing, self.named(), &self.parameters.device())
    }

    /// The decoder without the features that are not `kept`. Their contribution at `means`, one for each feature, is
    /// added to the first layer's biases.
    pub(super) fn with_features(
        &self,
        kept: &[bool],
        means: &[f32],
        heads: &Heads,
    ) -> Result<Self, ModelError> {
        let mut named = self.named();
        let name = hidden_name(0);
        let weights = named.get_mut(&format!("{name}.weight"));
        let weights = std::mem::take(&mut weights.expect("the first layer").values);
        let bias = named.get_mut(&format!("{name}.bias"));
        let bias = bias.expect("the first layer");
        let mut widths = self.packing.widths();
        let mut remaining = Vec::new();
        for ((row, &kept), mean) in weights.chunks_exact(widths[1]).zip(kept).zip(means) {
            if kept {
                remaining.extend_from_slice(row);
                continue;
            }
            for (bias, weight) in bias.values.iter_mut().zip(row) {
                *bias += mean * weight;
            }
        }
        widths[0] = remaining.len() / widths[1];
        let weight = HostTensor {
            shape: widths[..2].to_vec(),
            values: remaining,
        };
        named.insert(format!("{name}.weight"), weight);
        let packing = Packing::new(&widths, heads)?;
        Ok(Self::from_named(packing, named, &self.parameters.device()))
    }

    /// Weights and biases of layers and heads.
    fn named(&self) -> BTreeMap<String, HostTensor> {
        self.packing.unpack("", &to_host(self.parameters.val()))
    }
}

#[cfg(test)]
mod tests;
