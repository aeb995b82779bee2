//! Small fully connected networks with a reproducible start.

use burn::module::{Module, Param};
use burn::nn::Linear;
use burn::tensor::activation::relu;
use burn::tensor::{Device, Tensor, TensorData};
use rand::Rng;

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
    pub fn forward(&self, input: Tensor<2>) -> Tensor<2> {
        let last = self.layers.len() - 1;
        self.layers
            .iter()
            .enumerate()
            .fold(input, |x, (index, layer)| {
                let x = layer.forward(x);
                if index < last { relu(x) } else { x }
            })
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
        weight: Param::from_data(TensorData::new(weights, [d_input, d_output]), device),
        bias: Some(Param::from_data(
            TensorData::new(vec![0.0f32; d_output], [d_output]),
            device,
        )),
    }
}
