//! Fully connected networks on the CPU.
//!
//! A parallel piece is a block of rows that goes through all layers while it is in the fast cache. Sixteen outputs of
//! four rows at a time are summed in registers; weights are packed so that those sixteen lie side by side. Rows are
//! independent. Gradients of the parameters are summed over chunks of rows whose number and order do not depend on
//! threads.

mod lanes;

use rayon::prelude::*;

use super::{MlpLayer, MlpLayout};
use crate::isa::{Kernel, dispatch, finite_or_zero};
use lanes::{
    LANES, Lanes, ROWS, Rows, add_outer, finite, finite_where_positive, multiply, pad, panels,
    plus, positive, unpad,
};

/// Rows that go through all layers together.
const BLOCK: usize = 64;
/// Fewest rows per chunk, and most chunks, of the sums of parameter gradients.
const PART: usize = 8 * BLOCK;
const MOST_PARTS: usize = 64;

/// A layer's parameters, padded with zeros to whole lanes.
struct Packed {
    n_inputs: usize,
    n_outputs: usize,
    /// For each sixteen outputs, their weights for every input.
    weights: Vec<Lanes>,
    biases: Vec<Lanes>,
    /// For each sixteen inputs, their weights for every output.
    transposed: Vec<Lanes>,
}

impl Packed {
    fn new(layer: &MlpLayer, parameters: &[f32], with_transposed: bool) -> Self {
        let MlpLayer {
            n_inputs,
            n_outputs,
            first,
        } = *layer;
        let weight = |k: usize, j: usize| {
            if k < n_inputs && j < n_outputs {
                finite_or_zero(parameters[first + k * n_outputs + j])
            } else {
                0.0
            }
        };
        let biases = parameters[layer.first_bias()..][..n_outputs].chunks(LANES);
        let transposed_panels = if with_transposed { panels(n_inputs) } else { 0 };
        Self {
            n_inputs,
            n_outputs,
            weights: in_lanes(panels(n_outputs), n_inputs, |j, k| weight(k, j)),
            biases: biases
                .map(|chunk| {
                    std::array::from_fn(|l| chunk.get(l).map_or(0.0, |&b| finite_or_zero(b)))
                })
                .collect(),
            transposed: in_lanes(transposed_panels, n_outputs, weight),
        }
    }
}

/// `value(lane, step)` of `panels` times sixteen lanes over `n` steps.
fn in_lanes(panels: usize, n: usize, value: impl Fn(usize, usize) -> f32) -> Vec<Lanes> {
    (0..panels)
        .flat_map(|panel| (0..n).map(move |step| (panel, step)))
        .map(|(panel, step)| std::array::from_fn(|l| value(panel * LANES + l, step)))
        .collect()
}

fn pack(parameters: &[f32], layout: &MlpLayout, with_transposed: bool) -> Vec<Packed> {
    layout
        .layers()
        .iter()
        .map(|layer| Packed::new(layer, parameters, with_transposed))
        .collect()
}

/// `input [N, n_inputs], parameters [P] -> [N, n_outputs]`, see [`mlp`](super::mlp()).
pub fn mlp(input: &[f32], parameters: &[f32], layout: &MlpLayout) -> Vec<f32> {
    let (n_inputs, n_outputs) = (layout.n_inputs(), layout.n_outputs());
    let layers = pack(parameters, layout, false);
    let mut out = vec![0.0; input.len() / n_inputs * n_outputs];
    out.par_chunks_mut(BLOCK * n_outputs)
        .zip(input.par_chunks(BLOCK * n_inputs))
        .for_each_init(
            || Activations::new(layout),
            |activations, (out, input)| {
                dispatch(Forward {
                    layers: &layers,
                    input,
                    activations: &mut *activations,
                });
                unpad(out, &activations.0[layers.len()], n_outputs);
            },
        );
    out
}

/// Gradients `[v_input, v_parameters]` of [`mlp`], where `needed`, from `v_out [N, n_outputs]`.
pub fn mlp_vjp(
    input: &[f32],
    parameters: &[f32],
    v_out: &[f32],
    layout: &MlpLayout,
    [needs_input, needs_parameters]: [bool; 2],
) -> [Option<Vec<f32>>; 2] {
    let (n_inputs, n_outputs) = (layout.n_inputs(), layout.n_outputs());
    let n = input.len() / n_inputs;
    let layers = pack(parameters, layout, true);
    let part = n.div_ceil(MOST_PARTS).next_multiple_of(BLOCK).max(PART);
    let mut v_input = vec![0.0; if needs_input { input.len() } else { 0 }];
    let mut v_inputs: Vec<&mut [f32]> = v_input.chunks_mut(part * n_inputs).collect();
    v_inputs.resize_with(n.div_ceil(part), Default::default);
    let sums: Vec<Vec<f32>> = v_inputs
        .into_par_iter()
        .zip(input.par_chunks(part * n_inputs))
        .zip(v_out.par_chunks(part * n_outputs))
        .map(|((v_input, input), v_out)| {
            let mut scratch = Scratch::new(layout, needs_input, needs_parameters);
            let mut v_inputs = v_input.chunks_mut(BLOCK * n_inputs);
            let blocks = input.chunks(BLOCK * n_inputs);
            for (input, v_out) in blocks.zip(v_out.chunks(BLOCK * n_outputs)) {
                dispatch(Backward {
                    layers: &layers,
                    input,
                    v_out,
                    scratch: &mut scratch,
                });
                if let Some(v_input) = v_inputs.next() {
                    unpad(v_input, &scratch.v, n_inputs);
                }
            }
            scratch.parameters(layout)
        })
        .collect();
    let v_parameters = needs_parameters.then(|| {
        let mut sums = sums.into_iter();
        let mut total = sums.next().unwrap_or_default();
        for sum in sums {
            for (total, value) in total.iter_mut().zip(sum) {
                *total += value;
            }
        }
        for value in &mut total {
            *value = finite_or_zero(*value);
        }
        total
    });
    [needs_input.then_some(v_input), v_parameters]
}

