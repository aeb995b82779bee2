//! A feature network as a Burn module.

use burn::module::{Module, Param};
use burn::nn::PaddingConfig2d;
use burn::nn::conv::Conv2d;
use burn::nn::pool::MaxPool2d;
use burn::tensor::activation::relu;
use burn::tensor::{Device, Tensor, TensorData};
use dash_model::parameters::HostTensor;

use super::architecture::LayerTable;

/// One convolution with the pooling in front of it and the ReLU behind it.
#[derive(Module, Debug)]
pub(super) struct FeatureLayer {
    pool: Option<MaxPool2d>,
    conv: Conv2d,
    /// Whether LPIPS compares what comes out.
    pub(super) compared: bool,
}

impl FeatureLayer {
    /// A layer with the weights `[out, in, kernel, kernel]` and the bias `[out]`.
    pub(super) fn new(
        table: &LayerTable,
        weight: HostTensor,
        bias: HostTensor,
        device: &Device,
    ) -> Self {
        let LayerTable {
            kernel,
            stride,
            padding,
            ..
        } = *table;
        let pool = table.pool.map(|[window, stride]| MaxPool2d {
            stride: [stride; 2],
            kernel_size: [window; 2],
            padding: PaddingConfig2d::Valid,
            dilation: [1; 2],
            ceil_mode: false,
        });
        let conv = Conv2d {
            weight: parameter(weight, device),
            bias: Some(parameter(bias, device)),
            stride: [stride; 2],
            kernel_size: [kernel; 2],
            dilation: [1; 2],
            groups: 1,
            padding: PaddingConfig2d::Explicit(padding, padding, padding, padding),
        };
        Self {
            pool,
            conv,
            compared: table.compared,
        }
    }

    /// # Shapes
    /// `[N, in, H, W] -> [N, out, H', W']`
    pub(super) fn forward(&self, input: Tensor<4>) -> Tensor<4> {
        let input = match &self.pool {
            Some(pool) => pool.forward(input),
            None => input,
        };
        relu(self.conv.forward(input))
    }
}

/// A parameter that holds `values`.
pub(super) fn parameter<const R: usize>(values: HostTensor, device: &Device) -> Param<Tensor<R>> {
    Param::from_data(TensorData::new(values.values, values.shape), device)
}
