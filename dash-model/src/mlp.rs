//! Small fully connected networks whose initial weights come from the caller's random number generator.
//!
//! ```
//! use burn::tensor::{Device, Tensor};
//! use dash_model::mlp::{Mlp, linear};
//! use rand::SeedableRng;
//!
//! let device = Device::flex();
//! let mut rng = rand_pcg::Pcg64::seed_from_u64(1);
//! let mut mlp = Mlp::new(&[8, 16, 3], &mut rng, &device);
//! // A last layer that starts near zero.
//! mlp.layers[1] = linear(16, 3, 1e-3, &mut rng, &device);
//! let outputs = mlp.forward(Tensor::zeros([5, 8], &device))?;
//! assert_eq!(outputs.dims(), [5, 3]);
//! # Ok::<(), dash_kernels::KernelError>(())
//! ```

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

    /// The outputs of the last layer.
    ///
    /// # Shapes
    /// `[N, first width] -> [N, last width]`
    ///
    /// # Errors
    /// When the input has another width, or is too large for the device.
    pub fn forward(&self, input: Tensor<2>) -> Result<Tensor<2>, KernelError> {
        forward(input, self.layers.iter())
    }
}

/// The outputs of the last layer, with ReLU behind each of the others.
///
/// # Shapes
/// `[N, first width] -> [N, last width]`
///
/// # Errors
/// When the widths do not fit, or the input is too large for the device.
pub(crate) fn forward<'a>(
    input: Tensor<2>,
    layers: impl Iterator<Item = &'a Linear>,
) -> Result<Tensor<2>, KernelError> {
    let device = input.device();
    let (mut widths, mut parameters) = (Vec::new(), Vec::new());
    for layer in layers {
        let [n_inputs, n_outputs] = layer.weight.dims();
        if widths.is_empty() {
            widths.push(n_inputs);
        }
        widths.push(n_outputs);
        parameters.extend([layer.weight.val().flatten(0, 1), biases(layer, &device)]);
    }
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
