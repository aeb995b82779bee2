//! Small fully connected networks with a reproducible start.

use burn::module::Module;
use burn::nn::Linear;
use burn::tensor::{Device, Tensor};
use dash_kernels::KernelError;
use dash_kernels::mlp::{MlpLayout, mlp};
use rand::Rng;

use crate::parameters::parameter;

/// Fully connected layers with ReLU between them (none after the last).
#[derive(Module, Debug)]
pub struct Mlp {
    /// The layers, first to last.
    pub layers: Vec<Linear>,
}

impl Mlp {
    /// Layers of the given widths, first input to last output; weights uniform in
    /// +-sqrt(6 / fan-in) (He), biases zero.
    pub fn new(widths: &[usize], rng: &mut impl Rng, device: &Device) -> Self {
        let layers = widths
            .windows(2)
            .map(|pair| linear(pair[0], pair[1], (6.0 / pair[0] as f32).sqrt(), rng, device))
            .collect();
        Self { layers }
    }

    /// # Shapes
    /// `[N, first width] -> [N, last width]`
    ///
    /// # Errors
    /// When the input has another width, or outgrows the device.
    pub fn forward(&self, input: Tensor<2>) -> Result<Tensor<2>, KernelError> {
        let last = self.layers.len() - 1;
        forward(input, &self.layers[..last], &[&self.layers[last]])
    }
}

/// What `heads` give side by side, each of what comes out of the layers of `trunk`, with ReLU behind each of these.
///
/// # Shapes
/// `[N, first width] -> [N, sum of the heads' widths]`
///
/// # Errors
/// When the widths do not fit, or the device can't hold so many rows.
pub(crate) fn forward(
    input: Tensor<2>,
    trunk: &[Linear],
    heads: &[&Linear],
) -> Result<Tensor<2>, KernelError> {
    let device = input.device();
    let mut widths = Vec::with_capacity(trunk.len() + 2);
    let mut parameters = Vec::with_capacity(2 * trunk.len() + 2);
    for layer in trunk {
        widths.push(layer.weight.dims()[0]);
        parameters.extend([layer.weight.val().flatten(0, 1), biases(layer, &device)]);
    }
    let weights: Vec<_> = heads.iter().map(|head| head.weight.val()).collect();
    let biases = heads.iter().map(|head| biases(head, &device)).collect();
    let weights = Tensor::cat(weights, 1);
    widths.extend(weights.dims());
    parameters.extend([weights.flatten(0, 1), Tensor::cat(biases, 0)]);
    mlp(input, Tensor::cat(parameters, 0), &MlpLayout::new(&widths)?)
}

fn biases(layer: &Linear, device: &Device) -> Tensor<1> {
    match &layer.bias {
        Some(bias) => bias.val(),
        None => Tensor::zeros([layer.weight.dims()[1]], device),
    }
}

/// A layer whose weights are uniform in +-`bound` and whose bias is zero.
pub fn linear(
    d_input: usize,
    d_output: usize,
    bound: f32,
    rng: &mut impl Rng,
    device: &Device,
) -> Linear {
    let weights: Vec<f32> = (0..d_input * d_output)
        .map(|_| (rng.random::<f32>() * 2.0 - 1.0) * bound)
        .collect();
    Linear {
        weight: parameter(weights, [d_input, d_output], device),
        bias: Some(parameter(vec![0.0; d_output], [d_output], device)),
    }
}
