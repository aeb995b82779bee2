//! Small fully connected networks in one operation.

mod autodiff;
pub mod cpu;
#[cfg(feature = "cube")]
mod cube;
pub mod reference;
#[cfg(test)]
mod tests;

use burn::backend::tensor::FloatTensor;
use burn::backend::{Backend, Dispatch, backend_extension};
use burn::tensor::Tensor;

use crate::KernelError;
use crate::host::{HostBackend, dims};
use crate::limits::check_values;

/// Widths of a network and offsets of its parameters.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct MlpLayout {
    layers: Vec<MlpLayer>,
}

/// One layer of a network.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct MlpLayer {
    /// Width of its input.
    pub n_inputs: usize,
    /// Width of its output.
    pub n_outputs: usize,
    /// Offset of its weights `[n_inputs, n_outputs]` in the network's parameters; its biases `[n_outputs]` follow them.
    pub first: usize,
}

impl MlpLayer {
    /// Offset of its biases.
    pub fn first_bias(self) -> usize {
        self.first + self.n_inputs * self.n_outputs
    }

    /// Offset behind its parameters.
    fn end(self) -> usize {
        self.first_bias() + self.n_outputs
    }
}

impl MlpLayout {
    /// A network of the given widths, first input to last output.
    ///
    /// # Errors
    /// [`KernelError::Config`] for fewer than two widths, or for a width of zero.
    pub fn new(widths: &[usize]) -> Result<Self, KernelError> {
        if widths.len() < 2 || widths.contains(&0) {
            return Err(KernelError::Config {
                op: "mlp",
                what: format!("widths {widths:?}, expected two or more of at least one"),
            });
        }
        let mut first = 0;
        let layers = widths.windows(2).map(|pair| {
            let layer = MlpLayer {
                n_inputs: pair[0],
                n_outputs: pair[1],
                first,
            };
            first = layer.end();
            layer
        });
        Ok(Self {
            layers: layers.collect(),
        })
    }

    /// The layers, first to last.
    pub fn layers(&self) -> &[MlpLayer] {
        &self.layers
    }

    /// Width of the input.
    pub fn n_inputs(&self) -> usize {
        self.layers[0].n_inputs
    }

    /// Width of the output.
    pub fn n_outputs(&self) -> usize {
        self.last().n_outputs
    }

    /// Number of weights and biases of all layers.
    pub fn n_parameters(&self) -> usize {
        self.last().end()
    }

    /// The widest of its inputs and outputs.
    fn largest_width(&self) -> usize {
        let widths = self.layers.iter().map(|layer| layer.n_outputs);
        widths.fold(self.n_inputs(), usize::max)
    }

    fn last(&self) -> MlpLayer {
        self.layers[self.layers.len() - 1]
    }
}

/// A fully connected network with ReLU between its layers (none after the last), for every row of the input.
///
/// The forward pass keeps no hidden layers: the gradient computes them again.
///
/// # Shapes
/// `input [N, n_inputs]`, `parameters [P]` -> `[N, n_outputs]`. `P` is [`MlpLayout::n_parameters`]: layer by layer
/// the weights `[n_inputs, n_outputs]` in row-major order, then the biases.
///
/// Inputs, parameters and sums that are not finite count as zero.
///
/// # Gradient
/// To the input and to the parameters. That of ReLU at zero is zero. Gradients that are not finite, given or
/// computed, count as zero.
///
/// # Errors
/// [`KernelError::Shape`] when a tensor does not fit the layout, [`KernelError::Limit`] when one outgrows the
/// device's largest buffer.
///
/// # Example
/// ```
/// use burn::tensor::{Device, Tensor};
/// use dash_kernels::mlp::{MlpLayout, mlp};
///
/// // Two inputs, two hidden units, one output: max(x, 0) + max(y, 0) + 0.5.
/// let layout = MlpLayout::new(&[2, 2, 1])?;
/// let parameters = [1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 1.0, 0.5];
/// let device = Device::flex();
/// let input = Tensor::from_floats([[1.0, 2.0], [3.0, -4.0]], &device);
/// let out = mlp(input, Tensor::from_floats(parameters, &device), &layout)?;
/// assert_eq!(out.into_data().try_into_vec::<f32>()?, [3.5, 3.5]);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn mlp(
    input: Tensor<2>,
    parameters: Tensor<1>,
    layout: &MlpLayout,
) -> Result<Tensor<2>, KernelError> {
    let shape_error = |tensor, expected, found: &[usize]| KernelError::Shape {
        op: "mlp",
        tensor,
        expected,
        found: found.to_vec(),
    };
    let [n, width] = input.dims();
    if width != layout.n_inputs() {
        let expected = format!("[N, {}]", layout.n_inputs());
        return Err(shape_error("input", expected, &[n, width]));
    }
    let n_parameters = layout.n_parameters();
    if parameters.dims() != [n_parameters] {
        let expected = format!("[{n_parameters}]");
        return Err(shape_error("parameters", expected, &parameters.dims()));
    }
    let device = input.device();
    // No device binds an empty buffer.
    if n == 0 {
        return Ok(Tensor::zeros([0, layout.n_outputs()], &device));
    }
    check_values(
        "the network's layers",
        n.saturating_mul(layout.largest_width()).max(n_parameters),
        "pass fewer rows at a time",
        &device,
    )?;
    Ok(Tensor::from_dispatch(Dispatch::mlp(
        input.into_dispatch(),
        parameters.into_dispatch(),
        layout.clone(),
    )))
}

/// Dispatch of [`mlp`] over the enabled backends.
#[backend_extension(Autodiff, Flex: cfg(feature = "flex"), NdArray: cfg(feature = "ndarray"), Cube: cfg(feature = "cube"))]
pub trait Perceptron: Backend {
    /// See [`mlp`]; the shapes have been checked.
    fn mlp(
        input: FloatTensor<Self>,
        parameters: FloatTensor<Self>,
        layout: MlpLayout,
    ) -> FloatTensor<Self>;
}

/// The pullback of [`mlp`], which a backend has to implement for gradients.
pub trait PerceptronVjp: Perceptron {
    /// Gradients `[v_input, v_parameters]` from the gradient of the output, where `needed`.
    fn mlp_vjp(
        input: FloatTensor<Self>,
        parameters: FloatTensor<Self>,
        v_out: FloatTensor<Self>,
        layout: &MlpLayout,
        needed: [bool; 2],
    ) -> [Option<FloatTensor<Self>>; 2];
}

impl<B: HostBackend> Perceptron for B {
    fn mlp(input: FloatTensor<B>, parameters: FloatTensor<B>, layout: MlpLayout) -> FloatTensor<B> {
        let [n, _] = dims(&input);
        let out = cpu::mlp(&B::values(&input), &B::values(&parameters), &layout);
        B::tensor(out, [n, layout.n_outputs()], &input)
    }
}

impl<B: HostBackend> PerceptronVjp for B {
    fn mlp_vjp(
        input: FloatTensor<B>,
        parameters: FloatTensor<B>,
        v_out: FloatTensor<B>,
        layout: &MlpLayout,
        needed: [bool; 2],
    ) -> [Option<FloatTensor<B>>; 2] {
        let (x, weights) = (B::values(&input), B::values(&parameters));
        let [v_input, v_parameters] =
            cpu::mlp_vjp(&x, &weights, &B::values(&v_out), layout, needed);
        [
            v_input.map(|v| B::tensor(v, dims::<2>(&input), &input)),
            v_parameters.map(|v| B::tensor(v, dims::<1>(&parameters), &parameters)),
        ]
    }
}