/// The input of every layer and the output, for a block of rows in whole lanes.
struct Activations(Vec<Vec<Lanes>>);

impl Activations {
    fn new(layout: &MlpLayout) -> Self {
        let outputs = layout.layers().iter().map(|layer| layer.n_outputs);
        let widths = std::iter::once(layout.n_inputs()).chain(outputs);
        Self(
            widths
                .map(|width| vec![[0.0; LANES]; BLOCK * panels(width)])
                .collect(),
        )
    }
}

/// What the gradient of a block needs, and the sums over blocks.
struct Scratch {
    activations: Activations,
    /// Gradient of what the layer at hand gives, then of what it reads.
    v: Vec<Lanes>,
    v_before: Vec<Lanes>,
    /// For each layer, the gradients of its weights, input by input, and of its biases.
    sums: Vec<(Vec<Lanes>, Vec<Lanes>)>,
    needs_input: bool,
}

impl Scratch {
    fn new(layout: &MlpLayout, needs_input: bool, needs_parameters: bool) -> Self {
        let widest = BLOCK * panels(layout.largest_width());
        let zeros = |n: usize| vec![[0.0; LANES]; n];
        let sums = layout.layers().iter().filter(|_| needs_parameters);
        Self {
            activations: Activations::new(layout),
            v: zeros(widest),
            v_before: zeros(widest),
            sums: sums
                .map(|layer| {
                    let panels = panels(layer.n_outputs);
                    let inputs = layer.n_inputs.next_multiple_of(ROWS);
                    (zeros(inputs * panels), zeros(panels))
                })
                .collect(),
            needs_input,
        }
    }

    /// The sums in the order of the network's parameters.
    fn parameters(&self, layout: &MlpLayout) -> Vec<f32> {
        let mut all = Vec::with_capacity(layout.n_parameters());
        for ((weights, biases), layer) in self.sums.iter().zip(layout.layers()) {
            let rows = weights.chunks_exact(biases.len()).take(layer.n_inputs);
            for row in rows.chain([biases.as_slice()]) {
                all.extend_from_slice(&row.as_flattened()[..layer.n_outputs]);
            }
        }
        all
    }
}

/// One block through all layers.
struct Forward<'a> {
    layers: &'a [Packed],
    input: &'a [f32],
    activations: &'a mut Activations,
}

impl Kernel for Forward<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        forward(self.layers, self.input, self.activations, self.layers.len());
    }
}

/// The first `n_layers` layers; returns the rows there are, padded.
#[inline(always)]
fn forward(
    layers: &[Packed],
    input: &[f32],
    Activations(all): &mut Activations,
    n_layers: usize,
) -> usize {
    let n_rows = pad(&mut all[0], input, layers[0].n_inputs);
    for (index, layer) in layers.iter().enumerate().take(n_layers) {
        let (before, after) = all.split_at_mut(index + 1);
        let input = Rows::new(&before[index], layer.n_inputs);
        let (weights, biases) = (&layer.weights, &layer.biases);
        let out = &mut after[0];
        if index + 1 == layers.len() {
            multiply(input, weights, biases, out, n_rows, |_, sums| finite(sums));
        } else {
            multiply(input, weights, biases, out, n_rows, |_, sums| {
                positive(sums)
            });
        }
    }
    n_rows
}

/// One block's gradients, added to the sums; that of its input is left in [`Scratch::v`].
struct Backward<'a> {
    layers: &'a [Packed],
    input: &'a [f32],
    v_out: &'a [f32],
    scratch: &'a mut Scratch,
}

impl Kernel for Backward<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self {
            layers,
            input,
            v_out,
            scratch,
        } = self;
        let n_rows = forward(layers, input, &mut scratch.activations, layers.len() - 1);
        pad(&mut scratch.v, v_out, layers[layers.len() - 1].n_outputs);
        for (index, layer) in layers.iter().enumerate().rev() {
            let given = &scratch.activations.0[index];
            let panels = panels(layer.n_outputs);
            if let Some((weights, biases)) = scratch.sums.get_mut(index) {
                let v = &scratch.v[..n_rows * panels];
                add_outer(Rows::new(given, layer.n_inputs), v, weights, panels);
                for row in v.chunks_exact(panels) {
                    for (sum, v) in biases.iter_mut().zip(row) {
                        *sum = plus(*sum, *v);
                    }
                }
            }
            if index == 0 && !scratch.needs_input {
                break;
            }
            let v = Rows::new(&scratch.v, layer.n_outputs);
            let (weights, out) = (&layer.transposed, &mut scratch.v_before);
            if index == 0 {
                multiply(v, weights, &[], out, n_rows, |_, sums| finite(sums));
            } else {
                multiply(v, weights, &[], out, n_rows, |at, sums| {
                    finite_where_positive(sums, &given[at])
                });
            }
            std::mem::swap(&mut scratch.v, &mut scratch.v_before);
        }
    }
}
