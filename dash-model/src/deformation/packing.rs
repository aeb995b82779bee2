//! One parameter that holds the weights and biases of all layers and heads.

use std::collections::BTreeMap;

use dash_kernels::mlp::{MlpLayer, MlpLayout};

use super::Heads;
use crate::ModelError;
use crate::parameters::HostTensor;

/// Where a decoder's parameter holds each layer and head.
#[derive(Debug, Clone)]
pub(crate) struct Packing {
    layout: MlpLayout,
    /// Names and widths.
    heads: Vec<(&'static str, usize)>,
}

impl Packing {
    /// Of a decoder with these widths: the input's, then those of the hidden layers.
    pub(super) fn new(widths: &[usize], heads: &Heads) -> Result<Self, ModelError> {
        let heads: Vec<_> = heads.present().collect();
        let mut widths = widths.to_vec();
        widths.push(heads.iter().map(|(_, width)| width).sum());
        let layout = MlpLayout::new(&widths)?;
        Ok(Self { layout, heads })
    }

    pub(super) fn layout(&self) -> &MlpLayout {
        &self.layout
    }

    /// Names and widths of the heads.
    pub(super) fn heads(&self) -> &[(&'static str, usize)] {
        &self.heads
    }

    /// The input's width, then those of the hidden layers.
    pub(super) fn widths(&self) -> Vec<usize> {
        let layers = self.layout.layers().iter();
        layers.map(|layer| layer.n_inputs).collect()
    }

    pub(super) fn hidden(&self) -> &[MlpLayer] {
        let layers = self.layout.layers();
        &layers[..layers.len() - 1]
    }

    /// Weights and biases out of a parameter's values, by name behind `prefix`: `decoder.layers.0.weight`,
    /// `head_means.bias` and so on.
    pub(crate) fn unpack(&self, prefix: &str, values: &[f32]) -> BTreeMap<String, HostTensor> {
        let mut named = self.zeros(prefix);
        for columns in self.list(prefix) {
            let tensor = named.get_mut(&columns.name);
            let tensor = tensor.expect("named by the same packing");
            let rows = tensor.values.chunks_exact_mut(columns.width);
            for (row, first) in rows.zip(columns.rows()) {
                row.copy_from_slice(&values[first..][..columns.width]);
            }
        }
        named
    }

    /// A parameter's values; takes its weights and biases out of `named`.
    ///
    /// # Errors
    /// [`ModelError::Parameter`] when one is missing or has another shape.
    pub(crate) fn pack(
        &self,
        prefix: &str,
        named: &mut BTreeMap<String, HostTensor>,
    ) -> Result<Vec<f32>, ModelError> {
        let mut values = vec![0.0; self.layout.n_parameters()];
        for columns in self.list(prefix) {
            let refuse = |found: String| {
                let expected = format!("shape {:?}", columns.shape());
                ModelError::parameter(&columns.name, expected, found)
            };
            let tensor = named
                .remove(&columns.name)
                .ok_or_else(|| refuse("none".into()))?;
            if tensor.shape != columns.shape() {
                return Err(refuse(format!("shape {:?}", tensor.shape)));
            }
            let rows = tensor.values.chunks_exact(columns.width);
            for (row, first) in rows.zip(columns.rows()) {
                values[first..][..columns.width].copy_from_slice(row);
            }
        }
        Ok(values)
    }

    pub(super) fn zeros(&self, prefix: &str) -> BTreeMap<String, HostTensor> {
        let zeros = |columns: Columns| {
            let values = vec![0.0; columns.n_rows * columns.width];
            let shape = columns.shape();
            (columns.name, HostTensor { shape, values })
        };
        self.list(prefix).map(zeros).collect()
    }

    /// Where each named tensor lies in the parameter.
    fn list(&self, prefix: &str) -> impl Iterator<Item = Columns> {
        let hidden = self.hidden().iter().enumerate();
        let whole = move |(index, &layer): (usize, &MlpLayer)| {
            let name = format!("{prefix}{}", hidden_name(index));
            Columns::weights_and_biases(name, layer, 0, layer.n_outputs)
        };
        let last = *self.layout.layers().last().expect("two layers at least");
        let mut column = 0;
        let heads = self.heads.iter().flat_map(move |&(name, width)| {
            column += width;
            let name = format!("{prefix}{name}");
            Columns::weights_and_biases(name, last, column - width, width)
        });
        hidden.flat_map(whole).chain(heads)
    }
}

/// Adjacent columns of a layer's weights, or of its biases.
struct Columns {
    name: String,
    /// `None` for biases, which have no rows.
    n_inputs: Option<usize>,
    n_rows: usize,
    width: usize,
    first: usize,
    stride: usize,
}

impl Columns {
    fn weights_and_biases(name: String, layer: MlpLayer, column: usize, width: usize) -> [Self; 2] {
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

    /// The index of each row's first value.
    fn rows(&self) -> impl Iterator<Item = usize> + use<> {
        let (first, stride) = (self.first, self.stride);
        (0..self.n_rows).map(move |row| first + row * stride)
    }
}

/// The name of a hidden layer in files.
pub(super) fn hidden_name(index: usize) -> String {
    format!("decoder.layers.{index}")
}
